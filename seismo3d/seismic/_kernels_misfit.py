"""The misfit between the two sides of every voxel, each side carried to the voxel along its own reflectors."""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, nogil=True, inline="always")
def _sample(row, usable, z, n):  # type: ignore[no-untyped-def]
    """Cubic interpolation at fractional sample z; weight 0 where it needs a sample that is not usable or not there."""
    if z < 0.0 or z > n - 1:
        return np.float32(0.0), np.float32(0.0)
    k = min(int(z), n - 2)
    f = np.float32(z - k)
    if not (usable[k] and usable[k + 1]):
        return np.float32(0.0), np.float32(0.0)
    b, c = row[k], row[k + 1]
    a = row[k - 1] if k > 0 and usable[k - 1] else b
    d = row[k + 2] if k < n - 2 and usable[k + 2] else c
    half = np.float32(0.5)
    two = np.float32(2.0)
    bend = a - b * np.float32(2.5) + two * c - half * d
    twist = half * (d - a) + np.float32(1.5) * (b - c)
    return b + f * (half * (c - a) + f * (bend + f * twist)), np.float32(1.0)


@njit(cache=True, nogil=True, parallel=True)
def side_misfit(volume, valid, slope, axis, reach, difference, energy):  # type: ignore[no-untyped-def]
    """Write (L - R)^2 and L^2 + R^2, L and R the means of up to `reach` traces on either side.

    The energy is -1 where a side is empty. Every trace is carried along the slope found on it, so that the two
    sides keep their own dips.
    """
    n0, n1, n2 = volume.shape
    di, dj = (1, 0) if axis == 0 else (0, 1)
    for line in prange(n0):
        i = np.int64(line)
        for j in range(n1):
            for k in range(n2):
                left = np.float32(0.0)
                right = np.float32(0.0)
                n_left = np.float32(0.0)
                n_right = np.float32(0.0)
                for t in range(1, reach + 1):
                    il, jl, ir, jr = i - t * di, j - t * dj, i + t * di, j + t * dj
                    if il >= 0 and jl >= 0:
                        z = k - t * slope[il, jl, k]
                        value, weight = _sample(volume[il, jl], valid[il, jl], z, n2)
                        left += value
                        n_left += weight
                    if ir < n0 and jr < n1:
                        z = k + t * slope[ir, jr, k]
                        value, weight = _sample(volume[ir, jr], valid[ir, jr], z, n2)
                        right += value
                        n_right += weight
                if n_left > 0 and n_right > 0:
                    left /= n_left
                    right /= n_right
                    difference[i, j, k] = (left - right) * (left - right)
                    energy[i, j, k] = left * left + right * right
                else:
                    difference[i, j, k] = 0.0
                    energy[i, j, k] = -1.0


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
def divide_thinned(difference, energy, known, step, floor, most, out, weight):  # type: ignore[no-untyped-def]
    """Write difference / energy at every step-th sample, at most `most`, and how far it is known."""
    n0, n1, n2 = out.shape
    for i in prange(n0):
        for j in range(n1):
            for k in range(n2):
                kk = min(k * step, difference.shape[2] - 1)
                w = known[i, j, kk]
                weight[i, j, k] = w
                if w > np.float32(0.05):
                    out[i, j, k] = min(difference[i, j, kk] / w / (energy[i, j, kk] + floor), most)
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
