"""Values counted by their bits, in the order of the values."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, inline="always")
def _key(bits):  # type: ignore[no-untyped-def]
    """Return an integer in the order of the values whose bits these are; zero and minus zero are one value."""
    sign = np.uint32(1 << 31)
    if bits == sign:
        return sign
    return np.uint32(~bits) if bits & sign else np.uint32(bits | sign)


@njit(cache=True, nogil=True)
def add_high(bits, counts):  # type: ignore[no-untyped-def]
    """Add 1 to the count of the upper half of every value's key; `bits` are those of 32-bit floats."""
    for k in range(len(bits)):
        counts[_key(bits[k]) >> np.uint32(16)] += 1


@njit(cache=True, nogil=True)
def add_low(bits, upper, counts):  # type: ignore[no-untyped-def]
    """Add 1 to the count of the lower half of the keys that have this upper half."""
    for k in range(len(bits)):
        key = _key(bits[k])
        if key >> np.uint32(16) == upper:
            counts[key & np.uint32(0xFFFF)] += 1
