from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section, plane_surface
from matplotlib.figure import Figure

from seismo3d.errors import ShapeError
from seismo3d.plot import unfaulted_section
from seismo3d.seismic._kernels_cuts import cross_edges
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.unfaulting import (
    UnfaultSettings,
    _Carried,
    _carry_back,
    _lay_out,
    _take_back,
    find_slip_field,
    unfault,
)

SHAPE = (40, 48, 60)


def even(surface: FaultSurface, throw: float) -> FaultSurface:
    n = len(surface.vertices)
    moved = np.full(n, throw, np.float32)
    return replace(surface, throw=moved, separation=moved, throw_fit=np.full(n, 0.9, np.float32))


def wide(*, axis: int, centre: float, dip_deg: float, throw: float) -> FaultSurface:
    """A plane of one throw that goes on to the cube's ends."""
    made = even(plane_surface(axis=axis, centre=centre, dip_deg=dip_deg, throw=throw, shape=SHAPE), throw)
    vertices = made.vertices.copy()
    other, middle = 1 - axis, (SHAPE[2] - 1) / 2
    for k, n in ((other, SHAPE[other]), (2, SHAPE[2])):
        low, high = vertices[:, k].min(), vertices[:, k].max()
        vertices[:, k] = (vertices[:, k] - low) / (high - low) * (n - 1)
    vertices[:, axis] = centre + (vertices[:, 2] - middle) / np.tan(np.radians(dip_deg))
    return replace(made, vertices=vertices)


def fault_set(*surfaces: FaultSurface) -> FaultSet:
    empty = np.zeros(SHAPE, np.float32)
    return FaultSet(surfaces, empty, empty.astype(np.int32), empty, settings={})


def layers(z: np.ndarray) -> np.ndarray:
    return np.sin(2 * np.pi * z / 13.0) + 0.6 * np.cos(2 * np.pi * z / 31.0)


def faulted(*, throw: float, dip_deg: float = 65.0, centre: float = 24.0, slope: float = 0.1) -> np.ndarray:
    """Layers that dip along inlines, the hanging wall moved straight down the fault's dip."""
    i, j, k = np.meshgrid(*(np.arange(n, dtype=float) for n in SHAPE), indexing="ij")
    hanging = j > centre + (k - (SHAPE[2] - 1) / 2) / np.tan(np.radians(dip_deg))
    return layers(k - slope * i - np.where(hanging, throw, 0.0)).astype(np.float32)


def inner(a: np.ndarray) -> np.ndarray:
    return a[4:-4, 8:-8, 10:-10]


@pytest.mark.parametrize(("throw", "dip_deg"), [(6.0, 65.0), (-5.0, 55.0), (2.5, 85.0)])
def test_layers_of_one_fault_are_whole_again(throw: float, dip_deg: float) -> None:
    cube = faulted(throw=throw, dip_deg=dip_deg)
    found = unfault(cube, fault_set(wide(axis=1, centre=24.0, dip_deg=dip_deg, throw=throw)))
    k = np.arange(SHAPE[2])[None, None, :] - 0.1 * np.arange(SHAPE[0])[:, None, None]
    # far from the fault each side has come half the way; between them the field bends smoothly
    best = min(np.abs(inner(found) - inner(layers(k - move) + 0 * found)).mean() for move in np.linspace(-5, 5, 101))
    assert best < 0.06
    before = min(np.abs(inner(cube) - inner(layers(k - move) + 0 * found)).mean() for move in np.linspace(-5, 5, 101))
    assert before > 4.0 * best


def test_jump_across_the_fault_is_its_slip_and_there_is_none_elsewhere() -> None:
    surface = wide(axis=1, centre=24.0, dip_deg=65.0, throw=6.0)
    field = find_slip_field(fault_set(surface))
    assert field.missing < 0.06
    d = field.displacement
    i, k = 20, 30
    heave = 6.0 / np.tan(np.radians(65.0))
    np.testing.assert_allclose(d[:, i, 26, k] - d[:, i, 23, k], [0.0, heave, 6.0], atol=0.25)
    steps = np.abs(np.diff(d[2, i, :, k]))
    assert (steps > 1.0).sum() == 1
    np.testing.assert_allclose(d.mean(axis=(1, 2, 3)), 0.0, atol=1e-3)
    # the fault has come half the slip up its own dip: on to itself
    place = field.surfaces[0]
    plane = 24.0 + (place[:, 2] - (SHAPE[2] - 1) / 2) / np.tan(np.radians(65.0))
    clear = ((place > 6) & (place < np.array(SHAPE) - 7)).all(axis=1)
    assert np.abs(place[clear, 1] - plane[clear]).max() < 0.5


def test_what_touched_before_touches_again_where_both_walls_moved() -> None:
    surface = wide(axis=1, centre=24.0, dip_deg=65.0, throw=6.0)
    growing = replace(surface, throw=(6.0 + 0.1 * (surface.vertices[:, 2] - 30.0)).astype(np.float32))
    i, k = 20, 30

    def jump(lift: float) -> float:
        d = find_slip_field(fault_set(replace(growing, lift=lift))).displacement
        return float((d[2, :, 26, k] - d[2, :, 23, k])[i])

    # half of the throw there, and half of that higher up: 0.1 less a sample
    assert jump(0.5) / jump(1.0) == pytest.approx(1.0 / 1.05, abs=0.01)


def test_slip_dies_out_beyond_the_edge_of_a_surface() -> None:
    whole = wide(axis=1, centre=24.0, dip_deg=70.0, throw=4.0)
    kept = whole.cells[(whole.vertices[whole.cells, 2] > 30.0).all(axis=1)]
    d = find_slip_field(fault_set(replace(whole, **_used(whole, kept)))).displacement
    across = d[2, 20, 34] - d[2, 20, 12]
    assert across[50] > 3.0
    assert across[5] < 1.5
    steps = np.abs(np.diff(d[2, 20], axis=0)).max(axis=0)
    assert steps[:17].max() < 0.3


def _used(surface: FaultSurface, cells: np.ndarray) -> dict[str, Any]:
    used = np.unique(cells)
    number = np.full(len(surface.vertices), -1)
    number[used] = np.arange(len(used))
    names = ("vertices", "normals", "likelihood", "throw", "separation", "throw_fit", "strike_deg", "dip_deg")
    return {name: getattr(surface, name)[used] for name in names} | {"cells": number[cells].astype(np.int32)}


def test_crossing_faults_are_both_taken_out() -> None:
    one, other = (wide(axis=a, centre=c, dip_deg=80.0, throw=t) for a, c, t in ((1, 24.0, 5.0), (0, 20.0, -3.0)))
    field = find_slip_field(fault_set(one, other))
    d = field.displacement[2]
    # four blocks: throws add up across both, wherever one looks
    for k in (20, 40):
        assert d[30, 38, k] - d[30, 8, k] == pytest.approx(5.0, abs=0.5)
        assert d[34, 8, k] - d[6, 8, k] == pytest.approx(-3.0, abs=0.5)
        assert d[34, 38, k] - d[6, 8, k] == pytest.approx(2.0, abs=0.7)


def parted() -> tuple[list[FaultSurface], np.ndarray]:
    """An old fault that a young one has taken apart, and the throws between opposite blocks."""
    young = wide(axis=0, centre=20.0, dip_deg=75.0, throw=12.0)
    old = wide(axis=1, centre=22.0, dip_deg=60.0, throw=6.0)
    parts = []
    for hanging in (False, True):
        moved = old.vertices + np.float32([0, 0, 12.0 if hanging else 0.0])
        beyond = moved[:, 0] > 20.0 + (moved[:, 2] - (SHAPE[2] - 1) / 2) / np.tan(np.radians(75.0))
        chosen = ((beyond == hanging) & (moved[:, 2] <= SHAPE[2] - 1))[old.cells].all(axis=1)
        part = replace(old, vertices=moved.astype(np.float32))
        parts.append(replace(part, **_used(part, old.cells[chosen]), family=1, generation=1))
    return [young, *parts], np.array([12.0, 6.0])


def test_parts_of_an_old_fault_are_one_again_where_the_young_one_is_taken_back() -> None:
    surfaces, (young, old) = parted()
    field = find_slip_field(fault_set(*surfaces))
    # clear of the young fault both parts of the old one lie on one plane of its dip
    off = []
    for place in field.surfaces[1:]:
        clear = np.abs(place[:, 0] - 20.0 - (place[:, 2] - 29.5) / np.tan(np.radians(75.0))) > 4.0
        off.append((place[:, 1] - 22.0 - (place[:, 2] - 29.5) / np.tan(np.radians(60.0)))[clear])
    np.testing.assert_allclose(np.concatenate(off), np.median(off[0]), atol=0.8)
    d = field.displacement[2]
    for i in (8, 32):
        assert d[i, 40, 30] - d[i, 6, 30] == pytest.approx(old, abs=0.8)
    for j in (6, 40):
        assert d[34, j, 30] - d[6, j, 30] == pytest.approx(young, abs=1.2)


def test_slip_goes_on_where_a_fault_leaves_the_cube() -> None:
    """The hanging wall comes up by half a large throw: what comes in from below the cube was thrown as well."""
    field = find_slip_field(fault_set(wide(axis=1, centre=24.0, dip_deg=80.0, throw=30.0)))
    assert field.missing < 0.06
    assert np.abs(field.displacement[2, 20, 42] - field.displacement[2, 20, 6] - 30.0).max() < 1.0


def test_strike_slip_is_taken_out_too() -> None:
    surface = replace(wide(axis=1, centre=24.0, dip_deg=65.0, throw=4.0), strike_share=0.5)
    d = find_slip_field(fault_set(surface)).displacement
    slip = np.median(surface.slip, axis=0)
    assert abs(slip[0]) == pytest.approx(2.0, abs=1e-3)
    np.testing.assert_allclose(d[:, 20, 30, 30] - d[:, 20, 18, 30], slip, atol=0.25)


def test_order_of_faults_does_not_matter() -> None:
    one, other = (wide(axis=a, centre=c, dip_deg=80.0, throw=t) for a, c, t in ((1, 24.0, 5.0), (0, 20.0, -3.0)))
    a, b = find_slip_field(fault_set(one, other)), find_slip_field(fault_set(other, one))
    np.testing.assert_allclose(a.displacement, b.displacement, atol=1e-3)


def test_missing_traces_stay_missing_and_coordinates_are_kept() -> None:
    cube = make_cube()
    found = unfault(cube, make_faults(cube))
    assert found.dims == cube.dims
    assert found.name == "unfaulted"
    assert np.isnan(found.values[3, 3:5]).all()
    assert np.isfinite(np.delete(found.values.reshape(-1, 50), [3 * 40 + 3, 3 * 40 + 4], axis=0)).all()
    np.testing.assert_array_equal(found["time"], cube["time"])


def test_without_faults_or_throws_nothing_moves() -> None:
    cube = faulted(throw=5.0)
    np.testing.assert_allclose(unfault(cube, fault_set()), cube, atol=1e-5)
    unknown = even(wide(axis=1, centre=24.0, dip_deg=65.0, throw=5.0), np.nan)
    np.testing.assert_allclose(unfault(cube, fault_set(unknown)), cube, atol=1e-5)


def test_throws_that_are_guesses_are_left_alone() -> None:
    cube = faulted(throw=5.0)
    surface = wide(axis=1, centre=24.0, dip_deg=65.0, throw=5.0)
    guessed = replace(surface, throw_fit=np.full(len(surface.vertices), 0.2, np.float32))
    field = find_slip_field(fault_set(guessed))
    assert np.abs(field.displacement).max() == 0.0
    np.testing.assert_allclose(field.surfaces[0], guessed.vertices)
    np.testing.assert_allclose(unfault(cube, fault_set(guessed)), cube, atol=1e-5)


def test_large_throw_grows_gently_from_the_tip() -> None:
    whole = wide(axis=1, centre=24.0, dip_deg=80.0, throw=30.0)
    kept = whole.cells[(whole.vertices[whole.cells, 2] > 26.0).all(axis=1)]
    surface = replace(whole, **_used(whole, kept))
    sheet = laid_out(surface)
    within = (sheet.nodes[:, 0] >= 0) & (sheet.nodes[:, 0] <= SHAPE[0] - 1)
    throw, sample = sheet.slip[within, 2], sheet.nodes[within, 2]
    tip = surface.vertices[:, 2].min()
    # 1.5 times eight samples at the tip, which the grid puts two samples further out and smoothing blurs by as many;
    # dying out beyond it; none is lost where the fault leaves the cube
    assert throw[np.abs(sample - tip) < 1.0].max() < 1.5 * (8.0 + 6.0)
    assert throw[sample < tip - 7.0].max() < 6.0
    np.testing.assert_allclose(throw[(sample > tip + 20.0) & (sample < SHAPE[2] - 1)], 30.0, atol=0.1)


def laid_out(surface: FaultSurface, *, moved: np.ndarray | None = None) -> Any:
    """The sheet of a surface whose places all lay elsewhere before what is taken back, by a displacement."""
    moved = np.zeros(3) if moved is None else moved
    displacement = np.broadcast_to(moved[:, None, None, None], (3, *SHAPE)).astype(np.float32)
    today = _Carried.today(surface)
    carried = replace(today, at=today.at - moved)
    sheet = _lay_out([surface], [carried], [0], displacement, UnfaultSettings())
    assert sheet is not None
    return sheet


def test_rough_surface_goes_straight_on_beyond_its_edge() -> None:
    whole = wide(axis=1, centre=24.0, dip_deg=80.0, throw=36.0)
    kept = whole.cells[(whole.vertices[whole.cells, 2] > 26.0).all(axis=1)]
    surface = replace(whole, **_used(whole, kept))
    rough = surface.vertices + np.random.default_rng(4).normal(0.0, [0.0, 0.4, 0.0], surface.vertices.shape)
    sheet = laid_out(replace(surface, vertices=rough.astype(np.float32)))
    assert sheet.nodes[:, 2].min() < 4.0
    plane = 24.0 + (sheet.nodes[:, 2] - (SHAPE[2] - 1) / 2) / np.tan(np.radians(80.0))
    assert np.abs(sheet.nodes[:, 1] - plane).max() < 2.0


def test_slip_goes_through_a_hole_but_not_through_a_wide_gap() -> None:
    whole = wide(axis=1, centre=24.0, dip_deg=80.0, throw=5.0)

    def slip_in_gap(width: float) -> np.ndarray:
        beside = np.abs(whole.vertices[whole.cells, 2] - 30.0) > 0.5 * width
        sheet = laid_out(replace(whole, **_used(whole, whole.cells[beside.all(axis=1)])))
        within = (np.abs(sheet.nodes[:, 0] - 20.0) < 8.0) & (np.abs(sheet.nodes[:, 2] - 30.0) < 1.0)
        return sheet.slip[within, 2]

    through = slip_in_gap(10.0)
    assert len(through) >= 12
    np.testing.assert_allclose(through, 5.0, atol=0.3)
    assert np.abs(slip_in_gap(34.0)).max(initial=0.0) < 0.5


def test_fault_that_left_the_cube_goes_on_where_its_end_has_moved_to() -> None:
    surface = wide(axis=1, centre=24.0, dip_deg=80.0, throw=20.0)
    sheet = laid_out(surface, moved=np.array([0.0, 0.0, 15.0]))
    inner = (sheet.nodes[:, 0] > 4.0) & (sheet.nodes[:, 0] < SHAPE[0] - 5)
    assert sheet.nodes[:, 2].max() > 55.0
    np.testing.assert_allclose(sheet.slip[inner, 2], 20.0, atol=0.1)


def test_vertices_right_beside_a_fault_that_is_taken_back_are_not_sure() -> None:
    surfaces, _ = parted()
    sheet, carried = laid_out(surfaces[0]), [_Carried.today(surface) for surface in surfaces]
    step, places, _, _ = _take_back([sheet], SHAPE, UnfaultSettings())
    after = _carry_back(carried, step, [([0], sheet)], places)
    assert after[0].sure.all()
    for before, vertices in zip(carried[1:], after[1:], strict=True):
        slope = 1.0 / np.tan(np.radians(75.0))
        off = np.abs(before.at[:, 0] - 20.0 - (before.at[:, 2] - 29.5) * slope) / np.hypot(1.0, slope)
        assert not vertices.sure[off < 2.0].any()
        assert vertices.sure[off > 4.0].all()


def test_kernel_finds_each_crossed_edge_with_its_sign() -> None:
    vertices = np.array([[0.5, -0.5, -0.5], [0.5, 3.5, -0.5], [0.5, -0.5, 3.5], [0.5, 3.5, 3.5]])
    cells = np.array([[0, 1, 2], [1, 3, 2]])
    values = np.array([[1.0], [1.0], [1.0], [1.0]])
    shape = np.array([2, 3, 3])
    edges, found = np.empty(50, np.int64), np.empty((50, 1))
    count = cross_edges(vertices, values, cells, shape, edges, found)
    # both triangles turn about +inline: all nine edges along inlines, none along the others
    assert sorted(set(edges[:count])) == list(range(9))
    assert (found[:count] == 1.0).all()
    count = cross_edges(vertices, values, cells[:, ::-1].copy(), shape, edges, found)
    assert (found[:count] == -1.0).all()
    assert cross_edges(vertices, values, cells, shape, edges[:2], found[:2]) == count


def test_refusals() -> None:
    faults = fault_set(wide(axis=1, centre=24.0, dip_deg=65.0, throw=6.0))
    with pytest.raises(ShapeError, match="Give the cube that they were traced in"):
        unfault(np.zeros((4, 5, 6), np.float32), faults)
    section, lines = make_section()
    with pytest.raises(ShapeError, match="Give a cube"):
        unfault(section, lines)
    with pytest.raises(ShapeError, match="of a section"):
        find_slip_field(lines)


def test_sections_are_drawn_side_by_side() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    found = unfault(cube, faults)
    today, before = unfaulted_section(cube, found, faults=faults, axes=Figure().subplots(1, 2), inline=130)
    np.testing.assert_allclose(before.images[0].get_array(), found.sel(inline=130).values.T)
    assert len(today.collections) == 2
    assert not before.collections
    with pytest.raises(ShapeError, match="expected the cube's"):
        unfaulted_section(cube, found[:5], inline=130)
