"""How voxels are held: the signed distance in 16 bits, and the root of the weight in 16 bits.

A distance of one band is ``STEPS`` steps from ``SURFACE``; 0 is a distance that is not known, so that memory that was
never written to is a map that was never seen. Steps are a few ten-thousandths of a voxel, far below what one more frame
moves a voxel by. Of the weight the root is held, as of the pixels' weights, so that a small one still adds to a large
one: the largest weight has the root ``WHOLE``.
"""

from __future__ import annotations

import numpy as np

from seismo3d._typing import AnyArray, Float32Array

SURFACE, STEPS, WHOLE = 32768.0, 32767.0, 65535.0


def unpack_distance(held: AnyArray, band: float) -> Float32Array:
    """Return distances in metres, NaN where not known."""
    distance = (held.astype(np.float32) - np.float32(SURFACE)) * np.float32(band / STEPS)
    return np.where(held > 0, distance, np.float32(np.nan))


def unpack_weight(held: AnyArray, heaviest: float) -> Float32Array:
    """Return weights."""
    return np.square(held.astype(np.float32) / np.float32(WHOLE)) * np.float32(heaviest)
