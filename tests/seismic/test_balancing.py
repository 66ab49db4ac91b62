from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.balancing import find_depth_gain, find_trace_gains, trace_likeness, trace_strengths
from seismo3d.seismic.preparing import clean_volume, find_scaling, sampling_step

N_SAMPLES = 400


def some_of(decay_db, *, n_samples=N_SAMPLES, first=0, rng=None):
    """Amplitudes at random depths from the first on, that fall by so many decibels from the top to the foot."""
    rng = rng or np.random.default_rng(4)
    depths = rng.integers(first, n_samples, 40_000)
    values = rng.normal(size=len(depths)) * 10.0 ** (-np.asarray(decay_db)[depths] / 20.0)
    return values.astype(np.float32), depths


def even(decay_db, n_samples=N_SAMPLES):
    return decay_db * np.arange(n_samples) / (n_samples - 1)


def in_db(gain):
    return 20.0 * np.log10(gain.astype(np.float64))


@pytest.mark.parametrize("decay", [20.0, 40.0, -60.0])
def test_an_even_decay_is_taken_off_but_for_a_little(decay):
    gain = find_depth_gain(*some_of(even(decay)), N_SAMPLES)
    assert gain.dtype == np.float32
    left = in_db(gain) - even(decay)
    assert np.ptp(left[16:-16]) == pytest.approx(12.0 * 12.0 / abs(decay), abs=1.0)
    # the middle of the cube stays as strong as it was
    assert in_db(gain)[N_SAMPLES // 2] == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize("decay", [0.0, 6.0, 10.5])
def test_a_small_decay_is_left_alone(decay):
    assert find_depth_gain(*some_of(even(decay)), N_SAMPLES) is None


def test_a_decay_that_ends_is_followed():
    decay = np.minimum(np.arange(1000) / 10.0, 40.0)
    gain = find_depth_gain(*some_of(decay, n_samples=1000), 1000)
    left = in_db(gain) - decay
    assert np.ptp(left) < 10.0
    assert np.ptp(left[600:]) < 4.0


def test_a_strong_reflector_is_no_decay():
    strong = np.zeros(N_SAMPLES)
    strong[190:210] = -30.0
    assert find_depth_gain(*some_of(strong), N_SAMPLES) is None


def test_what_is_muted_has_no_say():
    values, depths = some_of(even(40.0), first=150)
    gain = find_depth_gain(values, depths, N_SAMPLES)
    left = in_db(gain) - even(40.0)
    assert np.ptp(left[166:-16]) == pytest.approx(144.0 / (40.0 * 250 / 400), abs=1.0)
    assert np.isfinite(gain).all()


@pytest.mark.parametrize("noise_db", [40.0, 80.0])
def test_weak_noise_above_the_sea_floor_and_at_the_foot_has_no_say(noise_db):
    level = np.zeros(N_SAMPLES)
    level[:100] = level[330:] = noise_db
    assert find_depth_gain(*some_of(level), N_SAMPLES) is None
    falling = even(40.0)
    gain = find_depth_gain(*some_of(np.where(np.arange(N_SAMPLES) < 100, noise_db + 40.0, falling)), N_SAMPLES)
    left = in_db(gain)[120:-16] - falling[120:-16]
    assert np.ptp(left) < 7.0
    # nor is it raised
    assert in_db(gain)[:100].max() < in_db(gain)[120:140].mean() + 1.0


def test_to_the_ends_of_the_cube_the_decay_goes_on():
    gain = find_depth_gain(*some_of(even(60.0, 80), n_samples=80), 80)
    assert np.ptp(in_db(gain) - even(60.0, 80)) < 5.0


def test_a_decay_that_turns_is_followed():
    turning = 40.0 * np.abs(np.linspace(-1.0, 1.0, N_SAMPLES))
    gain = find_depth_gain(*some_of(turning), N_SAMPLES)
    assert np.ptp(in_db(gain) - turning) < 12.0


def test_spikes_have_no_say():
    values, depths = some_of(even(40.0))
    plain = find_depth_gain(values, depths, N_SAMPLES)
    values[::50] *= 1e6
    np.testing.assert_allclose(in_db(find_depth_gain(values, depths, N_SAMPLES)), in_db(plain), atol=0.5)


def test_nothing_asks_for_no_gain():
    nothing = np.zeros(0, np.float32), np.zeros(0, np.int64)
    assert find_depth_gain(*nothing, 50) is None
    assert find_scaling(*nothing, 50) == (0.0, 0.0, None)
    assert find_depth_gain(np.zeros(90, np.float32), np.arange(90), 90) is None
    assert find_depth_gain(np.ones(9, np.float32), np.full(9, 77), 90) is None


@pytest.mark.parametrize("level", [0.0, 128.0])
def test_a_cube_that_dies_away_is_made_ready_as_if_it_did_not(rng, level):
    trace = np.convolve(rng.normal(size=500), np.hanning(9), "same")[50:450]
    volume = trace + 0.05 * rng.normal(size=(24, 24, N_SAMPLES))
    plain, *_ = clean_volume(volume.astype(np.float32))
    weak = volume * 10.0 ** (-even(50.0) / 20.0) + level
    evened, valid, _, found = clean_volume(weak.astype(np.float32))
    assert valid.all()
    assert found == pytest.approx(level, abs=0.01)
    quarters = [slice(k, k + 100) for k in range(0, N_SAMPLES, 100)]
    strengths = np.array([[np.std(v[..., q]) for q in quarters] for v in (plain, evened)])
    np.testing.assert_allclose(strengths[1], strengths[0], rtol=0.35)
    for q in quarters:
        assert np.corrcoef(plain[..., q].ravel(), evened[..., q].ravel())[0, 1] > 0.95


@pytest.mark.parametrize("shape", [(1000, 1000, 1000), (500, 500, 500), (2000, 3000, 1500), (400, 300, 7), (3, 5, 8)])
def test_strength_is_told_from_many_depths(shape):
    step, n_samples = sampling_step(shape), shape[-1]
    depths = np.unique(np.arange(0, np.prod(shape, dtype=np.int64), step) % n_samples)
    assert len(depths) >= min(n_samples, 64)
    assert step == 1 or np.prod(shape, dtype=np.int64) / step <= 1e6


# ----- traces


def gains_of(strengths):
    return find_trace_gains(strengths, np.where(strengths > 0.0, 0.9, np.nan))


def gains_in_db(level_db):
    gains = gains_of(10.0 ** (np.asarray(level_db) / 20.0))
    return None if gains is None else in_db(gains)


def test_strength_is_the_mean_size_of_nine_tenths(rng):
    volume = rng.normal(size=(3, 4, 100)).astype(np.float32)
    valid = rng.random(volume.shape) > 0.3
    valid[1, 2] = False
    volume[0, 0, 5] = 1e20
    found = trace_strengths(volume, valid)
    for i, j in np.ndindex(3, 4):
        sizes = np.sort(np.abs(volume[i, j, valid[i, j]]))
        counted = sizes[: int(np.ceil(0.9 * len(sizes)))]
        assert found[i, j] == pytest.approx(counted.mean() if len(counted) else 0.0, rel=1e-5)
    long = rng.normal(size=(2, 2, 4000)).astype(np.float32)
    np.testing.assert_allclose(trace_strengths(long, np.ones(long.shape, bool)), 0.6, rtol=0.2)


def test_ordinary_traces_are_left_alone(rng):
    smooth = 5.0 * np.sin(np.arange(60) / 10.0)[:, None] + np.zeros((60, 50))
    assert gains_in_db(smooth + 0.8 * rng.normal(size=smooth.shape)) is None
    assert gains_of(np.zeros((5, 6))) is None


@pytest.mark.parametrize("step", [-20.0, 30.0])
def test_surveys_put_together_are_brought_near_each_other(step):
    level = np.zeros((40, 60))
    level[:, 40:] = step
    left = gains_in_db(level) + level
    assert np.abs(left[:, :40]).max() == 0.0
    np.testing.assert_allclose(left[:, 40:], 8.0**3 / step**2 * np.sign(step), atol=1e-3)


@pytest.mark.parametrize("scatter", [6.0, 12.0])
def test_traces_that_scatter_are_made_alike(rng, scatter):
    level = scatter * rng.normal(size=(50, 60))
    assert np.std(gains_in_db(level) + level) < 0.25 * scatter


def test_a_single_loud_trace_and_what_is_left_of_dead_ones():
    level = np.zeros((40, 40))
    level[10, 10], level[20, 20], level[30] = 24.0, -70.0, -60.0
    strengths = 10.0 ** (level / 20.0)
    strengths[5, 5] = 0.0
    gains = gains_of(strengths)
    assert -24.0 < 20.0 * np.log10(gains[10, 10]) < -22.0
    assert gains[20, 20] == 0.0
    assert not gains[30].any()
    level[10, 10] = 0.0
    ordinary = (level == 0.0) & (np.indices(level.shape) != 5).any(axis=0)
    ordinary[10, 10] = False
    assert (gains[ordinary] == 1.0).all()
    assert gains[5, 5] == 1.0


@pytest.mark.parametrize("likeness", [0.4, 0.9])
def test_a_border_of_next_to_nothing_is_dead(likeness):
    level = np.zeros((60, 60))
    level[:, 40:] = -200.0
    gains = find_trace_gains(10.0 ** (level / 20.0), np.where(level < 0.0, 0.3, likeness))
    assert (gains[:, :40] == 1.0).all()
    assert not gains[:, 40:].any()


@pytest.mark.parametrize("dither_db", [-30.0, -50.0, -70.0, -200.0])
def test_most_traces_may_be_dead(rng, dither_db):
    """What is weak and like no neighbour is dead, however much there is of it, to the edge of the data."""
    inside = np.hypot(*(np.mgrid[:64, :64] - 32)) < 20
    level = np.where(inside, rng.normal(size=inside.shape), dither_db)
    gains = find_trace_gains(10.0 ** (level / 20.0), np.where(inside, 0.9, 0.3))
    np.testing.assert_array_equal(gains, inside.astype(np.float32))


def test_a_line_of_enormous_strength_takes_no_other_with_it():
    level = np.zeros((30, 30))
    level[12] = 600.0
    gains = gains_of(10.0 ** (level / 20.0))
    assert (np.delete(gains, 12, axis=0) == 1.0).all()
    assert (gains[12] > 0.0).all()


def test_many_lines_of_enormous_strength_make_no_others_dead():
    level = np.zeros((80, 60))
    level[30:45] = 120.0
    gains = gains_of(10.0 ** (level / 20.0))
    assert (gains > 0.0).all()
    np.testing.assert_allclose(20.0 * np.log10(gains[30:45]), -120.0, atol=1.0)


def test_traces_of_any_gain_are_made_ready_alike(rng):
    trace = np.convolve(rng.normal(size=300), np.hanning(9), "same")[50:250]
    volume = (trace + 0.05 * rng.normal(size=(24, 24, 200))).astype(np.float32)
    plain, *_ = clean_volume(volume.copy())
    gains = 10.0 ** (12.0 * rng.normal(size=(24, 24, 1)) / 20.0)
    gains[3, 4] = 1e-4
    found, valid, *_ = clean_volume((volume * gains).astype(np.float32))
    assert valid.all()
    assert np.corrcoef(plain.ravel(), found.ravel())[0, 1] > 0.98


# ----- traces of noise


def dipping(rng, *, shape=(9, 30, 150), slope=1.0, noise=0.0):
    """Layers that fall along an inline."""
    trace = np.convolve(rng.normal(size=shape[2] + 200), np.hanning(9), "same")
    depth = np.arange(shape[2]) - slope * np.arange(shape[1])[:, None] + 100.0
    volume = np.interp(depth, np.arange(len(trace)), trace) + noise * trace.std() * rng.normal(size=shape)
    return np.ascontiguousarray(volume, np.float32)


def likeness_of(volume):
    valid = np.isfinite(volume) & (volume != 0.0)
    volume = np.where(valid, volume, np.float32(0.0))
    return trace_likeness(volume, valid, trace_strengths(volume, valid))


def test_likeness_is_that_of_the_two_most_alike(rng):
    volume = dipping(rng, slope=0.0, noise=0.7)
    found = likeness_of(volume)
    unit = volume / np.sqrt((volume.astype(np.float64) ** 2).sum(axis=2, keepdims=True))
    for i, j in ((0, 0), (3, 1), (5, 12), (8, 29)):
        best = []
        for other in (j - 2, j - 1, j + 1, j + 2):
            if 0 <= other < 30:
                lags = range(-2 * abs(other - j), 2 * abs(other - j) + 1)
                pad = np.pad(unit[i, other], 4)
                best.append(max(float(unit[i, j] @ pad[4 + lag : 154 + lag]) for lag in lags))
        # a few samples larger than four times the strength count for less
        assert found[i, j] == pytest.approx(np.mean(sorted(best)[-2:]), abs=0.02)


@pytest.mark.parametrize("slope", [0.0, 1.5, -2.0])
def test_likeness_follows_dips_and_knows_no_gain_and_no_spikes(rng, slope):
    volume = dipping(rng, slope=slope)
    found = likeness_of(volume)
    assert found.min() > 0.9
    gains = 10.0 ** rng.normal(size=(9, 30, 1))
    np.testing.assert_allclose(likeness_of((volume * gains).astype(np.float32)), found, atol=1e-4)
    volume[:, ::3, 70] = 1e6
    assert likeness_of(volume).min() > 0.75


def test_alone_there_is_no_likeness(rng):
    volume = np.zeros((3, 9, 60), np.float32)
    volume[0, 4], volume[1, :2] = rng.normal(size=60), rng.normal(size=60)
    found = likeness_of(volume)
    assert np.isnan(found[0]).all()
    np.testing.assert_allclose(found[1, :2], 1.0, rtol=1e-5)
    assert np.isnan(found[2]).all()


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_traces_of_noise_are_no_data_and_others_are(rng, noise):
    volume = dipping(rng, shape=(24, 40, 150), noise=noise)
    bad = rng.random((24, 40)) < 0.1
    volume[bad] = (
        3.0 * volume.std() * np.convolve(rng.normal(size=150 * bad.sum()), np.hanning(5), "same").reshape(-1, 150)
    )
    _, valid, *_ = clean_volume(volume.copy())
    live = valid.any(axis=2)
    assert live[bad].mean() < 0.1
    assert live[~bad].mean() > 0.99


def test_noise_alone_and_faults_are_data(rng):
    noise = rng.normal(size=(20, 20, 100)).astype(np.float32)
    assert clean_volume(noise.copy())[1].all()
    broken = dipping(rng, shape=(20, 40, 150))
    broken[:, 20:] = np.roll(broken[:, 20:], 23, axis=2)
    broken[:, 22:24] = np.roll(broken[:, 22:24], 31, axis=2)
    assert clean_volume(broken.copy())[1].all()
