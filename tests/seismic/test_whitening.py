from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.whitening import design_whitening, filter_valid
from seismo3d.seismic.whitening import whiten as whiten_cube


def whiten(volume, valid, **settings):
    return whiten_cube(volume, valid, **settings)[0]


def ricker(period):
    t = np.arange(-2 * period, 2 * period + 1) / period
    return (1.0 - 2.0 * (np.pi * t) ** 2) * np.exp(-((np.pi * t) ** 2))


def layered(rng, *, period=14, shape=(20, 20, 160), noise=0.0):
    """Flat layers under a wavelet, the same in every trace, and noise of its own in each."""
    trace = np.convolve(rng.normal(size=shape[2] + 200), ricker(period), "same")[100:-100]
    volume = np.broadcast_to(trace / trace.std(), shape) + noise * rng.normal(size=shape)
    return np.ascontiguousarray(volume, np.float32)


def bandwidth(volume):
    """Effective number of frequencies that hold the power."""
    power = (np.abs(np.fft.rfft(volume.astype(np.float64), axis=2)) ** 2).mean(axis=(0, 1))
    return power.sum() ** 2 / (power**2).sum()


def everywhere(volume):
    return np.ones(volume.shape, bool)


@pytest.mark.parametrize("period", [10, 14, 24])
def test_spectrum_is_flatter_after(rng, period):
    volume = layered(rng, period=period)
    white = whiten(volume, everywhere(volume))
    assert white.dtype == np.float32
    assert white.shape == volume.shape
    assert bandwidth(white) > 1.15 * bandwidth(volume)


def test_result_has_unit_power_and_no_spikes(rng):
    volume = layered(rng)
    volume[4, 4, 50] = 1e4
    white = whiten(volume, everywhere(volume))
    assert np.abs(white).max() <= 8.0
    quiet = whiten(layered(rng), everywhere(volume))
    assert np.sqrt((quiet.astype(np.float64) ** 2).mean()) == pytest.approx(1.0, abs=0.02)


def test_taps_are_symmetric_and_odd_and_amplify_nothing(rng):
    volume = layered(rng, noise=0.3)
    taps = design_whitening(volume, everywhere(volume)).taps
    assert len(taps) % 2 == 1
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-6)
    assert np.abs(np.fft.rfft(taps, 1024)).max() == pytest.approx(1.0, abs=0.05)


def test_noise_is_not_boosted(rng):
    """At frequencies that hold noise alone the filter must not rise, however weak they are."""
    noisy = layered(rng, period=24, noise=0.3)
    response = np.abs(np.fft.rfft(design_whitening(noisy, everywhere(noisy)).taps, 512))
    frequency = np.arange(257) / 512
    peak, empty = (frequency > 0.02) & (frequency < 0.06), (frequency > 0.2) & (frequency < 0.3)
    assert response[empty].mean() < 0.05 * response[peak].mean()


def test_zeros_stay_zero():
    volume = np.zeros((6, 6, 40), np.float32)
    taps = design_whitening(volume, everywhere(volume)).taps
    assert taps.sum() == 1.0
    assert taps[len(taps) // 2] == 1.0
    np.testing.assert_array_equal(whiten(volume, everywhere(volume)), volume)


def test_without_neighbours_the_cube_is_only_scaled(rng):
    volume = rng.normal(size=(6, 6, 60)).astype(np.float32)
    valid = np.zeros(volume.shape, bool)
    valid[::2, ::2] = True
    volume[~valid] = 0.0
    white = whiten(volume, valid)
    factor = white[0, 0, 30] / volume[0, 0, 30]
    np.testing.assert_allclose(white[valid], (volume * factor)[valid], rtol=1e-4, atol=1e-5)


def test_scale_and_sign_of_amplitudes(rng):
    volume = layered(rng, noise=0.2)
    white = whiten(volume, everywhere(volume))
    np.testing.assert_array_equal(whiten(-volume, everywhere(volume)), -white)
    np.testing.assert_allclose(whiten(1000 * volume, everywhere(volume)), white, atol=2e-4)


@pytest.mark.parametrize("carried", [False, True])
def test_missing_data_stay_zero(rng, carried):
    volume = layered(rng)
    valid = everywhere(volume)
    valid[3:6, :, 40:] = False
    volume[~valid] = 0.0
    white = whiten(volume, valid, carried=carried)
    assert not white[~valid].any()
    assert np.isfinite(white).all()


@pytest.mark.parametrize("carried", [False, True])
def test_reflectors_stay_where_they_are(rng, carried):
    """The filter has no phase: what it does commutes with turning the cube upside down."""
    volume = layered(rng, shape=(20, 20, 128))
    valid = everywhere(volume)
    upside_down = whiten(np.ascontiguousarray(volume[:, :, ::-1]), valid, carried=carried)[:, :, ::-1]
    np.testing.assert_allclose(upside_down, whiten(volume, valid, carried=carried), atol=2e-3)


def test_ends_do_not_tell_where_a_trace_is_cut_off(rng):
    """What a trace is filtered to near its end is what it would be if it went on, and lies where the layers do."""
    volume = layered(rng, shape=(20, 20, 200))
    whole = whiten(volume, everywhere(volume), carried=True)
    cut = np.ascontiguousarray(volume[:, :, :160])
    found = whiten(cut, everywhere(cut), carried=True)
    scale = found[..., 40:120].std() / whole[..., 40:120].std()
    left = found - scale * whole[..., :160]
    repeated = whiten(cut, everywhere(cut)) - scale * whole[..., :160]
    assert np.sqrt(np.mean(repeated[..., 152:] ** 2)) > 0.6 * found.std()
    assert np.sqrt(np.mean(left[..., 152:] ** 2)) < 0.3 * found.std()
    assert np.sqrt(np.mean(left[..., 40:120] ** 2)) < 0.1 * found.std()


@pytest.mark.parametrize("carried", [False, True])
def test_muted_ends_are_gone_on_from_like_ends_of_the_cube(rng, carried):
    volume = layered(rng)
    whitening = design_whitening(volume, everywhere(volume), carried=carried)
    short = np.ascontiguousarray(volume[:, :, 30:])
    valid = everywhere(volume)
    valid[:10, :, :30] = False
    muted = filter_valid(np.where(valid, volume, np.float32(0.0)), valid, whitening)[:10, :, 30:]
    np.testing.assert_array_equal(muted, filter_valid(short, everywhere(short), whitening)[:10])


@pytest.mark.parametrize("carried", [False, True])
def test_gaps_are_filtered_as_straight_lines(rng, carried):
    volume = layered(rng, noise=0.2)
    whitening = design_whitening(volume, everywhere(volume), carried=carried)
    valid = everywhere(volume)
    valid[3, :, 60:75] = valid[5, :, 20] = False
    bridged = volume.copy()
    for i, gap in ((3, slice(60, 75)), (5, slice(20, 21))):
        ends, inside = [gap.start - 1, gap.stop], np.arange(gap.start, gap.stop)
        for j in range(volume.shape[1]):
            bridged[i, j, gap] = np.interp(inside, ends, volume[i, j, ends])
    expected = filter_valid(bridged, everywhere(volume), whitening)
    found = filter_valid(np.where(valid, volume, np.float32(0.0)), valid, whitening)
    np.testing.assert_allclose(found[valid], expected[valid], atol=1e-5)
    assert not found[~valid].any()


def test_section_of_either_orientation(rng):
    section = layered(rng, noise=0.1)[:1]
    white = whiten(section, everywhere(section))
    turned = whiten(np.ascontiguousarray(section.transpose(1, 0, 2)), everywhere(section).transpose(1, 0, 2))
    np.testing.assert_allclose(turned.transpose(1, 0, 2), white, atol=1e-5)


def test_the_spectrum_that_is_left_is_that_of_the_filtered_traces(rng):
    volume = layered(rng, shape=(20, 20, 400))
    white, whitening = whiten_cube(volume, everywhere(volume))
    taper = np.hanning(132)
    pieces = [white[..., a : a + 132] * taper for a in range(0, 268, 20)]
    measured = np.sqrt(np.mean([np.abs(np.fft.rfft(p, axis=2)) ** 2 for p in pieces], axis=(0, 1, 2)))
    assert whitening.spectrum.shape == measured.shape
    assert np.corrcoef(whitening.spectrum, measured)[0, 1] > 0.9


@pytest.mark.parametrize("muted", [slice(0, 30), slice(70, 90), slice(150, 160)])
def test_a_mute_leaves_the_filter_as_it_is(rng, muted):
    volume = layered(rng, noise=0.05)
    valid = everywhere(volume)
    taps = design_whitening(volume, valid).taps
    valid[..., muted] = False
    volume[..., muted] = 0.0
    found = design_whitening(volume, valid).taps
    assert np.abs(found - taps).max() < 0.25 * np.abs(taps).max()
    assert np.abs(found).argmax() == len(taps) // 2
    assert np.count_nonzero(np.abs(found) > 0.02 * found.max()) > 5  # no identity


@pytest.mark.parametrize("slope", [1.0, 4.0])
def test_a_sloping_mute_leaves_the_filter_as_it_is(rng, slope):
    """Where data begin with a step, all frequencies seem to agree, and the filter would let them all pass."""
    volume = layered(rng, shape=(24, 20, 160))
    taps = design_whitening(volume, everywhere(volume)).taps
    valid = np.broadcast_to(np.arange(160) >= 10 + slope * np.arange(24)[:, None, None], volume.shape)
    found = design_whitening(np.where(valid, volume, np.float32(0.0)), valid).taps
    assert np.corrcoef(found, taps)[0, 1] > 0.95


def test_gaps_on_every_trace_leave_a_filter(rng):
    volume = layered(rng, noise=0.05)
    valid = everywhere(volume)
    for i, j in np.ndindex(20, 20):
        valid[i, j, 7 + (3 * i + j) % 4 :: 20] = False
    taps = design_whitening(np.where(valid, volume, np.float32(0.0)), valid).taps
    assert np.count_nonzero(np.abs(taps) > 0.02 * taps.max()) > 5


@pytest.mark.parametrize(("period", "noise"), [(10, 0.0), (14, 0.7), (24, 0.3), (48, 0.3)])
def test_the_shortest_period_is_that_of_what_neighbours_agree_in(rng, period, noise):
    volume = layered(rng, period=period, shape=(24, 24, 400), noise=noise)
    # a whitened Ricker wavelet reaches to some twice the frequency of its peak
    assert design_whitening(volume, everywhere(volume)).period == pytest.approx(period / 2.0, rel=0.25)


def test_no_reflections_have_no_period():
    volume = np.zeros((6, 6, 40), np.float32)
    assert design_whitening(volume, everywhere(volume)).period == 0.0


def test_neighbours_that_agree_nowhere_leave_traces_as_they_are(rng):
    trace = layered(rng, shape=(1, 1, 160))[0, 0]
    volume = np.where(np.arange(12)[:, None] % 2 == 0, trace, -trace) * np.ones((8, 1, 1))
    taps = design_whitening(np.ascontiguousarray(volume, np.float32), everywhere(volume)).taps
    assert taps[len(taps) // 2] == 1.0
    assert np.abs(taps).sum() == 1.0
