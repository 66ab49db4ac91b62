"""The misfit between the two sides of every voxel, each side carried to the voxel along its own reflectors."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, inline="always")
def _interpolate(a, b, c, d, f):  # type: ignore[no-untyped-def]
    """Cubic through four samples, at a share f of the way from the second to the third."""
    half = np.float32(0.5)
    bend = a - b * np.float32(2.5) + np.float32(2.0) * c - half * d
    twist = half * (d - a) + np.float32(1.5) * (b - c)
    return b + f * (half * (c - a) + f * (bend + f * twist))


@njit(cache=True, nogil=True, inline="always")
def _sample(row, usable, z, n):  # type: ignore[no-untyped-def]
    """Cubic interpolation at fractional sample z; weight 0 where it needs a sample that is not usable or not there."""
    if z < 0.0 or z > n - 1:
        return np.float32(0.0), np.float32(0.0)
    k = min(int(z), n - 2)
    f = np.float32(z - np.float32(k))
    if not (usable[k] and usable[k + 1]):
        return np.float32(0.0), np.float32(0.0)
    b, c = row[k], row[k + 1]
    a = row[k - 1] if k > 0 and usable[k - 1] else b
    d = row[k + 2] if k < n - 2 and usable[k + 2] else c
    return _interpolate(a, b, c, d, f), np.float32(1.0)


@njit(cache=True, nogil=True)
def add_carried(row, usable, slope, signed, padded, side, count):  # type: ignore[no-untyped-def]
    """Add to one side a trace that lies `signed` traces off and is carried along its slopes, and 1 to the count there.

    `padded` is room for the trace and three samples more. A trace without holes is read with no branch, so that the
    loop runs on vector units.
    """
    n = row.shape[0]
    away = np.float32(signed)
    whole = n > 1
    for k in range(n):
        whole &= usable[k]
    if not whole:
        for k in range(n):
            value, weight = _sample(row, usable, np.float32(np.int32(k)) + away * slope[k], n)
            side[k] += value
            count[k] += weight
        return
    padded[0], padded[n + 1], padded[n + 2] = row[0], row[n - 1], row[n - 1]
    for k in range(n):
        padded[k + 1] = row[k]
    first, last, one, two, three = np.float32(0.0), np.float32(n - 1), np.uint32(1), np.uint32(2), np.uint32(3)
    for k in range(n):
        z = np.float32(np.int32(k)) + away * slope[k]
        inside = z >= first and z <= last
        z = min(max(z, first), last)
        # unsigned: a negative place would count from the end, and asking for that costs as much as reading
        at = np.uint32(min(np.int32(z), np.int32(n - 2)))
        f = z - np.float32(np.int32(at))
        value = _interpolate(padded[at], padded[at + one], padded[at + two], padded[at + three], f)
        side[k] += value if inside else first
        count[k] += np.float32(1.0) if inside else first


@njit(cache=True, nogil=True)
def compare_sides(side, count, difference, energy):  # type: ignore[no-untyped-def]
    """Write (L - R)^2 and L^2 + R^2, given the sums of both sides; the energy is -1 where one is empty."""
    for k in range(side.shape[1]):
        if count[0, k] > 0 and count[1, k] > 0:
            left, right = side[0, k] / count[0, k], side[1, k] / count[1, k]
            difference[k] = (left - right) * (left - right)
            energy[k] = left * left + right * right
        else:
            difference[k] = 0.0
            energy[k] = -1.0


@njit(cache=True, nogil=True, parallel=True)
def side_misfit(volume, valid, slope, axis, reach, corner, difference, energy):  # type: ignore[no-untyped-def]
    """Write (L - R)^2 and L^2 + R^2, L and R the means of up to `reach` traces on either side.

    The energy is -1 where a side is empty. Every trace is carried along the slope found on it, so that the two
    sides keep their own dips. The first trace of what is written is the volume's at the corner.
    """
    n0, n1, n2 = volume.shape
    di, dj = (1, 0) if axis == 0 else (0, 1)
    for line in prange(len(difference)):
        row = np.int64(line)
        i = row + corner[0]
        padded = np.empty(n2 + 3, np.float32)
        side = np.empty((2, n2), np.float32)
        count = np.empty((2, n2), np.float32)
        for column in range(difference.shape[1]):
            j = column + corner[1]
            side[:] = 0.0
            count[:] = 0.0
            for t in range(1, reach + 1):
                for which in range(2):
                    signed = t if which == 1 else -t
                    x, y = i + signed * di, j + signed * dj
                    if 0 <= x < n0 and 0 <= y < n1:
                        add_carried(
                            volume[x, y], valid[x, y], slope[x, y], signed, padded, side[which], count[which]
                        )  # fmt: skip
            compare_sides(side, count, difference[row, column], energy[row, column])


@njit(cache=True, nogil=True, parallel=True)
def clear_unknown(energy, known):  # type: ignore[no-untyped-def]
    """Turn energy -1 into 0 and write 1 to known elsewhere."""
    n0, n1, n2 = energy.shape
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                if energy[i, j, k] < 0:
                    energy[i, j, k] = 0.0
                    known[i, j, k] = 0.0
                else:
                    known[i, j, k] = 1.0


@njit(cache=True, nogil=True, parallel=True)
def divide_known(difference, energy, known, floor, most, out, weight):  # type: ignore[no-untyped-def]
    """Write difference over energy and the floor of each sample, at most `most`, and how far it is known."""
    n0, n1, n2 = out.shape
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                w = known[i, j, k]
                if w > np.float32(0.05):
                    out[i, j, k] = min(difference[i, j, k] / w / (energy[i, j, k] + floor[k]), most)
                    weight[i, j, k] = w
                else:
                    out[i, j, k] = 0.0
                    weight[i, j, k] = 0.0


@njit(cache=True, nogil=True, parallel=True)
def log_ratio(ratio, softness):  # type: ignore[no-untyped-def]
    """Replace r by log(1 + r / softness), in place: the evidence of a voxel, which no bright voxel can dominate."""
    n0, n1, n2 = ratio.shape
    inverse = np.float32(1.0) / softness
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                ratio[i, j, k] = np.log(np.float32(1.0) + ratio[i, j, k] * inverse)
