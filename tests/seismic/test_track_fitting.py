"""Parts of a track found and placed, on layers laid out by hand: what layer time has wrong, waveforms put right."""

from __future__ import annotations

import numpy as np
import pytest
from laid_out_layers import SHAPE, THROW, WALL, lay_out
from scipy.ndimage import gaussian_filter1d

from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.track_fitting import _choose_upper, find_counting, fit_track
from seismo3d.seismic.track_refining import TrackSettings

SEED = 60.0


def track(layers: LayerModel, j: int, z: float = SEED) -> np.ndarray:
    """Return the depth, in the mean over inlines, of the track through one seed; NaN where half of it is missing."""
    depth, *_ = fit_track(layers, np.array([[20.0, float(j), z]]), TrackSettings())
    found = np.isfinite(depth).mean(axis=0) > 0.5
    return np.where(found, np.nanmedian(np.where(np.isfinite(depth), depth, SEED), axis=0), np.nan)


@pytest.fixture
def shift() -> np.ndarray:
    return np.where(np.arange(SHAPE[1]) < WALL, 0.0, THROW)


@pytest.mark.parametrize(("first", "last", "bridged"), [(56, 64, True), (30, 90, False)])
def test_short_gaps_are_bridged_and_long_ones_left_out(
    rng: np.random.Generator, first: int, last: int, bridged: bool
) -> None:
    layers = lay_out(rng, np.zeros(SHAPE[1]), np.arange(SHAPE[2], dtype=np.float64), cut=False)
    layers.valid[10:30, 10:30, first:last] = False
    layers.volume[~layers.valid] = 0.0
    depth, confidence, _ = fit_track(layers, np.array([[4.0, 4.0, SEED]]), TrackSettings())
    assert np.isfinite(depth[:8, :8]).all()
    assert (np.isfinite(depth[12:28, 12:28]) == bridged).all()
    assert (np.isfinite(depth) == np.isfinite(confidence)).all()


def test_a_part_ends_at_a_fault_that_was_missed(rng: np.random.Generator, shift: np.ndarray) -> None:
    level = np.arange(SHAPE[2], dtype=np.float64)
    found = track(lay_out(rng, shift, level, cut=False), 8)
    np.testing.assert_allclose(found, SEED + shift, atol=0.3)


def test_layers_that_only_bend_are_one_part(rng: np.random.Generator) -> None:
    bent = 6.0 * np.sin(np.arange(SHAPE[1]) / 8.0)
    times = np.arange(SHAPE[2]) - bent[:, None]
    found = track(lay_out(rng, bent, times, cut=False), 8, SEED + bent[8])
    np.testing.assert_allclose(found, SEED + bent, atol=0.3)


def test_a_part_whose_layer_time_is_off_and_strained_is_put_right(rng: np.random.Generator, shift: np.ndarray) -> None:
    samples = np.arange(SHAPE[2])
    far = SEED + 0.55 * (samples - SEED - THROW) + 3.0
    times = np.where(np.arange(SHAPE[1])[:, None] < WALL, samples, far)
    found = track(lay_out(rng, shift, times, cut=True), 8)
    np.testing.assert_allclose(found, SEED + shift, atol=0.3)


@pytest.mark.parametrize("gap", [0, 3])
def test_a_track_ends_at_a_fault_beyond_which_no_layers_are_its_own(rng: np.random.Generator, gap: int) -> None:
    """Of unrelated layers some fit by chance, some nearly; nor is the track led to them through a gap in the fault."""
    flat, samples = np.zeros(SHAPE[1]), np.arange(SHAPE[2], dtype=np.float64)
    crossed = 0
    for _ in range(10):
        layers = lay_out(rng, flat, samples, cut=True)
        layers.volume[:, WALL:] = lay_out(rng, flat, samples, cut=True).volume[:, WALL:]
        layers.cuts[:gap] = 0
        depth, *_ = fit_track(layers, np.array([[20.0, 8.0, SEED]]), TrackSettings())
        assert np.isfinite(depth[:, :WALL]).all()
        crossed += np.isfinite(depth[gap:, WALL:]).any()
    assert crossed <= 3


def test_confidence_is_low_where_a_fault_leaves_too_little_of_a_trace_to_be_compared(rng: np.random.Generator) -> None:
    layers = lay_out(rng, np.zeros(SHAPE[1]), np.arange(SHAPE[2], dtype=np.float64), cut=False)
    beside = slice(28, 34)
    # a fault below the horizon, and above it one that is half a window off
    layers.cuts[:, beside, 62] |= 4
    layers.cuts[:, beside, 50] |= 4
    depth, confidence, _ = fit_track(layers, np.array([[20.0, 8.0, SEED]]), TrackSettings())
    assert np.isfinite(depth).all()
    assert (confidence[:, beside] < 0.5).all()
    assert (confidence[:, :25] > 0.9).all()


def test_layers_that_are_thinner_around_a_seed_near_the_end_of_the_cube_move_nothing(rng: np.random.Generator) -> None:
    """The end of the cube cuts the seeds' waveform short: what it lacks is no quiet interval."""
    seed, thinner, off = SHAPE[2] - 5.5, 1.17, 16.5
    left, samples = np.arange(SHAPE[1]) < WALL, np.arange(SHAPE[2], dtype=np.float64)
    times = np.where(left[:, None], seed + thinner * (samples - seed), samples + off)
    layers = lay_out(rng, np.zeros(SHAPE[1]), times, cut=True)
    along = np.arange(-60.0, 200.0)
    errors = []
    for _ in range(8):
        amplitudes = gaussian_filter1d(rng.normal(size=len(along)), 2.0)
        layers.volume[...] = np.interp(times, along, amplitudes / amplitudes.std())
        found = track(layers, 8, seed)
        np.testing.assert_allclose(found[: WALL - 3], seed, atol=0.3)
        errors.append(np.abs(found[WALL + 3 :] - seed + off).max())
    assert np.mean(errors) < 0.25


def test_a_seed_beside_a_fault_holds_the_track_where_its_own_waveform_lies(
    rng: np.random.Generator, shift: np.ndarray
) -> None:
    """Drag bends the layers at the wall, where the track goes straight on; all else must not be off by the bend."""
    j = np.arange(SHAPE[1])
    drag = np.where((j >= WALL - 4) & (j < WALL), 0.4 * (j - (WALL - 5)), 0.0)
    times = np.arange(SHAPE[2]) - (shift + drag)[:, None]
    layers = lay_out(rng, shift + drag, times, cut=True)
    found = track(layers, WALL - 2, SEED + drag[WALL - 2])
    away = np.abs(j - WALL + 0.5) > 6
    np.testing.assert_allclose(found[away], (SEED + shift)[away], atol=0.4)
    depth, *_ = fit_track(layers, np.array([[20.0, WALL - 2.0, SEED + drag[WALL - 2]]]), TrackSettings())
    assert depth[20, WALL - 2] == pytest.approx(SEED + drag[WALL - 2], abs=1e-9)


def test_all_parts_that_layer_time_has_farther_off_than_they_are_moved_are_put_right(rng: np.random.Generator) -> None:
    """Beyond the fault beside the seed's few traces a part is placed at the best in reach, which is not its place."""
    wall, off = 16, 20.0
    there = np.arange(SHAPE[1]) >= wall
    shift, samples = np.where(there, THROW, 0.0), np.arange(SHAPE[2])
    times = np.where(there[:, None], samples - THROW - off, samples)
    layers = lay_out(rng, shift, times, cut=False, noise=0.01)
    layers.cuts[:, wall - 1] = 2
    # layers that repeat themselves: the right place fits, and one that is nearer fits nearly
    period = np.cos(2.0 * np.pi * (samples - shift[:, None]) / 12.5)
    layers.volume[...] = 0.42 * layers.volume + 1.5 * period
    found = track(layers, 8)
    np.testing.assert_allclose(found, SEED + shift, atol=0.3)


@pytest.mark.parametrize("j", [6, 10, 14])
def test_noise_at_the_seed_does_not_move_the_track(rng: np.random.Generator, shift: np.ndarray, j: int) -> None:
    """Noise as strong as the signal: one trace alone tells its place to a sample or two."""
    layers = lay_out(rng, shift, np.arange(SHAPE[2]) - shift[:, None], cut=True)
    layers.volume[:] += rng.normal(0.0, float(layers.volume.std()), layers.volume.shape)
    found = track(layers, j)
    away = np.abs(np.arange(SHAPE[1]) - WALL + 0.5) > 2
    assert np.abs(found - SEED - shift)[away].mean() < 0.5


@pytest.mark.parametrize("others", [[8, 14], [4, 8, 12, 14]])
def test_a_stray_among_seeds_that_agree_does_not_count(
    rng: np.random.Generator, shift: np.ndarray, others: list[int]
) -> None:
    layers = lay_out(rng, shift, np.arange(SHAPE[2]) - shift[:, None], cut=True)
    seeds = np.array([[20.0, float(j), SEED] for j in others] + [[10.0, 6.0, SEED + 20.0]])
    depth, _, alone = fit_track(layers, seeds, TrackSettings())
    np.testing.assert_allclose(np.nanmedian(depth, axis=0), SEED + shift, atol=0.3)
    assert abs(depth[10, 6] - SEED) < 0.3
    assert not len(alone)


def test_a_seed_that_nothing_around_bears_out_is_held_alone_and_told(
    rng: np.random.Generator, shift: np.ndarray
) -> None:
    """A box of seven traces where the layers are lost in noise: what lies at the seed there goes on nowhere."""
    layers = lay_out(rng, shift, np.arange(SHAPE[2]) - shift[:, None], cut=True)
    layers.volume[17:24, 3:10] = rng.normal(0.0, 1.0, (7, 7, SHAPE[2]))
    layers.cuts[17:24, 3:10] = 7
    seed = np.array([[20.0, 6.0, SEED + 9.5]])
    depth, confidence, alone = fit_track(layers, seed, TrackSettings())
    np.testing.assert_array_equal(alone, [0])
    assert depth[20, 6] == seed[0, 2]
    assert confidence[20, 6] == 0.0


def test_a_seed_beyond_a_fault_is_no_stray(rng: np.random.Generator, shift: np.ndarray) -> None:
    """There it tells how far layer time is off."""
    times = np.broadcast_to(np.arange(SHAPE[2]), SHAPE[1:]).astype(np.float64)
    seeds = np.array([[20.0, 8.0, SEED], [10.0, 14.0, SEED], [20.0, WALL + 6.0, SEED + THROW]])
    assert find_counting(lay_out(rng, shift, times, cut=True), seeds).all()


def test_where_a_layer_lies_over_itself_the_upper_one_counts_but_around_a_seed_below() -> None:
    crossings = np.full((3, 12, 20), np.nan)
    parts = np.full(crossings.shape, -1)
    # a reverse fault: one side from 0 to 11 at 60, the other from 8 to 19 at 50; and again along the far inlines
    crossings[0, :, :8], parts[0, :, :8] = 60.0, 0
    crossings[0, :, 8:], parts[0, :, 8:] = 50.0, 1
    crossings[1, :, 8:12], parts[1, :, 8:12] = 60.0, 0
    crossings[1, 6, 8:12], parts[1, 6, 8:12] = np.nan, -1
    own = np.array([0])
    depth, chosen = _choose_upper(crossings, parts, own, np.array([[5.0, 3.0, 60.0]]))
    np.testing.assert_array_equal(depth, np.where(np.arange(20) < 8, 60.0, 50.0)[None].repeat(12, axis=0))
    np.testing.assert_array_equal(chosen, (depth == 50.0).astype(int))
    depth, chosen = _choose_upper(crossings, parts, own, np.array([[2.0, 9.0, 60.8]]))
    below = np.zeros((12, 20), bool)
    below[:6, :12] = below[6:, :8] = True
    np.testing.assert_array_equal(depth, np.where(below, 60.0, 50.0))
    # a seed where the upper one begins, or has begun a trace farther on
    depth, _ = _choose_upper(crossings, parts, own, np.array([[2.0, 8.0, 60.8]]))
    below[:] = np.arange(20) < 8
    below[1:4, 8:10] = True
    np.testing.assert_array_equal(depth, np.where(below, 60.0, 50.0))
    # a seed on the upper one
    depth, _ = _choose_upper(crossings, parts, np.array([1]), np.array([[2.0, 9.0, 50.8]]))
    assert (depth[:, 8:] == 50.0).all()
