"""Compiled loops of the 3D matcher. Arrays in, arrays out, no checks."""

from __future__ import annotations

import math

import numba
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array


@numba.njit(cache=True, nogil=True)
def halved_tensor(volume: Float32Array, valid: AnyArray) -> Float32Array:
    """Outer products of the gradient (xx, xy, xz, yy, yz, zz), summed over cells of 2 x 2 x 2 voxels."""
    ni, nj, nk = volume.shape
    out = np.zeros((6, ni // 2, nj // 2, nk // 2), np.float32)
    masked = valid.shape[0] == ni and valid.shape[1] == nj and valid.shape[2] == nk
    for i in range(1, min(ni - 1, 2 * (ni // 2))):
        for j in range(1, min(nj - 1, 2 * (nj // 2))):
            for k in range(1, min(nk - 1, 2 * (nk // 2))):
                if masked and not (
                    valid[i - 1, j, k]
                    and valid[i + 1, j, k]
                    and valid[i, j - 1, k]
                    and valid[i, j + 1, k]
                    and valid[i, j, k - 1]
                    and valid[i, j, k + 1]
                ):
                    continue
                a = volume[i + 1, j, k] - volume[i - 1, j, k]
                b = volume[i, j + 1, k] - volume[i, j - 1, k]
                c = volume[i, j, k + 1] - volume[i, j, k - 1]
                p, q, r = i // 2, j // 2, k // 2
                out[0, p, q, r] += a * a
                out[1, p, q, r] += a * b
                out[2, p, q, r] += a * c
                out[3, p, q, r] += b * b
                out[4, p, q, r] += b * c
                out[5, p, q, r] += c * c
    return out


@numba.njit(cache=True, nogil=True)
def smallest_eigenvalue(tensor: Float32Array) -> Float32Array:
    """Smallest eigenvalue of symmetric 3 x 3 tensors, in closed form."""
    flat = tensor.reshape(6, -1)
    out = np.empty(flat.shape[1], np.float32)
    for i in range(flat.shape[1]):
        a, b, c, d, e, f = flat[0, i], flat[1, i], flat[2, i], flat[3, i], flat[4, i], flat[5, i]
        mean = (a + d + f) / 3.0
        off = b * b + c * c + e * e
        spread = math.sqrt(((a - mean) ** 2 + (d - mean) ** 2 + (f - mean) ** 2 + 2.0 * off) / 6.0)
        if spread < 1e-12 * max(mean, 1e-30):
            out[i] = mean
            continue
        u, v, w = (a - mean) / spread, (d - mean) / spread, (f - mean) / spread
        b, c, e = b / spread, c / spread, e / spread
        half = 0.5 * (u * (v * w - e * e) - b * (b * w - e * c) + c * (b * e - v * c))
        angle = math.acos(min(max(half, -1.0), 1.0)) / 3.0
        out[i] = mean + 2.0 * spread * math.cos(angle + 2.0 * math.pi / 3.0)
    return out.reshape(tensor.shape[1:])


@numba.njit(cache=True, nogil=True)
def describe_spheres(
    volume: Float32Array,
    valid: AnyArray,
    points: Float64Array,
    frames: Float64Array,
    centres: Float64Array,
    sphere: Int32Array,
    n_bands: int,
    n_bins: int,
) -> Float32Array:
    """Histograms (points, windows, bands, bins) of gradient directions in spheres placed in each point's own frame."""
    ni, nj, nk = volume.shape
    masked = valid.shape[0] == ni and valid.shape[1] == nj and valid.shape[2] == nk
    out = np.zeros((points.shape[0], centres.shape[0], n_bands, n_bins), np.float32)
    bins_per_radian = n_bins / (2.0 * math.pi)
    for p in range(points.shape[0]):
        f = frames[p]
        for w in range(centres.shape[0]):
            ci = math.floor(
                points[p, 0] + f[0, 0] * centres[w, 0] + f[0, 1] * centres[w, 1] + f[0, 2] * centres[w, 2] + 0.5
            )
            cj = math.floor(
                points[p, 1] + f[1, 0] * centres[w, 0] + f[1, 1] * centres[w, 1] + f[1, 2] * centres[w, 2] + 0.5
            )
            ck = math.floor(
                points[p, 2] + f[2, 0] * centres[w, 0] + f[2, 1] * centres[w, 1] + f[2, 2] * centres[w, 2] + 0.5
            )
            for s in range(sphere.shape[0]):
                i, j, k = ci + sphere[s, 0], cj + sphere[s, 1], ck + sphere[s, 2]
                if i < 1 or j < 1 or k < 1 or i >= ni - 1 or j >= nj - 1 or k >= nk - 1:
                    continue
                if masked and not valid[i, j, k]:
                    continue
                a = volume[i + 1, j, k] - volume[i - 1, j, k]
                b = volume[i, j + 1, k] - volume[i, j - 1, k]
                c = volume[i, j, k + 1] - volume[i, j, k - 1]
                square = a * a + b * b + c * c
                if square < 1e-20:
                    continue
                length = math.sqrt(square)
                x = f[0, 0] * a + f[1, 0] * b + f[2, 0] * c
                y = f[0, 1] * a + f[1, 1] * b + f[2, 1] * c
                z = (f[0, 2] * a + f[1, 2] * b + f[2, 2] * c) / length
                weight = math.sqrt(length)
                band = min(max((z + 1.0) * 0.5 * n_bands - 0.5, 0.0), n_bands - 1.0)
                low_band = min(int(band), n_bands - 2)
                upper = band - low_band
                turn = math.atan2(y, x) * bins_per_radian
                if turn < 0.0:
                    turn += n_bins
                low_bin = int(turn)
                share = turn - low_bin
                low_bin %= n_bins
                high_bin = (low_bin + 1) % n_bins
                out[p, w, low_band, low_bin] += weight * (1.0 - upper) * (1.0 - share)
                out[p, w, low_band, high_bin] += weight * (1.0 - upper) * share
                out[p, w, low_band + 1, low_bin] += weight * upper * (1.0 - share)
                out[p, w, low_band + 1, high_bin] += weight * upper * share
    return out


@numba.njit(cache=True, nogil=True)
def count_inliers(
    R: Float64Array, t: Float64Array, target: Float64Array, source: Float64Array, limit: float
) -> Int64Array:
    """Count the matches that each pose (source to target) brings within the limit."""
    n = R.shape[0]
    count = np.zeros(n, np.int64)
    for p in range(n):
        for m in range(target.shape[0]):
            square = 0.0
            for a in range(3):
                d = t[p, a] - target[m, a]
                for b in range(3):
                    d += R[p, a, b] * source[m, b]
                square += d * d
            if square <= limit * limit:
                count[p] += 1
    return count


@numba.njit(cache=True, nogil=True)
def _trilinear(volume: Float32Array, x: float, y: float, z: float) -> float:
    i = min(max(int(x), 0), volume.shape[0] - 2)
    j = min(max(int(y), 0), volume.shape[1] - 2)
    k = min(max(int(z), 0), volume.shape[2] - 2)
    u, v, w = x - i, y - j, z - k
    a = volume[i, j, k] * (1 - w) + volume[i, j, k + 1] * w
    b = volume[i, j + 1, k] * (1 - w) + volume[i, j + 1, k + 1] * w
    c = volume[i + 1, j, k] * (1 - w) + volume[i + 1, j, k + 1] * w
    d = volume[i + 1, j + 1, k] * (1 - w) + volume[i + 1, j + 1, k + 1] * w
    return (a * (1 - v) + b * v) * (1 - u) + (c * (1 - v) + d * v) * u


@numba.njit(cache=True, nogil=True)
def align_patches(
    target: Float32Array,
    source: Float32Array,
    points: Float64Array,
    R: Float64Array,
    moved: Float64Array,
    patch: Int32Array,
    normal: Float64Array,
    right: Float64Array,
    correlation: Float64Array,
) -> None:
    """One Gauss-Newton step of each patch: normal matrix (n, 3, 3), right side (n, 3) and correlation (n,), -1 outside.

    ``R`` turns target offsets into source offsets; ``moved`` are the points in the source. The unknown is a shift
    of the patch in target axes, in voxels.
    """
    n, m = points.shape[0], patch.shape[0]
    first, second = np.empty(m), np.empty(m)
    slope = np.empty((m, 3))
    reach = patch.max() + 1
    for p in range(n):
        correlation[p] = -1.0
        normal[p] = 0.0
        right[p] = 0.0
        i0, j0, k0 = int(points[p, 0]), int(points[p, 1]), int(points[p, 2])
        outside = False
        for a in range(3):
            outside = outside or int(points[p, a]) < reach or int(points[p, a]) >= target.shape[a] - reach
            outside = outside or moved[p, a] < 0.5 * reach or moved[p, a] > source.shape[a] - 1 - 0.5 * reach
        if outside:
            continue
        mean_t, mean_s = 0.0, 0.0
        for s in range(m):
            i, j, k = i0 + patch[s, 0], j0 + patch[s, 1], k0 + patch[s, 2]
            first[s] = target[i, j, k]
            slope[s, 0] = 0.5 * (target[i + 1, j, k] - target[i - 1, j, k])
            slope[s, 1] = 0.5 * (target[i, j + 1, k] - target[i, j - 1, k])
            slope[s, 2] = 0.5 * (target[i, j, k + 1] - target[i, j, k - 1])
            u, v, w = i - points[p, 0], j - points[p, 1], k - points[p, 2]
            second[s] = _trilinear(
                source,
                moved[p, 0] + R[0, 0] * u + R[0, 1] * v + R[0, 2] * w,
                moved[p, 1] + R[1, 0] * u + R[1, 1] * v + R[1, 2] * w,
                moved[p, 2] + R[2, 0] * u + R[2, 1] * v + R[2, 2] * w,
            )
            mean_t += first[s]
            mean_s += second[s]
        mean_t, mean_s = mean_t / m, mean_s / m
        tt, ss, ts = 0.0, 0.0, 0.0
        for s in range(m):
            a, b = first[s] - mean_t, second[s] - mean_s
            tt += a * a
            ss += b * b
            ts += a * b
        if tt < 1e-12 or ss < 1e-12:
            continue
        correlation[p] = ts / math.sqrt(tt * ss)
        gain = math.sqrt(tt / ss)
        for s in range(m):
            residual = (second[s] - mean_s) * gain - (first[s] - mean_t)
            for a in range(3):
                right[p, a] += slope[s, a] * residual / tt
                for b in range(3):
                    normal[p, a, b] += slope[s, a] * slope[s, b] / tt
