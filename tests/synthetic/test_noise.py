from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.synthetic import apply_agc, coloured_noise, migration_smiles, ricker
from seismo3d.synthetic.noise import root_mean_square


def spectrum_peak(traces):
    power = (np.abs(np.fft.rfft(traces, axis=-1)) ** 2).reshape(-1, traces.shape[-1] // 2 + 1).mean(axis=0)
    return np.fft.rfftfreq(traces.shape[-1])[power.argmax()]


@pytest.mark.parametrize("frequency", [0.035, 0.05, 0.08])
def test_ricker_and_noise_peak_at_the_frequency_asked_for(frequency):
    assert spectrum_peak(ricker(np.arange(-512, 512), frequency)) == pytest.approx(frequency, abs=0.001)
    noise = coloured_noise(np.random.default_rng(1), (40, 40, 512), frequency)
    assert spectrum_peak(noise) == pytest.approx(frequency, abs=0.006)
    assert root_mean_square(noise) == pytest.approx(1.0, rel=1e-4)


def test_lateral_smoothing_correlates_neighbouring_traces():
    rng = np.random.default_rng(2)
    for lateral, expected in ((0.0, 0.0), (1.0, np.exp(-0.25))):
        noise = coloured_noise(rng, (60, 60, 128), 0.05, lateral=lateral)
        assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(expected, abs=0.03)


def test_ricker_refuses_a_frequency_of_zero():
    with pytest.raises(ParameterError, match="peak_frequency is 0"):
        ricker([0.0], 0.0)


def test_agc_evens_out_amplitudes_and_keeps_zero_traces():
    data = np.random.default_rng(3).standard_normal((3, 400)).astype(np.float32)
    data[:, 200:] *= 50.0
    data[2] = 0.0
    even = apply_agc(data, window=40)
    assert np.std(even[:2, :150]) == pytest.approx(1.0, abs=0.15)
    assert np.std(even[:2, 250:]) == pytest.approx(1.0, abs=0.15)
    assert not even[2].any()


def test_smile_is_a_bowl():
    smile = migration_smiles(np.random.default_rng(5), (40, 40, 64), 0.06, count=1)
    strength = np.abs(smile).max(axis=2)
    lowest = np.unravel_index(strength.argmax(), strength.shape)
    depth = np.abs(smile).argmax(axis=2).astype(float)
    rim = (strength > 0.1) & (strength < 0.3)
    assert rim.any()
    assert depth[rim].mean() < depth[lowest] - 2
    assert 0.3 < strength.max() <= 1.0


def test_times_of_a_wavelet_are_real_numbers():
    assert ricker([], 0.1).shape == (0,)
    for times in (["1"], [1j], [None]):
        with pytest.raises(ShapeError, match=r"^time has elements of type .*; expected real numbers"):
            ricker(times, 0.1)
