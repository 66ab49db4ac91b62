from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube as make_plain_cube
from fake_faults import make_faults

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.seismic.stick_tracking import follow_stick
from seismo3d.synthetic import CubeRecipe, SyntheticCube, SyntheticFault, make_cube

SHAPE = (40, 48, 64)


@pytest.fixture(scope="module")
def faulted() -> SyntheticCube:
    fault = SyntheticFault((20, 24, 32), 15.0, 68.0, 9.0)
    recipe = CubeRecipe(shape=SHAPE, wavelength=(10.0, 10.0), population=None, faults=(fault,))
    return make_cube(recipe, seed=2030)


def crossing(cube: SyntheticCube, inline: int) -> np.ndarray:
    """Where the true fault crosses an inline: crossline at every sample, by a straight fit to its voxels."""
    j, k = np.nonzero(cube.faults[inline])
    return np.polyval(np.polyfit(k, j, 1), np.arange(SHAPE[2]))


def picked(cube: SyntheticCube, inline: int, *, low: int = 16, high: int = 48) -> np.ndarray:
    line = crossing(cube, inline)
    return np.array([[inline, line[k], k] for k in (low, (low + high) // 2, high)], dtype=float)


def test_stick_follows_the_fault_to_both_ends_of_the_cube(faulted: SyntheticCube) -> None:
    found = follow_stick(faulted.seismic, picked(faulted, 20))
    slices = [int(stick.lines[0, 0]) for stick in found]
    assert slices == list(range(slices[0], slices[-1] + 1))
    assert slices[0] <= 3
    assert slices[-1] >= 36
    errors = []
    for stick in found:
        truth = crossing(faulted, int(stick.lines[0, 0]))
        errors.append(np.abs(stick.points[:, 1] - np.interp(stick.points[:, 2], np.arange(SHAPE[2]), truth)).max())
    assert np.percentile(errors[3:-3], 90) < 2.0
    assert [stick.number for stick in found] == list(range(1, len(found) + 1))


def test_a_muted_top_leaves_the_stick_below_it_alone(faulted: SyntheticCube) -> None:
    muted = faulted.seismic.copy()
    muted[:, :, :12] = np.nan
    muted[5, 10, 30:34] = np.nan
    whole, found = (follow_stick(cube, picked(faulted, 20, low=24), farthest=8) for cube in (faulted.seismic, muted))
    assert [stick.lines[0, 0] for stick in found] == [stick.lines[0, 0] for stick in whole]
    for one, other in zip(found, whole, strict=True):
        wanted = np.interp(one.points[:, 2], other.points[:, 2], other.points[:, 1])
        # bends a sample or two from the mute, but nowhere to another break
        np.testing.assert_allclose(one.points[:, 1], wanted, atol=1.0)


def test_stick_on_a_crossline_is_followed_along_the_crosslines(faulted: SyntheticCube) -> None:
    turned = np.ascontiguousarray(faulted.seismic.transpose(1, 0, 2))
    nodes = picked(faulted, 20)[:, [1, 0, 2]]
    found = follow_stick(turned, nodes, farthest=8)
    assert [int(stick.lines[0, 1]) for stick in found] == list(range(12, 29))


def broken(throw: np.ndarray) -> np.ndarray:
    """A cube of flat layers, thrown trace by trace."""
    layers = np.convolve(np.random.default_rng(7).normal(size=80), [0.25, 0.5, 0.25], mode="same")
    return np.stack([[layers[8 + t : 72 + t] for t in row] for row in throw]).astype(np.float32)


VERTICAL = np.array([[18.0, 20.0, 12.0], [18.0, 20.0, 52.0]])
INLINE, CROSSLINE = np.meshgrid(np.arange(36), np.arange(40), indexing="ij")


@pytest.mark.parametrize("inline", [18.0, 18.4])
def test_a_vertical_stick_is_followed_on_the_way_that_its_fault_runs(inline: float) -> None:
    nodes = VERTICAL + np.array([inline - 18.0, 0.0, 0.0])
    along_crosslines = follow_stick(broken(5 * (INLINE > 17)), nodes)
    assert [stick.lines[0, 1] for stick in along_crosslines] == list(range(40))
    assert np.abs(np.vstack([stick.lines for stick in along_crosslines])[:, 0] - 17.5).max() < 1.5
    along_inlines = follow_stick(broken(5 * (CROSSLINE > 19)), nodes)
    assert [stick.lines[0, 0] for stick in along_inlines] == list(range(36))
    assert np.abs(np.vstack([stick.lines for stick in along_inlines])[:, 1] - 19.5).max() < 1.5


def test_a_vertical_stick_on_a_fault_askew_is_followed_either_way() -> None:
    found = follow_stick(broken(5 * (INLINE - 18 > CROSSLINE - 20)), VERTICAL)
    assert len(found) > 30
    assert all(np.abs(stick.lines[:, 0] - 18 - (stick.lines[:, 1] - 20)).max() < 2.0 for stick in found)


def test_a_vertical_stick_where_two_faults_cross_is_refused_and_a_tilted_one_is_not() -> None:
    cube = broken(5 * (INLINE > 17) + 3 * (CROSSLINE > 19))
    with pytest.raises(ParameterError, match=r"stick is vertical.*Tilt the stick by one line, or pick"):
        follow_stick(cube, VERTICAL)
    tilted = follow_stick(cube, VERTICAL + np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    assert [stick.lines[0, 0] for stick in tilted] == list(range(36))


def test_stick_ends_where_the_fault_does() -> None:
    cube = make_plain_cube()
    faults = make_faults(cube)
    likelihood = np.asarray(faults.likelihood).copy()
    likelihood[:] = 0.0
    for k in range(50):
        likelihood[:18, int(np.rint(20 + (k - 24.5) * 0.5)), k] = 0.8
    known = replace(faults, likelihood=cube.copy(data=likelihood))
    nodes = [[110.0, 500 + 20 + (k - 24.5) * 0.5, 1000.0 + 4.0 * k] for k in (10, 40)]
    found = follow_stick(cube, nodes, faults=known, name="east")
    lines = [stick.lines[0, 0] for stick in found]
    assert lines[0] == 100.0
    assert lines[-1] == pytest.approx(100.0 + 2 * 17, abs=2.0)
    assert {stick.fault for stick in found} == {"east"}
    own = next(stick for stick in found if stick.lines[0, 0] == 110.0)
    assert own.points[0, 2] == 1040.0
    assert own.points[-1, 2] == 1160.0


def test_stick_that_leaves_through_the_side_is_kept_to_the_last_slice_that_it_crosses() -> None:
    cube = make_plain_cube()
    likelihood = np.zeros(cube.shape, np.float32)
    for i in range(16):
        likelihood[i, int(np.rint(20 + 1.8 * (i - 5)))] = 1.0
    known = replace(make_faults(cube), likelihood=cube.copy(data=likelihood))
    found = follow_stick(cube, [[110.0, 520.0, 1040.0], [110.0, 520.0, 1160.0]], faults=known, least=0.7)
    assert found[-1].lines[0, 0] == 130.0


def test_refusals(faulted: SyntheticCube) -> None:
    cube: Any = faulted.seismic
    nodes = picked(faulted, 20)
    with pytest.raises(ShapeError, match="Give a cube"):
        follow_stick(cube[0], nodes)
    with pytest.raises(GeometryError, match="does not run downwards"):
        follow_stick(cube, nodes[::-1])
    with pytest.raises(GeometryError, match="one inline or on one"):
        follow_stick(cube, nodes + np.array([[0, 0, 0], [3, 5, 0], [6, 9, 0]]))
    with pytest.raises(GeometryError, match="leaves the cube"):
        follow_stick(cube, nodes + np.array([0, 40.0, 0]))
    with pytest.raises(GeometryError, match="four or more"):
        follow_stick(cube, nodes[:1] + np.array([[0, 0, 0], [0, 0, 2.0]]))
    with pytest.raises(ParameterError, match="least is 2"):
        follow_stick(cube, nodes, least=2.0)
    empty = replace(make_faults(make_plain_cube()), likelihood=np.zeros((30, 40, 50), np.float32))
    with pytest.raises(ParameterError, match="nothing breaks"):
        follow_stick(np.zeros((30, 40, 50), np.float32), [[5, 20, 10], [5, 22, 40]], faults=empty)
