from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from seismo3d.seismic.displacements import carry_amplitudes, follow_on, places_before, solve_jumps


def test_a_jump_across_a_whole_plane_moves_two_blocks() -> None:
    shape = (12, 10, 9)
    tails = np.arange(np.prod(shape)).reshape(shape)[5].ravel()  # edges along inlines have no offset
    jumps = np.tile([0.0, 1.0, -2.0], (len(tails), 1))
    found, missing = solve_jumps(tails, jumps, shape, n_steps=60, tolerance=0.001)
    assert missing <= 0.001
    across = found[:, 6] - found[:, 5]
    np.testing.assert_allclose(across, np.broadcast_to(np.array([0, 1, -2])[:, None, None], across.shape), atol=0.01)
    assert np.abs(np.diff(found[:, :6], axis=1)).max() < 0.4
    np.testing.assert_allclose(found.mean(axis=(1, 2, 3)), 0.0, atol=1e-5)


def test_without_jumps_nothing_moves() -> None:
    found, missing = solve_jumps(np.empty(0, np.int64), np.empty((0, 3)), (6, 5, 7), n_steps=3, tolerance=0.1)
    assert missing == 0.0
    assert not found.any()


def test_steps_follow_each_other_and_places_are_found_again(rng: np.random.Generator) -> None:
    i, j, k = np.indices((16, 15, 14), dtype=np.float32)
    one = 0.5 * np.stack([np.sin(j / 4), np.cos(k / 5), np.sin(i / 3)])
    twice = follow_on(np.full_like(one, 0.25), one)
    np.testing.assert_allclose(twice, one + 0.25, atol=1e-6)
    before = rng.uniform(4.0, 10.0, size=(30, 3))
    after = before + np.stack([_read(part, before) for part in one], axis=1)
    np.testing.assert_allclose(places_before(one, after), before, atol=1e-3)


def _read(volume: np.ndarray, places: np.ndarray) -> np.ndarray:
    return np.asarray(ndimage.map_coordinates(volume, places.T, order=1))


def test_places_in_the_cells_of_outer_traces_have_their_amplitudes(rng: np.random.Generator) -> None:
    cube = rng.normal(size=(8, 9, 10)).astype(np.float32)
    for shift, n_lost in ((1e-7, 0), (-1e-7, 0), (0.49, 0), (0.51, 1), (-1.6, 2)):
        for axis in range(3):
            field = np.zeros((3, *cube.shape), np.float32)
            field[axis] = shift
            found = np.moveaxis(carry_amplitudes(cube, field), axis, 0)[:: 1 if shift < 0 else -1]
            wanted = np.moveaxis(cube, axis, 0)[:: 1 if shift < 0 else -1]
            assert (found[:n_lost] == 0.0).all()
            assert (found[n_lost:] != 0.0).all()
            if n_lost == 0:
                np.testing.assert_allclose(found[0], wanted[0], atol=1e-5)


@pytest.mark.parametrize("power", [-100, 40, 125])
def test_amplitudes_of_any_size_are_carried_alike(rng: np.random.Generator, power: int) -> None:
    values = rng.uniform(-1.0, 1.0, size=(6, 7, 20)).astype(np.float32)
    shift = rng.normal(scale=0.7, size=(3, *values.shape)).astype(np.float32)
    carried = carry_amplitudes(np.ldexp(values, power), shift)
    np.testing.assert_array_equal(carried, np.ldexp(carry_amplitudes(values, shift), power))
    largest = carry_amplitudes(np.sign(values) * np.finfo(np.float32).max, shift)
    assert np.isfinite(largest).all()
