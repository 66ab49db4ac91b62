"""Kernels that pack the depth of a frame that is kept, without loss; see :mod:`seismo3d.robot.kept`.

Depths are tenths of a millimetre, 0 where there is none, row after row. A byte up to ``LARGEST_STEP`` is a step from
the last depth that there was, by turns up and down: 0, -1, 1, -2, 2 and so on. ``RUN`` is followed by how many pixels
have no depth, ``WHOLE_DEPTH`` by the two bytes of one, the low one first.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray, Float32Array

LARGEST_STEP, WHOLE_DEPTH, RUN = 253, 254, 255
LONGEST_RUN = 255
MOST_BYTES = 3
"""Bytes that a pixel takes at most."""


@nb.njit(cache=True, nogil=True)
def pack_depth(depth: Float32Array, pixels: AnyArray, out: AnyArray) -> int:
    """Write the depths (n), in metres, of the pixels (n) that are not 0; return how many bytes that takes."""
    at, last, run = 0, 0, 0
    for i in range(depth.shape[0]):
        value = 0
        if pixels[i] > 0:
            value = min(int(depth[i] * np.float32(1e4) + np.float32(0.5)), 65535)
        if value == 0 and 0 < run < LONGEST_RUN:
            run += 1
            out[at - 1] = run
            continue
        if value == 0:
            out[at], out[at + 1] = RUN, 1
            at, run = at + 2, 1
            continue
        run = 0
        step = value - last
        turned = 2 * step if step >= 0 else -2 * step - 1
        last = value
        if turned <= LARGEST_STEP:
            out[at] = turned
            at += 1
        else:
            out[at], out[at + 1], out[at + 2] = WHOLE_DEPTH, value & 255, value >> 8
            at += 3
    return at


@nb.njit(cache=True, nogil=True)
def unpack_depth(packed: AnyArray, out: Float32Array) -> bool:
    """Write the depths (n), in metres, that were packed; return whether the bytes say just as many."""
    at, last, i, n = 0, 0, 0, packed.shape[0]
    while at < n:
        code = int(packed[at])
        if code == RUN:
            count = int(packed[at + 1]) if at + 1 < n else 0
            if count == 0 or i + count > out.shape[0]:
                return False
            out[i : i + count] = 0.0
            i, at = i + count, at + 2
            continue
        if code == WHOLE_DEPTH:
            if at + 2 >= n:
                return False
            last = int(packed[at + 1]) | int(packed[at + 2]) << 8
            at += 3
        else:
            last += (code >> 1) ^ -(code & 1)
            at += 1
        if i == out.shape[0]:
            return False
        out[i] = np.float32(last) * np.float32(1e-4)
        i += 1
    return i == out.shape[0]


@nb.njit(cache=True, nogil=True)
def unpack_colours(pixels: AnyArray, out: AnyArray) -> None:
    """Write the colours (n, 3) of packed pixels (n)."""
    for i in range(pixels.shape[0]):
        code = np.uint32(pixels[i])
        out[i, 0], out[i, 1], out[i, 2] = code & 255, (code >> 8) & 255, (code >> 16) & 255
