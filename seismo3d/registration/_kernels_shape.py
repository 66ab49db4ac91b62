"""Descriptors of local shape for bare points, and the search for a pose among putative matches."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int64Array

SHELLS = 3
BINS_HEIGHT = 8
BINS_ANGLE = 5
LENGTH = SHELLS * (BINS_HEIGHT + 2 * BINS_ANGLE)


@nb.njit(cache=True, nogil=True, inline="always")
def _add_soft(row: Float32Array, first: int, n_bins: int, value: float, weight: float) -> None:
    """Add a weight to the two bins next to a value from 0 to 1."""
    place = value * n_bins - 0.5
    low = math.floor(place)
    part = place - low
    a = min(max(low, 0), n_bins - 1)
    b = min(max(low + 1, 0), n_bins - 1)
    row[first + a] += weight * (1.0 - part)
    row[first + b] += weight * part


@nb.njit(cache=True, nogil=True)
def shape_descriptors(
    surface: Float32Array,
    rows: Int64Array,
    starts: Int64Array,
    neighbours: Int64Array,
    radius: float,
    out: Float32Array,
) -> None:
    """Describe the shape around surface elements by histograms that turns, and the signs of normals, do not change.

    In shells of distance: the height of the neighbours' directions over the tangent plane (its sign taken so that the
    neighbours lie above on the whole), the angle between both normals, and the angle of the neighbour's normal with the
    connecting line.
    """
    for i in range(rows.shape[0]):
        r = rows[i]
        px, py, pz = surface[r, 0], surface[r, 1], surface[r, 2]
        nx, ny, nz = surface[r, 4], surface[r, 5], surface[r, 6]
        tilt = 0.0
        for k in range(starts[i], starts[i + 1]):
            j = neighbours[k]
            tilt += (surface[j, 0] - px) * nx + (surface[j, 1] - py) * ny + (surface[j, 2] - pz) * nz
        if tilt < 0.0:
            nx, ny, nz = -nx, -ny, -nz
        row = out[i]
        row[:] = 0.0
        for k in range(starts[i], starts[i + 1]):
            j = neighbours[k]
            dx, dy, dz = surface[j, 0] - px, surface[j, 1] - py, surface[j, 2] - pz
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            if distance <= 1e-9 or distance > radius:
                continue
            shell = min(SHELLS - 1, int(SHELLS * distance / radius))
            first = shell * (BINS_HEIGHT + 2 * BINS_ANGLE)
            height = (dx * nx + dy * ny + dz * nz) / distance
            _add_soft(row, first, BINS_HEIGHT, 0.5 * (height + 1.0), 1.0)
            if surface[j, 3] > 0.0:
                mx, my, mz = surface[j, 4], surface[j, 5], surface[j, 6]
                both = abs(nx * mx + ny * my + nz * mz)
                along = abs(dx * mx + dy * my + dz * mz) / distance
                _add_soft(row, first + BINS_HEIGHT, BINS_ANGLE, math.acos(min(1.0, both)) / 1.5708, 1.0)
                _add_soft(row, first + BINS_HEIGHT + BINS_ANGLE, BINS_ANGLE, math.asin(min(1.0, along)) / 1.5708, 1.0)
        for part in range(SHELLS * 3):
            shell, kind = part // 3, part % 3
            first = shell * (BINS_HEIGHT + 2 * BINS_ANGLE)
            first += 0 if kind == 0 else BINS_HEIGHT + (kind - 1) * BINS_ANGLE
            length = BINS_HEIGHT if kind == 0 else BINS_ANGLE
            total = 0.0
            for b in range(first, first + length):
                total += row[b]
            for b in range(first, first + length):
                row[b] = math.sqrt(row[b] / total) if total > 0.0 else 0.0


@nb.njit(cache=True, nogil=True, inline="always")
def _axes(d: Float64Array, n: Float64Array, sign: float, out: Float64Array) -> bool:
    """Write the right-handed frame of a direction and a normal as columns; return False where they are parallel."""
    x, y, z = d[0], d[1], d[2]
    along = n[0] * x + n[1] * y + n[2] * z
    a, b, c = n[0] - along * x, n[1] - along * y, n[2] - along * z
    length = math.sqrt(a * a + b * b + c * c)
    if length < 0.3:
        return False
    a, b, c = sign * a / length, sign * b / length, sign * c / length
    out[0, 0], out[1, 0], out[2, 0] = x, y, z
    out[0, 1], out[1, 1], out[2, 1] = a, b, c
    out[0, 2], out[1, 2], out[2, 2] = y * c - z * b, z * a - x * c, x * b - y * a
    return True


@nb.njit(cache=True, nogil=True, inline="always")
def _turn_in_plane(ds: Float64Array, dt: Float64Array, R: Float64Array) -> None:
    """Write the rotation about the third axis that turns one direction into another."""
    R[:] = 0.0
    R[2, 2] = 1.0
    R[0, 0] = R[1, 1] = dt[0] * ds[0] + dt[1] * ds[1]
    R[1, 0] = ds[0] * dt[1] - ds[1] * dt[0]
    R[0, 1] = -R[1, 0]


@nb.njit(cache=True, nogil=True, inline="always")
def _turn_of_frames(frame_t: Float64Array, frame_s: Float64Array, R: Float64Array) -> None:
    """Write the rotation that turns one frame into another."""
    for a in range(3):
        for b in range(3):
            R[a, b] = frame_t[a, 0] * frame_s[b, 0] + frame_t[a, 1] * frame_s[b, 1] + frame_t[a, 2] * frame_s[b, 2]


@nb.njit(cache=True, nogil=True, inline="always")
def _count_close(target: Float64Array, source: Float64Array, R: Float64Array, shift: Float64Array, limit: float) -> int:
    """Count the matches whose source comes to within the root of a limit of its target."""
    count = 0
    for k in range(target.shape[0]):
        x, y, z = source[k, 0], source[k, 1], source[k, 2]
        ex = R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + shift[0] - target[k, 0]
        ey = R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + shift[1] - target[k, 1]
        ez = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + shift[2] - target[k, 2]
        if ex * ex + ey * ey + ez * ez < limit:
            count += 1
    return count


@nb.njit(cache=True, nogil=True)
def poses_from_pairs(
    target: Float64Array,
    source: Float64Array,
    target_normals: Float64Array,
    source_normals: Float64Array,
    draws: Int64Array,
    tolerance: float,
    least_distance: float,
    d: int,
    out: Float64Array,
    votes: Int64Array,
) -> int:
    """Return how many poses were found from drawn pairs of matches, each with the number of matches that agree with it.

    Two matches with normals fix a pose, up to the normals' signs. A draw is dropped where distances or angles of the
    two matches contradict each other. ``out`` holds (R, t) rows by rows, 12 numbers a pose.
    """
    found = 0
    frame_t = np.empty((3, 3))
    frame_s = np.empty((3, 3))
    dt = np.empty(3)
    ds = np.empty(3)
    R = np.empty((3, 3))
    shift = np.empty(3)
    for draw in range(draws.shape[0]):
        i, j = draws[draw, 0], draws[draw, 1]
        lt = 0.0
        ls = 0.0
        for k in range(3):
            dt[k] = target[j, k] - target[i, k]
            ds[k] = source[j, k] - source[i, k]
            lt += dt[k] * dt[k]
            ls += ds[k] * ds[k]
        lt, ls = math.sqrt(lt), math.sqrt(ls)
        # two matches may share their target
        if ls < least_distance or lt <= 0.0 or abs(lt - ls) > tolerance:
            continue
        a_t = b_t = c_t = a_s = b_s = c_s = 0.0
        for k in range(3):
            dt[k] /= lt
            ds[k] /= ls
            a_t += dt[k] * target_normals[i, k]
            b_t += dt[k] * target_normals[j, k]
            c_t += target_normals[i, k] * target_normals[j, k]
            a_s += ds[k] * source_normals[i, k]
            b_s += ds[k] * source_normals[j, k]
            c_s += source_normals[i, k] * source_normals[j, k]
        if abs(abs(a_t) - abs(a_s)) > 0.2 or abs(abs(b_t) - abs(b_s)) > 0.2 or abs(abs(c_t) - abs(c_s)) > 0.25:
            continue
        if not _axes(ds, source_normals[i], 1.0, frame_s):
            continue
        for s in range(2):
            if d == 2 and s == 1:
                continue
            if not _axes(dt, target_normals[i], 1.0 if s == 0 else -1.0, frame_t):
                continue
            if d == 2:
                _turn_in_plane(ds, dt, R)
            else:
                _turn_of_frames(frame_t, frame_s, R)
            agree = 0.0
            for a in range(3):
                moved = 0.0
                for b in range(3):
                    moved += R[a, b] * source_normals[j, b]
                agree += moved * target_normals[j, a]
            if abs(agree) < 0.85:
                continue
            for a in range(3):
                shift[a] = 0.5 * (target[i, a] + target[j, a])
                for b in range(3):
                    shift[a] -= R[a, b] * 0.5 * (source[i, b] + source[j, b])
            count = _count_close(target, source, R, shift, tolerance * tolerance)
            if count >= 3:
                for a in range(3):
                    for b in range(3):
                        out[found, 3 * a + b] = R[a, b]
                    out[found, 9 + a] = shift[a]
                votes[found] = count
                found += 1
                if found == out.shape[0]:
                    return found
    return found
