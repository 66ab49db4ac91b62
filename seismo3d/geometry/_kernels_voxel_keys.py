"""Keys of voxels, and hash tables of them.

A key packs a voxel's three integer coordinates into 21 bits each; in the plane the third coordinate is zero. Tables are
open, with linear probing; a place holds the voxel's number, or -1.
"""

from __future__ import annotations

from typing import Any

import numba as nb
import numpy as np

from seismo3d._typing import Int32Array, Int64Array

AXIS_BITS = 21
AXIS_MASK = (1 << AXIS_BITS) - 1
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@nb.njit(cache=True, nogil=True, inline="always")
def slot(key: Any, shift: int) -> Any:
    """First place of a key in a table of 2^(64 - shift) places; four voxels along the last axis lie side by side."""
    return (np.int64((np.uint64(key >> 2) * _GOLDEN) >> np.uint64(shift)) & ~3) | (key & 3)


@nb.njit(cache=True, nogil=True, inline="always")
def find(key: Any, table_keys: Int64Array, table: Int32Array, shift: int) -> int:
    """Return the number of the voxel with a key, or -1."""
    mask = table.shape[0] - 1
    place = slot(key, shift)
    while True:
        number = table[place]
        if number < 0:
            return -1
        if table_keys[place] == key:
            return number
        place = (place + 1) & mask


@nb.njit(cache=True, nogil=True)
def make_table(keys: Int64Array) -> tuple[Int64Array, Int32Array, int]:
    """Return a hash table of distinct keys: keys by place, numbers by place, shift."""
    return table_with_room(keys, keys.shape[0])


@nb.njit(cache=True, nogil=True)
def table_with_room(keys: Int64Array, room: int) -> tuple[Int64Array, Int32Array, int]:
    """Return a table of keys that has places for three times as many as ``room``."""
    bits = 4
    while (1 << bits) < 3 * room:
        bits += 1
    table = np.full(1 << bits, -1, dtype=np.int32)
    table_keys = np.empty(1 << bits, dtype=np.int64)
    mask = (1 << bits) - 1
    shift = 64 - bits
    for i in range(keys.shape[0]):
        place = slot(keys[i], shift)
        while table[place] >= 0:
            place = (place + 1) & mask
        table[place] = i
        table_keys[place] = keys[i]
    return table_keys, table, shift
