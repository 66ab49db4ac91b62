"""The LZF compression that binary PCD files use."""

from __future__ import annotations

import numba as nb
import numpy as np

from seismo3d._typing import AnyArray


@nb.njit(cache=True, nogil=True)
def decompress(packed: AnyArray, size: int) -> AnyArray:
    """Return ``size`` bytes, or fewer where the packed bytes are cut short or point before the start."""
    out = np.empty(size, dtype=np.uint8)
    i = np.int64(0)
    o = np.int64(0)
    n = packed.shape[0]
    while i < n:
        control = np.int64(packed[i])
        i += 1
        if control < 32:
            count = control + 1
            if i + count > n or o + count > size:
                return out[:o]
            out[o : o + count] = packed[i : i + count]
            i += count
            o += count
            continue
        count = control >> 5
        if count == 7:
            if i >= n:
                return out[:o]
            count += packed[i]
            i += 1
        if i >= n:
            return out[:o]
        back = o - ((control & 31) << 8) - packed[i] - 1
        i += 1
        count += 2
        if back < 0 or o + count > size:
            return out[:o]
        for _ in range(count):
            out[o] = out[back]
            o += 1
            back += 1
    return out[:o]
