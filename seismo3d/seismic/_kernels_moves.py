"""How well the two sides of a break match, moved along it by every shift."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, inline="always")
def _read(section, valid, x, z):  # type: ignore[no-untyped-def]
    """Bilinear amplitude at a fractional position; weight 0 where any of its samples is missing."""
    n0, n1 = section.shape
    if x < 0.0 or z < 0.0 or x > n0 - 1 or z > n1 - 1:
        return np.float32(0.0), np.float32(0.0)
    i, k = min(int(x), n0 - 2), min(int(z), n1 - 2)
    if not (valid[i, k] and valid[i + 1, k] and valid[i, k + 1] and valid[i + 1, k + 1]):
        return np.float32(0.0), np.float32(0.0)
    fx, fz = np.float32(x - i), np.float32(z - k)
    whole = np.float32(1.0)
    upper = (whole - fx) * section[i, k] + fx * section[i + 1, k]
    lower = (whole - fx) * section[i, k + 1] + fx * section[i + 1, k + 1]
    return (whole - fz) * upper + fz * lower, whole


@njit(cache=True, nogil=True)
def read_beside(  # type: ignore[no-untyped-def]
    section, valid, slope, x, z, cotangent, near, far, clear, sides, known
):
    """Write both sides of a line through (x, z), one value a sample: means of traces `near` to `far` off it.

    The line moves by `cotangent` traces a sample; z is the middle of what is written. Traces are carried along the
    slope `clear` traces off the line.
    """
    half = sides.shape[1] // 2
    n0, n1 = section.shape
    for m in range(2 * half + 1):
        k = z + m - half
        at = x + cotangent * (m - half)
        for side in range(2):
            sides[side, m] = 0.0
            known[side, m] = 0.0
            if k < 0 or k > n1 - 1:
                continue
            sign = 1 if side == 1 else -1
            trace = min(max(int(np.rint(at + sign * clear)), 0), n0 - 1)
            dip = slope[trace, k]
            total, count = np.float32(0.0), np.float32(0.0)
            for distance in range(near, far + 1):
                value, weight = _read(section, valid, at + sign * distance, k + sign * distance * dip)
                total += value
                count += weight
            if count > 0:
                sides[side, m] = total / count
                known[side, m] = 1.0


@njit(cache=True, nogil=True)
def moved_misfit(sides, known, move, taps):  # type: ignore[no-untyped-def]
    """Return (L - R)^2 over L^2 + R^2 around the middle, the right side `move` samples below the left; 1 if unknown."""
    middle, half = sides.shape[1] // 2, len(taps) // 2
    left = middle - math.floor(move / 2)
    misfit, energy, count = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for t in range(-half, half + 1):
        i = left + t
        j = i + move
        if i < 0 or j < 0 or i >= sides.shape[1] or j >= sides.shape[1]:
            continue
        if known[0, i] > 0 and known[1, j] > 0:
            weight = taps[t + half]
            misfit += weight * (sides[0, i] - sides[1, j]) ** 2
            energy += weight * (sides[0, i] ** 2 + sides[1, j] ** 2)
            count += weight
    # a mean over less than half of the window is that of other ground; amplitudes are of unit mean square
    if count < np.float32(0.4):
        return np.float32(1.0)
    return misfit / (energy + np.float32(0.1) * count)


@njit(cache=True, nogil=True, parallel=True)
def explained_shares(  # type: ignore[no-untyped-def]
    section, valid, slope, positions, cotangents, near, far, clear, farthest, taps, out
):
    """Write, for the break at each position, the share of its misfit that is gone where the sides match best."""
    for point in prange(len(out)):
        n = np.int64(point)
        half = len(taps) // 2 + (farthest + 1) // 2
        sides, known = np.empty((2, 2 * half + 1), np.float32), np.empty((2, 2 * half + 1), np.float32)
        x, z = np.float64(positions[n, 0]), np.int64(np.rint(positions[n, 1]))
        read_beside(section, valid, slope, x, z, np.float64(cotangents[n]), near, far, clear, sides, known)
        still = moved_misfit(sides, known, 0, taps)
        best = still
        for move in range(1, farthest + 1):
            best = min(best, moved_misfit(sides, known, move, taps), moved_misfit(sides, known, -move, taps))
        out[n] = (still - best) / max(still, np.float32(1e-3))
