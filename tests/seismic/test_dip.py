from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic._kernels_filters import grow_traces, shift_traces
from seismo3d.seismic.dip import DipSettings, block_slopes, dip_reach, estimate_slopes

SHAPE = (32, 32, 64)
# windows that leave places in a small cube which its edges do not reach: 3 + 5 traces, 3 + 10 samples
NARROW = DipSettings(lateral=2.0, vertical=4.0)


def plane_wave(p, q, *, shape=SHAPE, period=12.0, noise=0.0):
    i, x, k = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")
    depth = k - p * i - q * x
    wave = np.sin(2 * np.pi * depth / period) + 0.6 * np.cos(2 * np.pi * depth / (1.7 * period) + 1.0)
    return (wave + noise * np.random.default_rng(5).normal(size=shape)).astype(np.float32)


def everywhere(volume):
    return np.ones(volume.shape, bool)


def inner(values):
    """What the cube's edges do not reach."""
    return values[9:-9, 9:-9, 14:-14]


@pytest.mark.parametrize(
    ("p", "q"), [(0.0, 0.0), (0.3, -0.5), (-0.8, 0.1), (1.2, 0.0), (0.0, -1.2), (0.7, 0.7), (-1.0, 1.0)]
)
def test_slopes_of_a_plane_wave(p, q):
    volume = plane_wave(p, q, period=20.0)
    found = estimate_slopes(volume, everywhere(volume), settings=NARROW)
    for slope, expected in zip(found, (p, q), strict=True):
        assert slope.shape == volume.shape
        assert slope.dtype == np.float32
        np.testing.assert_allclose(inner(slope), expected, atol=0.02)


def test_noise_does_not_draw_slopes_to_zero():
    volume = plane_wave(0.6, -0.4, noise=0.5)
    p, q = estimate_slopes(volume, everywhere(volume))
    assert np.median(inner(p)) == pytest.approx(0.6, abs=0.05)
    assert np.median(inner(q)) == pytest.approx(-0.4, abs=0.05)


@pytest.mark.parametrize("factor", [-1.0, 1000.0, 1e-3])
def test_slopes_ignore_sign_and_scale(factor):
    volume = plane_wave(0.3, 0.4, noise=0.2)
    p, q = estimate_slopes(volume, everywhere(volume))
    scaled = estimate_slopes(volume * np.float32(factor), everywhere(volume))
    np.testing.assert_allclose(scaled[0], p, atol=2e-3)
    np.testing.assert_allclose(scaled[1], q, atol=2e-3)


def test_transposed_cube_exchanges_the_slopes():
    volume = plane_wave(0.3, -0.6, noise=0.3)
    p, q = estimate_slopes(volume, everywhere(volume))
    turned = np.ascontiguousarray(volume.transpose(1, 0, 2))
    q_turned, p_turned = estimate_slopes(turned, everywhere(turned))
    np.testing.assert_allclose(p_turned.transpose(1, 0, 2), p, atol=1e-3)
    np.testing.assert_allclose(q_turned.transpose(1, 0, 2), q, atol=1e-3)


def test_mirrored_cube_turns_the_slope_over():
    volume = plane_wave(0.3, -0.6, noise=0.3)
    p, q = estimate_slopes(volume, everywhere(volume))
    mirrored = estimate_slopes(np.ascontiguousarray(volume[::-1]), everywhere(volume))
    np.testing.assert_allclose(mirrored[0][::-1], -p, atol=1e-3)
    np.testing.assert_allclose(mirrored[1][::-1], q, atol=1e-3)


@pytest.mark.parametrize("slab", [7, 31])
def test_slabs_give_what_the_whole_cube_gives(slab):
    volume = plane_wave(0.3, -0.6, noise=0.3)
    whole = estimate_slopes(volume, everywhere(volume), settings=DipSettings(lateral=2.0, vertical=4.0))
    parts = estimate_slopes(volume, everywhere(volume), settings=DipSettings(lateral=2.0, vertical=4.0, slab=slab))
    for one, other in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(one, other)


def test_edges_of_missing_zones_do_not_leak():
    volume = plane_wave(0.5, -0.3)
    valid = everywhere(volume)
    valid[12:18, :, :] = False
    valid[:, 20:24, 30:] = False
    volume[~valid] = 0.0
    for slope, expected in zip(estimate_slopes(volume, valid, settings=NARROW), (0.5, -0.3), strict=True):
        # apart from the cube's own edges every gradient that is left is that of the wave, up to the dead zone's edge
        error = np.abs(slope - expected)[3:-3, 3:-3, 3:-3]
        assert np.percentile(error[valid[3:-3, 3:-3, 3:-3]], 99) < 0.1


def test_what_missing_samples_hold_does_not_matter(rng):
    volume = plane_wave(0.5, -0.3)
    valid = everywhere(volume)
    valid[:, 20:24] = False
    other = np.where(valid, volume, 50.0 * rng.normal(size=SHAPE).astype(np.float32))
    far = np.zeros(SHAPE, bool)
    far[:, :20], far[:, 24:] = True, True
    # the derivative reaches three samples, the weight keeps out what lies within two of missing data
    for one, two in zip(estimate_slopes(np.where(valid, volume, 0), valid), estimate_slopes(other, valid), strict=True):
        assert np.median(np.abs(one - two)[far]) < 0.05


def test_nothing_to_see_is_level():
    volume = np.zeros((12, 12, 24), np.float32)
    for valid in (everywhere(volume), ~everywhere(volume)):
        for slope in estimate_slopes(volume, valid):
            assert not slope.any()


def test_steepest_slope_is_a_bound():
    volume = plane_wave(2.5, 0.0, period=30.0)
    p, _ = estimate_slopes(volume, everywhere(volume), settings=DipSettings(steepest=1.0))
    assert p.max() == 1.0
    assert np.median(inner(p)) == 1.0


def test_section_one_trace_thick_is_level_across():
    volume = plane_wave(0.0, 0.7)[:1]
    p, q = estimate_slopes(np.ascontiguousarray(volume), everywhere(volume), settings=NARROW)
    np.testing.assert_allclose(p, 0.0, atol=1e-4)
    np.testing.assert_allclose(q[0, 9:-9, 14:-14], 0.7, atol=0.02)


def test_slopes_of_a_block_are_those_of_the_whole(rng):
    volume = plane_wave(0.3, -0.6, shape=(40, 36, 24), noise=0.3)
    valid = rng.random(volume.shape) > 0.01
    whole = estimate_slopes(volume, valid, settings=NARROW)
    asked, reach = (slice(14, 22), slice(0, 17)), dip_reach(NARROW)
    wide = grow_traces(asked, (reach, reach), volume.shape)
    assert (wide[0].start, wide[1].stop) == (14 - reach, 17 + reach)
    cut = [np.ascontiguousarray(part[wide]) for part in (volume, valid)]
    found = block_slopes(*cut, ((False, False), (True, False)), NARROW, shift_traces(asked, wide))
    for part, slope in zip(found, whole, strict=True):
        np.testing.assert_array_equal(part, slope[asked])
