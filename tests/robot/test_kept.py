from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot import _kernels_kept as kernels
from seismo3d.robot.frames import Measurer, MeasureSettings
from seismo3d.robot.kept import KeptFrame

LENS = PinholeCamera(130.0, 130.0, 79.5, 59.5)
MEASURER = Measurer(LENS, MeasureSettings(), ThreadPoolExecutor(2))


def packed(tenths: np.ndarray) -> np.ndarray:
    room = np.empty(kernels.MOST_BYTES * tenths.size, np.uint8)
    depth = tenths.astype(np.float32) * np.float32(1e-4)
    size = kernels.pack_depth(depth, np.ones(tenths.size, np.uint64), room)
    return room[:size].copy()


@pytest.mark.parametrize("spread", [3, 126, 127, 128, 60000])
def test_depth_comes_back_to_a_tenth_of_a_millimetre(rng: np.random.Generator, spread: int) -> None:
    """Small steps, steps about the largest that one byte takes, any steps, with holes of all lengths."""
    walk = np.cumsum(rng.integers(-spread, spread + 1, 5000)) % 65535 + 1
    for first, length in ((0, 3), (700, 1), (800, 254), (1500, 255), (2000, 256), (2500, 700), (4990, 10)):
        walk[first : first + length] = 0
    stream, out = packed(walk), np.full(len(walk), np.nan, np.float32)
    assert kernels.unpack_depth(stream, out)
    np.testing.assert_array_equal(out, (walk * np.float32(1e-4)).astype(np.float32))
    assert len(stream) < len(walk) if spread == 3 else len(stream) <= kernels.MOST_BYTES * len(walk)


def test_a_step_that_fits_takes_one_byte() -> None:
    assert packed(np.array([126, 252, 125])).tolist() == [252, 252, 253]
    assert packed(np.array([127])).tolist() == [254, 127, 0]
    assert packed(np.array([0, 0, 0])).tolist() == [255, 3]


def test_damaged_depth_is_refused(rng: np.random.Generator) -> None:
    whole = packed(np.concatenate([rng.integers(1, 65536, 50), np.zeros(20, int)]))
    out = np.empty(70, np.float32)
    assert kernels.unpack_depth(whole, out)
    for damaged in (whole[:-1], whole[:-2], whole[:40], np.append(whole, np.uint8(4)), np.array([255, 0], np.uint8)):
        assert not kernels.unpack_depth(damaged, out)
    assert not kernels.unpack_depth(whole, np.empty(69, np.float32))


def test_a_kept_frame_comes_back_as_it_was_fused(rng: np.random.Generator) -> None:
    depth = (1.5 + 0.002 * rng.standard_normal((120, 160))).astype(np.float32)
    depth[40:60, 50:90] = 0.0
    colour = np.full((120, 160, 3), (200, 90, 30), np.uint8)
    measured = MEASURER.measured(depth, colour)
    kept = KeptFrame.of(measured, 3, 0)
    again = kept.unpacked(MEASURER)
    fused = measured.pixels.reshape(depth.shape) > 0
    np.testing.assert_allclose(again.depth[fused], depth[fused], atol=0.51e-4)
    assert not again.depth[~fused].any()
    inner = again.colour[10:30, 10:150][again.pixels.reshape(depth.shape)[10:30, 10:150] > 0].astype(int)
    assert np.abs(np.median(inner, axis=0) - [200, 90, 30]).max() <= 3
    assert kept.n_bytes == kept.depth.size + kept.colour.size
    with pytest.raises(ValueError, match="does not fill its 19200 pixels"):
        replace(kept, depth=kept.depth[:-1]).unpacked(MEASURER)
    assert KeptFrame.of(MEASURER.measured(depth, np.zeros((0, 0, 3), np.uint8)), 0, 0).colour.size == 0
