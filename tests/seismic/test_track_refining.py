"""A track is as stiff as its matches scatter."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from seismo3d.seismic.track_refining import TrackSettings, _smooth_depth

SHAPE = (50, 60)


def bent_layer() -> np.ndarray:
    rows, columns = np.indices(SHAPE)
    return 40.0 + 0.3 * rows + 0.004 * (columns - 30.0) ** 2


def smoothed(depth: np.ndarray, **settings: float) -> np.ndarray:
    layers: Any = SimpleNamespace(
        cuts=np.zeros((*SHAPE, 80), np.uint8), times=np.zeros((*SHAPE, 80), np.float32), live=np.ones(SHAPE, bool)
    )
    parts, weight = np.zeros(SHAPE, np.int64), np.ones(SHAPE)
    share = np.ones(SHAPE)
    return _smooth_depth(layers, depth, parts, weight, share, TrackSettings(**settings), matched=parts == 0)


def test_noise_is_smoothed_out(rng: np.random.Generator) -> None:
    """Waveforms are averaged over neighbours before they are matched, so that what they are off by is alike, too."""
    noise = gaussian_filter(rng.normal(0.0, 1.0, SHAPE), 1.2)
    noisy = bent_layer() + 0.6 * noise / noise.std()
    off = {bent: np.std(smoothed(noisy, bent=bent) - bent_layer()) for bent in (0.016, 1e3)}
    assert off[0.016] < 0.6 * off[1e3]


def test_what_noise_leaves_alone_keeps_its_shape() -> None:
    np.testing.assert_allclose(smoothed(bent_layer())[2:-2, 2:-2], bent_layer()[2:-2, 2:-2], atol=0.02)
