"""Layers laid out by hand, with the layer time that a test gives them."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from seismo3d.seismic.layer_time import LayerModel

SHAPE, WALL, THROW = (40, 48, 128), 24, 8.0


def lay_out(
    rng: np.random.Generator, shift: np.ndarray, times: np.ndarray, *, cut: bool, noise: float = 0.05
) -> LayerModel:
    """Return layers that lie deeper by a shift from crossline to crossline, cut at the wall or not."""
    reflectivity = gaussian_filter1d(rng.normal(size=SHAPE[2] + 80), 1.5)
    samples = np.arange(SHAPE[2])
    lines = np.stack([np.interp(samples - s + 40.0, np.arange(len(reflectivity)), reflectivity) for s in shift])
    volume = np.broadcast_to(lines / lines.std(), SHAPE).astype(np.float32)
    volume = volume + noise * rng.normal(size=SHAPE).astype(np.float32)
    cuts = np.zeros(SHAPE, np.uint8)
    if cut:
        cuts[:, WALL - 1] = 2
    closure: Any = None
    return LayerModel(
        np.broadcast_to(times, SHAPE).astype(np.float32), cuts, volume, np.ones(SHAPE, bool), np.ones(SHAPE[:2], bool),
        "samples", 0.0, closure,
    )  # fmt: skip
