"""Compiled ray tracer of the synthetic rooms and terrains: exact depth, and colour with detail at every scale.

A scene is a table of shapes, one row of ``N_COLUMNS`` numbers each (boxes seen from outside or inside, spheres), and a
relief: the coefficients of a uniform cubic B-spline over x and y, without any where its table is empty. Rays start in
the camera and are given at depth 1, so that the parameter of a hit is its depth.
"""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

KIND, CX, CY, CZ, R0 = 0, 1, 2, 3, 4
HX, HY, HZ, RED, GREEN, BLUE, SEED = 13, 14, 15, 16, 17, 18, 19
N_COLUMNS = 20
BOX, INSIDE, SPHERE = 0, 1, 2
RELIEF, SKY = -1, -2
N_OCTAVES = 7
TILE = 8
_CELLS = 1.1 * 0.42 ** np.arange(N_OCTAVES)
_COS, _SIN = np.cos(0.6 + 1.9 * np.arange(N_OCTAVES)), np.sin(0.6 + 1.9 * np.arange(N_OCTAVES))
_AMPLITUDES = 62.0 * 0.92 ** np.arange(N_OCTAVES)
_MASK = np.uint64(0xFFFFFFFF)


@njit(cache=True, nogil=True, inline="always")
def _mix(key):
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


@njit(cache=True, nogil=True)
def hashed(a, b, c):
    """64 bits that depend on three integers and on nothing else."""
    key = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(b) * np.uint64(0xD1B54A32D192ED03)
    return _mix(key + np.uint64(c) * np.uint64(0x8CB92BA72F3D8DD7))


@njit(cache=True, nogil=True)
def normal_number(a, b, c):
    """Return a standard normal number that depends on three integers and on nothing else (Box and Muller)."""
    bits = hashed(a, b, c)
    u = (np.float64(bits >> np.uint64(32)) + 0.5) / 4294967296.0
    v = np.float64(bits & _MASK) / 4294967296.0
    return math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v)


@njit(cache=True, nogil=True)
def _texture(u, v, seed, footprint, out):
    """Add patches of random colour at all scales to ``out``; edges are soft to the pixel's footprint in metres."""
    for octave in range(N_OCTAVES):
        cell = _CELLS[octave]
        width = footprint / cell
        if width > 1.0:
            return
        amplitude = _AMPLITUDES[octave] * min(1.0, 2.0 - 2.0 * width)
        c, s = _COS[octave] / cell, _SIN[octave] / cell
        x, y = c * u - s * v, s * u + c * v
        i, j = math.floor(x), math.floor(y)
        soft = max(width, 0.12)
        a = min(max((x - i - 0.5) / soft + 0.5, 0.0), 1.0)
        b = min(max((y - j - 0.5) / soft + 0.5, 0.0), 1.0)
        key = seed * 64 + octave
        weights = ((1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b)
        for corner in range(4):
            w = weights[corner]
            if w == 0.0:
                continue
            bits = hashed(np.int64(i) + (corner & 1), np.int64(j) + (corner >> 1), key)
            w *= amplitude
            grey = np.float64(bits & np.uint64(0xFFFF)) / 65535.0 - 0.5
            for channel in range(3):
                bits = bits >> np.uint64(16)
                out[channel] += w * (grey + 0.5 * (np.float64(bits & np.uint64(0xFFFF)) / 65535.0 - 0.5))


@njit(cache=True, nogil=True)
def relief_at(x, y, relief, frame):
    """Height of the relief and its slopes along x and y, held at the value of the edge beyond it.

    ``frame`` is (x, y) of the first coefficient and their spacing.
    """
    fx = min(max((x - frame[0]) / frame[2], 1.0), relief.shape[1] - 2.000001)
    fy = min(max((y - frame[1]) / frame[2], 1.0), relief.shape[0] - 2.000001)
    i, j = int(fx), int(fy)
    f, g = fx - i, 1.0 - (fx - i)
    w0, w3 = g * g * g / 6.0, f * f * f / 6.0
    w1 = (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0
    w2 = 1.0 - w0 - w1 - w3
    d0, d1, d2, d3 = -0.5 * g * g, 1.5 * f * f - 2.0 * f, 2.0 * g - 1.5 * g * g, 0.5 * f * f
    f, g = fy - j, 1.0 - (fy - j)
    v = (g * g * g / 6.0, (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0, 0.0, f * f * f / 6.0)
    v = (v[0], v[1], 1.0 - v[0] - v[1] - v[3], v[3])
    e = (-0.5 * g * g, 1.5 * f * f - 2.0 * f, 2.0 * g - 1.5 * g * g, 0.5 * f * f)
    h, hx, hy = 0.0, 0.0, 0.0
    for n in range(4):
        a, b = relief[j - 1 + n, i - 1], relief[j - 1 + n, i]
        c, d = relief[j - 1 + n, i + 1], relief[j - 1 + n, i + 2]
        row = w0 * a + w1 * b + w2 * c + w3 * d
        h += v[n] * row
        hx += v[n] * (d0 * a + d1 * b + d2 * c + d3 * d)
        hy += e[n] * row
    return h, hx / frame[2], hy / frame[2]


@njit(cache=True, nogil=True)
def relief_heights(points, relief, frame, out):
    """Write (height, slope along x, slope along y) at points (n, 2) into ``out`` (n, 3)."""
    for n in range(len(points)):
        out[n] = relief_at(points[n, 0], points[n, 1], relief, frame)


@njit(cache=True, nogil=True)
def relief_tiles(relief, frame, out):
    """Write the greatest height and slope of the relief in each square of ``TILE`` cells; bounds, not samples.

    A spline's value, and its slope, never leave the range of its coefficients, and of their differences.
    """
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            highest, across, down = -np.inf, 0.0, 0.0
            for j in range(row * TILE, min((row + 1) * TILE + 3, relief.shape[0])):
                for i in range(column * TILE, min((column + 1) * TILE + 3, relief.shape[1])):
                    highest = max(highest, relief[j, i])
                    if i > column * TILE:
                        across = max(across, abs(relief[j, i] - relief[j, i - 1]))
                    if j > row * TILE:
                        down = max(down, abs(relief[j, i] - relief[j - 1, i]))
            out[row, column, 0], out[row, column, 1] = highest, math.sqrt(across**2 + down**2) / frame[2]


@njit(cache=True, nogil=True, inline="always")
def _leave_tile(o, d, t, frame, size, index, axis):
    """Depth at which a ray leaves its tile along one axis, and a hair more."""
    if d[axis] == 0.0:
        return np.inf
    edge = frame[axis] + frame[2] + size * (index + (1 if d[axis] > 0.0 else 0))
    return max((edge - o[axis]) / d[axis], t) + 1e-9


@njit(cache=True, nogil=True)
def _polish(o, d, t, relief, frame):
    """Newton's steps to where a ray meets the relief; infinity where they don't settle."""
    for _ in range(6):
        h, hx, hy = relief_at(o[0] + t * d[0], o[1] + t * d[1], relief, frame)
        gap = o[2] + t * d[2] - h
        if abs(gap) < 1e-9:
            return t
        rate = d[2] - hx * d[0] - hy * d[1]
        if rate >= 0.0:
            return np.inf
        t -= gap / rate
    return t if abs(gap) < 1e-6 else np.inf


@njit(cache=True, nogil=True)
def _meet_relief(o, d, relief, frame, tiles, limit):
    """Depth at which a ray meets the relief from above, or infinity.

    From tile to tile: over one whose highest point the ray clears in one step, else by steps that can't overshoot
    with the tile's slope, and Newton's at the end.
    """
    flat = math.sqrt(d[0] * d[0] + d[1] * d[1])
    size = TILE * frame[2]
    t = 0.0
    for _ in range(1000):
        x, y = o[0] + t * d[0], o[1] + t * d[1]
        i = math.floor((x - frame[0] - frame[2]) / size)
        j = math.floor((y - frame[1] - frame[2]) / size)
        if t > limit or i < 0 or j < 0 or i >= tiles.shape[1] or j >= tiles.shape[0]:
            return np.inf
        leave = min(_leave_tile(o, d, t, frame, size, i, 0), _leave_tile(o, d, t, frame, size, j, 1))
        fall = tiles[j, i, 1] * flat - d[2]
        z = o[2] + t * d[2]
        if min(z, z + (min(leave, limit) - t) * d[2]) > tiles[j, i, 0]:
            if leave == np.inf:
                return np.inf
            t = leave
            continue
        h, hx, hy = relief_at(x, y, relief, frame)
        gap = z - h
        rate = d[2] - hx * d[0] - hy * d[1]
        if gap < 1e-7:
            return t
        if rate < 0.0 and gap * flat < -0.02 * rate:  # within two centimetres, less than the relief's bends
            root = _polish(o, d, t - gap / rate, relief, frame)
            if abs(root - t) * flat < 0.04:
                return root
        t = leave if fall <= 0.0 else min(t + gap / fall, leave)
        if t == np.inf:
            return np.inf
    return np.inf


@njit(cache=True, nogil=True)
def _meet_shape(o, d, shape, near, normal, local):
    """Depth at which a ray meets a shape, if below ``near``; then its normal and texture place are written too."""
    p0, p1, p2 = o[0] - shape[CX], o[1] - shape[CY], o[2] - shape[CZ]
    if shape[KIND] == SPHERE:
        a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        b = p0 * d[0] + p1 * d[1] + p2 * d[2]
        c = p0 * p0 + p1 * p1 + p2 * p2 - shape[HX] * shape[HX]
        root = b * b - a * c
        if root <= 0.0:
            return near
        t = (-b - math.sqrt(root)) / a
        if t <= 1e-6 or t >= near:
            return near
        q0, q1, q2 = p0 + t * d[0], p1 + t * d[1], p2 + t * d[2]
        normal[0], normal[1], normal[2] = q0 / shape[HX], q1 / shape[HX], q2 / shape[HX]
        for axis in range(3):
            local[axis] = q0 * shape[R0 + axis] + q1 * shape[R0 + 3 + axis] + q2 * shape[R0 + 6 + axis]
        return t
    first, last, face_in, face_out = -np.inf, np.inf, 0, 0
    for axis in range(3):
        p = p0 * shape[R0 + axis] + p1 * shape[R0 + 3 + axis] + p2 * shape[R0 + 6 + axis]
        q = d[0] * shape[R0 + axis] + d[1] * shape[R0 + 3 + axis] + d[2] * shape[R0 + 6 + axis]
        half = shape[HX + axis]
        if abs(q) < 1e-12:
            if abs(p) > half:
                return near
            continue
        side = half if q > 0.0 else -half
        enter, leave = (-side - p) / q, (side - p) / q
        if enter > first:
            first, face_in = enter, axis
        if leave < last:
            last, face_out = leave, axis
    t = last if shape[KIND] == INSIDE else first
    face = face_out if shape[KIND] == INSIDE else face_in
    if first >= last or t <= 1e-6 or t >= near:
        return near
    away = 0.0
    for axis in range(3):
        local[axis] = (
            (p0 + t * d[0]) * shape[R0 + axis]
            + (p1 + t * d[1]) * shape[R0 + 3 + axis]
            + (p2 + t * d[2]) * shape[R0 + 6 + axis]
        )
        normal[axis] = shape[R0 + 3 * axis + face]
        away += normal[axis] * d[axis]
    if away > 0.0:
        for axis in range(3):
            normal[axis] = -normal[axis]
    return t


@njit(cache=True, nogil=True)
def _paint(shape, local, footprint, colour):
    """Colour of a shape's skin: its own, with texture laid on the face that the place lies on."""
    face, most = 0, -1.0
    for axis in range(3):
        reach = abs(local[axis]) / shape[HX + axis]
        if reach > most:
            face, most = axis, reach
    u, v = local[(face + 1) % 3], local[(face + 2) % 3]
    if shape[KIND] == SPHERE:
        stretch = shape[HX] / max(abs(local[face]), 1e-9)
        u, v = u * stretch, v * stretch
    colour[0], colour[1], colour[2] = shape[RED], shape[GREEN], shape[BLUE]
    side = 2 * face + (1 if local[face] > 0.0 else 0)
    _texture(u, v, np.int64(shape[SEED]) * 6 + side, footprint, colour)


@njit(cache=True, nogil=True)
def _bounds(shapes, T, out):
    """Write the rays (x and y at depth 1) between which each shape can be seen; all where it is near or around."""
    for n in range(len(shapes)):
        shape = shapes[n]
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = -np.inf, np.inf, -np.inf, np.inf
        radius = shape[HX]
        if shape[KIND] != SPHERE:
            radius = math.sqrt(shape[HX] ** 2 + shape[HY] ** 2 + shape[HZ] ** 2)
        c = np.zeros(3)
        for axis in range(3):
            for other in range(3):
                c[axis] += T[other, axis] * (shape[CX + other] - T[other, 3])
        if shape[KIND] == INSIDE or c[0] * c[0] + c[1] * c[1] + c[2] * c[2] <= radius * radius * 1.01:
            continue
        if c[2] < -radius:
            out[n, 0], out[n, 1] = np.inf, -np.inf
            continue
        if c[2] <= radius * 1.01:
            continue
        for axis in range(2):
            near = 1.0 / (c[2] - radius), 1.0 / (c[2] + radius)
            low, high = c[axis] - radius, c[axis] + radius
            out[n, 2 * axis] = min(low * near[0], low * near[1])
            out[n, 2 * axis + 1] = max(high * near[0], high * near[1])


@njit(cache=True, nogil=True, parallel=True)
def render(rays, T, shapes, relief, frame, tiles, ground, light, pixel, depth, facing, colour, owner):
    """Trace every pixel's ray: depth in metres (NaN in the sky), cosine of incidence, colour 0 to 255, shape's number.

    ``rays`` (rows, columns, 2) at depth 1; ``T`` camera to world; ``ground`` colour and seed of the relief; ``light``
    a unit vector towards the light; ``pixel`` the width of a pixel at depth 1.
    """
    rows, columns = depth.shape
    seen = np.empty((len(shapes), 4))
    _bounds(shapes, T, seen)
    for row in prange(rows):
        o, d, normal, local = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        best_normal, best_local, rgb = np.empty(3), np.empty(3), np.empty(3)
        o[0], o[1], o[2] = T[0, 3], T[1, 3], T[2, 3]
        lowest, highest = rays[row, :, 1].min(), rays[row, :, 1].max()
        active, count = np.empty(len(shapes), np.int64), 0
        for n in range(len(shapes)):
            if seen[n, 2] <= highest and seen[n, 3] >= lowest and seen[n, 0] <= seen[n, 1]:
                active[count] = n
                count += 1
        for column in range(columns):
            x, y = rays[row, column, 0], rays[row, column, 1]
            for axis in range(3):
                d[axis] = T[axis, 0] * x + T[axis, 1] * y + T[axis, 2]
            near, who = np.inf, SKY
            for item in range(count):
                n = active[item]
                if x < seen[n, 0] or x > seen[n, 1] or y < seen[n, 2] or y > seen[n, 3]:
                    continue
                t = _meet_shape(o, d, shapes[n], near, normal, local)
                if t < near:
                    near, who = t, n
                    best_normal[:], best_local[:] = normal, local
            if len(relief) > 0:
                t = _meet_relief(o, d, relief, frame, tiles, near)
                if t < near:
                    near, who = t, RELIEF
                    best_local[0], best_local[1] = o[0] + t * d[0], o[1] + t * d[1]
                    _, hx, hy = relief_at(best_local[0], best_local[1], relief, frame)
                    length = math.sqrt(1.0 + hx * hx + hy * hy)
                    best_normal[0], best_normal[1], best_normal[2] = -hx / length, -hy / length, 1.0 / length
            owner[row, column] = who
            if who == SKY:
                depth[row, column], facing[row, column] = np.nan, 0.0
                shade = 60.0 * min(max(d[2], 0.0), 1.0)
                colour[row, column, 0], colour[row, column, 1] = 190.0 - shade, 205.0 - 0.7 * shade
                colour[row, column, 2] = 225.0
                continue
            length = math.sqrt(x * x + y * y + 1.0)
            lit, cosine = 0.0, 0.0
            for axis in range(3):
                cosine -= best_normal[axis] * d[axis] / length
                lit += best_normal[axis] * light[axis]
            depth[row, column], facing[row, column] = near, cosine
            footprint = pixel * near / max(cosine, 0.15)
            if who == RELIEF:
                rgb[0], rgb[1], rgb[2] = ground[0], ground[1], ground[2]
                _texture(best_local[0], best_local[1], np.int64(ground[3]), footprint, rgb)
            else:
                _paint(shapes[who], best_local, footprint, rgb)
            shade = 0.72 + 0.28 * lit
            for channel in range(3):
                colour[row, column, channel] = min(max(shade * rgb[channel], 0.0), 255.0)
