"""Seeds that touch a fault, on layers laid out by hand: where they are moved to, and which stay."""

from __future__ import annotations

import numpy as np
import pytest
from laid_out_layers import SHAPE, THROW, WALL, lay_out

from seismo3d.seismic.inner_seeds import move_inwards
from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.track_fitting import fit_track
from seismo3d.seismic.track_refining import TrackSettings

LEVEL = 60.0
J = np.arange(SHAPE[1])


def tilted(rng: np.random.Generator, slope: float = 0.3, bend: float = 0.0) -> LayerModel:
    """Layers that fall along crosslines and are thrown at the wall; layer time is bent on the two traces before it."""
    shift = slope * J + np.where(J < WALL, 0.0, THROW)
    wrong = bend * (J == WALL - 2) + 2.0 * bend * (J == WALL - 1)
    return lay_out(rng, shift, np.arange(SHAPE[2]) - (shift + wrong)[:, None], cut=True)


def seed_at(j: int, *, slope: float = 0.3) -> np.ndarray:
    """Return a seed on the layer of one time."""
    return np.array([[20.0, j, LEVEL + slope * j + (THROW if j >= WALL else 0.0)]])


@pytest.mark.parametrize("j", [WALL - 1, WALL])
def test_a_seed_at_a_fault_is_moved_along_its_layer_on_its_own_side(rng: np.random.Generator, j: int) -> None:
    seed = seed_at(j)
    (moved,) = move_inwards(tilted(rng), seed)
    assert (moved[1] < WALL) == (j < WALL)
    assert 3.0 < abs(moved[1] - j) <= 8.0  # the nearest place off the fault, not the farthest of the block
    assert moved[2] - seed[0, 2] == pytest.approx(0.3 * (moved[1] - j), abs=1e-3)


def test_layer_time_that_is_bent_at_the_fault_does_not_count(rng: np.random.Generator) -> None:
    straight, bent = (move_inwards(tilted(rng, bend=bend), seed_at(WALL - 1)) for bend in (0.0, 1.5))
    np.testing.assert_allclose(bent, straight, atol=1e-3)


def test_where_layers_thicken_the_seed_keeps_its_layer(rng: np.random.Generator) -> None:
    layers = tilted(rng, slope=0.0)
    layers.times[...] = LEVEL + (np.arange(SHAPE[2]) - LEVEL) / (1.0 + 0.01 * (J - WALL + 1))[:, None]
    (moved,) = move_inwards(layers, seed_at(WALL - 1, slope=0.0))
    assert moved[2] == pytest.approx(LEVEL, abs=0.02)


@pytest.mark.parametrize("j", [0, 8, WALL - 2, WALL + 1, SHAPE[1] - 1])
def test_a_seed_off_the_fault_stays(rng: np.random.Generator, j: int) -> None:
    for z in (0.0, 60.25, SHAPE[2] - 1.0):
        seed = np.array([[20.0, float(j), z]])
        np.testing.assert_array_equal(move_inwards(tilted(rng), seed), seed)


def test_a_seed_on_a_sliver_or_between_dead_traces_stays(rng: np.random.Generator) -> None:
    sliver = tilted(rng)
    sliver.cuts[:, WALL - 4] = 2
    dead = tilted(rng)
    dead.live[:, : WALL - 1] = False
    for layers in (sliver, dead):
        np.testing.assert_array_equal(move_inwards(layers, seed_at(WALL - 1)), seed_at(WALL - 1))


def test_a_fault_that_passes_below_a_seed_counts_as_well(rng: np.random.Generator) -> None:
    layers = tilted(rng)
    layers.cuts[...] = 0
    layers.cuts[:, : WALL - 4, int(LEVEL) + 10] = 4
    seed = np.array([[20.0, 12.0, LEVEL + 9.6]])
    (moved,) = move_inwards(layers, seed)
    # farther along the layer, which falls away from the level fault only towards lower crosslines
    assert moved[1] < 12.0
    assert moved[2] - seed[0, 2] == pytest.approx(0.3 * (moved[1] - 12.0), abs=1e-3)


@pytest.mark.parametrize("bend", [1.5, -1.5])
def test_layer_time_bent_at_the_fault_does_not_lead_the_track_astray(rng: np.random.Generator, bend: float) -> None:
    seed = seed_at(WALL - 1)
    depth, *_ = fit_track(tilted(rng, bend=bend), seed, TrackSettings())
    away = np.abs(J - WALL + 0.5) > 4
    expected = LEVEL + 0.3 * J + np.where(J < WALL, 0.0, THROW)
    np.testing.assert_allclose(np.nanmedian(depth[:, away], axis=0), expected[away], atol=0.3)
    assert depth[20, WALL - 1] == pytest.approx(seed[0, 2], abs=1e-9)
