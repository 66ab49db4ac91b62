"""What faults did to the layers around them: shares of slip of both walls, and how it dies away."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest

import seismo3d as s3
from seismo3d._typing import Float64Array
from seismo3d.seismic import layer_strain
from seismo3d.seismic._kernels_strain import sum_products
from seismo3d.seismic.fault_ages import HistorySettings
from seismo3d.seismic.fault_motion import FaultMotion, Frame
from seismo3d.seismic.faults import FaultSettings
from seismo3d.seismic.layer_strain import (
    LayerSlopes,
    Strain,
    join_slopes,
    measure_evenness,
    sample_slopes,
    tell_strains,
)
from seismo3d.seismic.linking import Sheet
from seismo3d.seismic.scores import throw_score
from seismo3d.seismic.throw import SheetSides, SheetThrow
from seismo3d.synthetic import fault_cube

HISTORY = HistorySettings()
STEP, SHAPE = 2, (30, 81)
SIZE = 96
SILENT = (
    SheetThrow(np.zeros((2, 2), np.float32), np.zeros((2, 2), np.float32), 1),
    SheetSides(*(np.zeros((2, 2, 3), np.float32) for _ in range(3))),
    STEP,
)
NOWHERE = LayerSlopes(np.zeros((0, 3)), np.zeros((2, 0), np.float32), 128)


def bell(*, across: tuple[float, float] = (0.0, 1.0), at: float = 48.0, throw: float = 20.0) -> FaultMotion:
    """A fault that dips through the middle of a cube; its throw dies away from the middle."""
    normal = np.array(across)
    frame = Frame(np.array([48.0, 48.0]) + (at - 48.0) * normal, normal)
    rows, columns = np.mgrid[-80:80, 0:SIZE].astype(np.float64)
    height = 0.4 * (columns - 48.0)
    thrown = throw * np.exp(-0.5 * (rows / 35.0) ** 2 - 0.5 * ((columns - 45.0) / 60.0) ** 2)
    return FaultMotion(frame, (-80.0, 0.0), height, np.zeros_like(height), thrown, (0.0, 0.4), 1, 0.0)


def strained(rng: np.random.Generator, motions: list[FaultMotion], *, scatter: float = 0.01) -> LayerSlopes:
    """Slopes of layers of a gentle fold that these motions have strained."""
    points = np.stack(np.meshgrid(*(np.arange(4.0, SIZE, 5.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    near = np.min([np.abs(motion.side(points)) for motion in motions], axis=0)
    points = points[near > 5.0]

    def depth(shift: Float64Array) -> Float64Array:
        moved = points + shift
        dropped = sum(moved[:, 2] - motion.undo(moved)[:, 2] for motion in motions)
        i, x = moved[:, 0] - 40.0, moved[:, 1] - 60.0
        return np.asarray(dropped + (0.1 + 0.002 * moved[:, 2]) * i + 0.001 * i * x - 0.002 * x * x)

    steps = 0.5 * np.eye(3)[:2]
    slopes = np.stack([depth(step) - depth(-step) for step in steps])
    return LayerSlopes(points, (slopes + scatter * rng.standard_normal(slopes.shape)).astype(np.float32), 125)


@pytest.mark.parametrize(("lift", "decay"), [(1.0, 0.0), (1.0, 0.017), (0.5, 0.03), (0.7, 0.017), (0.5, 0.008)])
@pytest.mark.parametrize("throw", [20.0, -12.0])
def test_layers_tell_which_wall_moved_and_how_slip_dies_away(
    rng: np.random.Generator, lift: float, decay: float, throw: float
) -> None:
    fault = bell(throw=throw)
    layers = strained(rng, [replace(fault, lift=lift, decay=decay)])
    (told,) = tell_strains([fault], np.zeros(1, np.int64), layers, lambda _: SILENT, HISTORY)
    assert told.decay == decay
    # slopes beside the surface are taken over two traces
    assert told.lift == pytest.approx(lift, abs=0.06)


def test_faults_are_told_apart(rng: np.random.Generator) -> None:
    faults = [bell(), bell(across=(1.0, 0.0), throw=14.0), bell(at=20.0, throw=16.0)]
    true = [Strain(0.6, 0.023), Strain(1.0, 0.012), Strain(0.8, 0.017)]
    layers = strained(rng, [strain.of(fault) for strain, fault in zip(true, faults, strict=True)])
    told = tell_strains(faults, np.arange(3), layers, lambda _: SILENT, HISTORY)
    for found, strain in zip(told, true, strict=True):
        # the next of those tried, at most
        assert abs(found.decay - strain.decay) < 0.0075
        assert found.lift == pytest.approx(strain.lift, abs=0.1)


def test_parts_of_a_fault_have_one_strain(rng: np.random.Generator) -> None:
    whole = bell()
    rows = np.arange(160)[:, None]
    parts = [
        replace(whole, apart=np.broadcast_to(np.maximum(sign * (rows - 80.0), 0.0), whole.apart.shape).copy())
        for sign in (1.0, -1.0)
    ]
    layers = strained(rng, [replace(whole, lift=0.6, decay=0.017)])
    told = tell_strains(parts, np.zeros(2, np.int64), layers, lambda _: SILENT, HISTORY)
    assert told[0] == told[1]
    assert told[0].decay == 0.017
    assert told[0].lift == pytest.approx(0.6, abs=0.06)


def test_a_tenth_of_wrong_slopes_changes_little(rng: np.random.Generator) -> None:
    fault = bell()
    layers = strained(rng, [replace(fault, lift=0.6, decay=0.017)])
    layers.slopes[:, ::10] += rng.standard_normal(layers.slopes[:, ::10].shape).astype(np.float32)
    (told,) = tell_strains([fault], np.zeros(1, np.int64), layers, lambda _: SILENT, HISTORY)
    assert told.decay == 0.017
    assert told.lift == pytest.approx(0.6, abs=0.1)


def test_where_nothing_tells_the_hanging_wall_moved_as_a_whole(rng: np.random.Generator) -> None:
    assert tell_strains([], np.zeros(0, np.int64), NOWHERE, lambda _: SILENT, HISTORY) == []
    assert tell_strains([bell()], np.zeros(1, np.int64), NOWHERE, lambda _: SILENT, HISTORY) == [Strain()]
    # a throw that is the same everywhere bends nothing
    level = replace(bell(), throw=np.full((160, SIZE), 20.0))
    layers = strained(rng, [replace(level, lift=0.5)])
    (told,) = tell_strains([level], np.zeros(1, np.int64), layers, lambda _: SILENT, HISTORY)
    assert told.decay == 0.0
    assert told.lift == pytest.approx(1.0, abs=0.02)


def test_of_many_faults_fewer_places_are_used(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    fault = bell()
    layers = strained(rng, [replace(fault, lift=0.5, decay=0.023)])
    monkeypatch.setattr(layer_strain, "_MOST", 4 * 7 * len(layers.points) // 4)
    seen: list[int] = []
    products = layer_strain.sum_products
    monkeypatch.setattr(
        layer_strain, "sum_products", lambda terms, *more: seen.append(terms.shape[1]) or products(terms, *more)
    )
    (told,) = tell_strains([fault], np.zeros(1, np.int64), layers, lambda _: SILENT, HISTORY)
    assert max(seen) <= 2 * (len(layers.points) // 4 + 1)
    assert told.decay == 0.023
    assert told.lift == pytest.approx(0.5, abs=0.1)


def beside(
    rng: np.random.Generator, decay: float, *, side: int = 1, lift: float = 1.0, scatter: float = 0.02
) -> tuple[SheetThrow, SheetSides, int]:
    """A fault whose throw grows along strike, with layers that dip everywhere and tilt by its slip."""
    columns = (SHAPE[1] - 1) // STEP + 1
    throw = np.broadcast_to(np.linspace(4.0, 16.0, SHAPE[0])[:, None], (SHAPE[0], columns)).astype(np.float32)
    tilts = 0.3 + scatter * rng.standard_normal((2, *SHAPE))
    moved = decay * throw[:, :1]
    hanging, foot = (1, 0) if side > 0 else (0, 1)
    # layers of the hanging wall rise away from the fault, those of the footwall fall away
    tilts[hanging] -= side * lift * moved
    tilts[foot] -= side * (1.0 - lift) * moved
    sides = SheetSides(np.zeros((2, *SHAPE), np.float32), np.ones((2, *SHAPE), np.float32), tilts.astype(np.float32))
    return SheetThrow(throw, np.ones(throw.shape, np.float32), side), sides, STEP


def told_beside(*parts: tuple[SheetThrow, SheetSides, int]) -> Strain:
    strains = tell_strains([bell()] * len(parts), np.zeros(len(parts), np.int64), NOWHERE, lambda n: parts[n], HISTORY)
    assert len(set(strains)) == 1
    return strains[0]


@pytest.mark.parametrize("side", [1, -1])
def test_tilts_beside_a_fault_tell_how_slip_dies_away(rng: np.random.Generator, side: int) -> None:
    assert told_beside(beside(rng, 0.023, side=side)) == Strain(1.0, 0.023)
    assert told_beside(beside(rng, 0.01, side=side), beside(rng, 0.024, side=side)).decay in (0.012, 0.017, 0.023)
    assert told_beside(beside(rng, 0.2, side=side)).decay == 0.03


def test_level_layers_and_what_says_nothing_beside_a_fault(rng: np.random.Generator) -> None:
    assert told_beside(beside(rng, 0.0)) == Strain()
    # both walls tilt alike
    assert told_beside(beside(rng, 0.02, lift=0.5)) == Strain()
    # layers that rise towards the fault are no slip that dies away
    assert told_beside(beside(rng, -0.02)) == Strain()
    throw, sides, step = beside(rng, 0.02)
    assert told_beside((replace(throw, fit=0.0 * throw.fit), sides, step)) == Strain()
    assert told_beside((throw, sides._replace(known=0.0 * sides.known), step)) == Strain()


def test_slip_that_hardly_changes_along_a_fault_does_not_die_away_off_it(rng: np.random.Generator) -> None:
    throw, sides, step = beside(rng, 0.023)
    uneven = (throw.throw[:, 0].max() * 0.95 - throw.throw.min()) / 9.5
    assert measure_evenness([throw]) == pytest.approx((throw.throw.min() + uneven) / 15.4, abs=0.02)
    even = replace(throw, throw=np.full_like(throw.throw, 10.0))
    assert measure_evenness([even, even]) == 1.0
    # places that do not match tell nothing of it
    torn = replace(throw, fit=np.where(throw.throw < 10.0, 0.0, throw.fit).astype(np.float32))
    assert measure_evenness([torn]) > measure_evenness([throw])
    assert np.isnan(measure_evenness([replace(throw, fit=0.0 * throw.fit)]))
    tilts = sides.tilts.copy()
    tilts[1] = 0.3 - 0.23
    tilts[0] = 0.3
    assert told_beside((even, sides._replace(tilts=tilts), step)) == Strain()
    steeper = replace(HISTORY, even=1.0)
    told = tell_strains(
        [bell()], np.zeros(1, np.int64), NOWHERE, lambda _: (even, sides._replace(tilts=tilts), step), steeper
    )
    assert told == [Strain()]
    less = replace(even, throw=np.where(np.arange(SHAPE[0])[:, None] < 8, 9.0, even.throw).astype(np.float32))
    assert (
        tell_strains(
            [bell()], np.zeros(1, np.int64), NOWHERE, lambda _: (less, sides._replace(tilts=tilts), step), steeper
        )[0].decay
        == 0.023
    )


def test_wrong_tilts_beside_a_fault_count_for_little(rng: np.random.Generator) -> None:
    throw, sides, step = beside(rng, 0.023)
    tilts = sides.tilts.copy()
    tilts[:, ::5] = 2.0 * rng.standard_normal(tilts[:, ::5].shape)
    assert told_beside((throw, sides._replace(tilts=tilts), step)).decay in (0.017, 0.023)


def test_each_wall_is_moved_back_by_its_share_and_less_farther_off() -> None:
    level = np.zeros((20, 20))
    frame = Frame(np.zeros(2), np.array([0.0, 1.0]))
    motion = FaultMotion(frame, (-19.0, 0.0), level, level, level + 8.0, (0.0, 0.0), 1, 0.25, decay=0.02)
    points = np.array([[5.0, off, 15.0] for off in (0.001, 10.0, 50.0, 100.0, 200.0, -0.001, -10.0, -100.0)])
    left = np.array([1.0, 0.81, 0.25, 0.0, 0.0, 1.0, 0.81, 0.0])
    wall = np.where(points[:, 1] > 0.0, 1.0, 0.0)
    for lift in (1.0, 0.7):
        back = replace(motion, lift=lift).undo(points)
        dropped = 8.0 * left * (lift + wall - 1.0)
        np.testing.assert_allclose(points[:, 2] - back[:, 2], dropped, atol=1e-3)
        # the strike runs against inlines
        np.testing.assert_allclose(points[:, 0] - back[:, 0], -0.25 * dropped, atol=1e-3)
        np.testing.assert_allclose(points[:, 1], back[:, 1], atol=1e-9)


@pytest.mark.parametrize(("most", "spacing"), [(10**6, 4), (100, 8)])
def test_blocks_keep_the_slopes_of_the_whole(
    rng: np.random.Generator, most: int, spacing: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(layer_strain, "_MOST_PLACES", most)
    shape = (37, 42, 53)
    slopes = tuple(rng.standard_normal(shape).astype(np.float32) for _ in range(2))
    valid = rng.random(shape) > 0.1
    w = np.full((60, 27), 3.0, np.float32)
    sheet = Sheet(np.array([20.0, 18.0]), np.array([0.6, 0.8]), 0, 2, -30.0, w, np.ones_like(w))
    whole = sample_slopes((slopes[0], slopes[1]), valid, [sheet], shape)
    i, x, s = whole.points.astype(int).T
    np.testing.assert_array_equal(whole.slopes, [slope[i, x, s] for slope in slopes])
    assert valid[i, x, s].all()
    off = (whole.points[:, :2] - sheet.origin) @ sheet.across - 3.0
    assert np.abs(off).min() > 4.0
    assert set(i % spacing) == set(x % spacing) == set(s % (2 * spacing)) == {0}
    assert s.min() == 2 * spacing
    assert s.max() < 45
    assert len(s) < most
    found = []
    for i0, i1 in ((0, 10), (10, 37)):
        for x0, x1 in ((0, 21), (21, 42)):
            box = np.s_[i0:i1, x0:x1]
            found.append(sample_slopes((slopes[0][box], slopes[1][box]), valid[box], [sheet], shape, corner=(i0, x0)))
    joined = join_slopes(found)
    np.testing.assert_array_equal(joined.points, whole.points)
    np.testing.assert_array_equal(joined.slopes, whole.slopes)
    assert joined.voxels == whole.voxels == spacing**2 * 2 * spacing


def test_products_are_numpy_s_and_do_not_depend_on_threads(rng: np.random.Generator) -> None:
    terms, values = rng.standard_normal((9, 501)).astype(np.float32), rng.standard_normal(501).astype(np.float32)
    weights = rng.random(501)
    found = []
    for n_threads in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        before = numba.get_num_threads()
        numba.set_num_threads(n_threads)
        matrix, right = np.empty((9, 9)), np.empty(9)
        energy = sum_products(terms, values, weights, matrix, right)
        numba.set_num_threads(before)
        found.append((matrix, right, energy))
    wide = terms.astype(np.float64)
    np.testing.assert_allclose(found[0][0], (wide * weights) @ wide.T, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(found[0][1], (wide * weights) @ values, rtol=1e-6, atol=1e-5)
    assert found[0][2] == pytest.approx(float((weights * values.astype(np.float64) ** 2).sum()), rel=1e-6)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_older_faults_are_measured_better_where_strain_is_told() -> None:
    cube = fault_cube("folded", shape=(128, 128, 128), seed=203)  # three of five faults have a drag
    within = []
    for history in (HISTORY, replace(HISTORY, decay_odds=1e9, lift_spread=1e-6)):
        faults = s3.trace_faults(cube.seismic, settings=replace(FaultSettings(), history=history))
        within.append(throw_score(faults.labels, faults.throw, cube.faults, cube.throw).within)
    assert within[0] > within[1] + 0.04
