"""Where fault surfaces cross the edges of the grid, and what lies on their two sides."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def cross_edges(vertices, values, cells, shape, edges, found):  # type: ignore[no-untyped-def]
    """Write every edge of the grid that a triangle crosses, and the values there with the sign of the crossing.

    Edge ``axis * size + voxel`` goes from a voxel to the next along an axis. The sign is that of the component along
    the axis of the triangle's normal, by the right-hand rule. Gives how many there are; where they are more than the
    arrays hold, only the count is right. Edges on a side of two triangles are written twice.
    """
    count = 0
    slack = 1e-5
    at = np.zeros(3, np.int64)
    size = shape[0] * shape[1] * shape[2]
    for t in range(len(cells)):
        a, b, c = cells[t, 0], cells[t, 1], cells[t, 2]
        for axis in range(3):
            u_axis, v_axis = (axis + 1) % 3, (axis + 2) % 3
            u0, v0, w0 = vertices[a, u_axis], vertices[a, v_axis], vertices[a, axis]
            u1, v1, w1 = vertices[b, u_axis] - u0, vertices[b, v_axis] - v0, vertices[b, axis] - w0
            u2, v2, w2 = vertices[c, u_axis] - u0, vertices[c, v_axis] - v0, vertices[c, axis] - w0
            area = u1 * v2 - u2 * v1
            if abs(area) < 1e-9:
                continue
            low_u = max(int(np.ceil(u0 + min(0.0, u1, u2) - slack)), 0)
            high_u = min(int(np.floor(u0 + max(0.0, u1, u2) + slack)), shape[u_axis] - 1)
            low_v = max(int(np.ceil(v0 + min(0.0, v1, v2) - slack)), 0)
            high_v = min(int(np.floor(v0 + max(0.0, v1, v2) + slack)), shape[v_axis] - 1)
            sign = 1.0 if area > 0 else -1.0
            for u in range(low_u, high_u + 1):
                for v in range(low_v, high_v + 1):
                    du, dv = u - u0, v - v0
                    p = (du * v2 - dv * u2) / area
                    q = (u1 * dv - v1 * du) / area
                    if p < -slack or q < -slack or p + q > 1.0 + slack:
                        continue
                    place = int(np.floor(w0 + p * w1 + q * w2))
                    if not 0 <= place < shape[axis] - 1:
                        continue
                    if count < len(edges):
                        at[axis], at[u_axis], at[v_axis] = place, u, v
                        edges[count] = axis * size + (at[0] * shape[1] + at[1]) * shape[2] + at[2]
                        for k in range(values.shape[1]):
                            value = (1.0 - p - q) * values[a, k] + p * values[b, k] + q * values[c, k]
                            found[count, k] = sign * value
                    count += 1
    return count


@njit(cache=True, nogil=True)
def read_side(volume, valid, p, q, step, places, away, near, far, side, known):  # type: ignore[no-untyped-def]
    """Write the mean of the traces `near` to `far` off each place, carried to it along their own slopes."""
    n0, n1, n2 = volume.shape
    m = p.shape[2]
    for n in range(len(places)):
        if not np.isfinite(places[n, 0]):
            continue
        total, count = 0.0, 0
        for t in range(near, far + 1):
            x, y = places[n, 0] + t * away[0], places[n, 1] + t * away[1]
            i, j = int(np.rint(x)), int(np.rint(y))
            if i < 1 or j < 1 or i >= n0 - 1 or j >= n1 - 1:
                continue
            k = min(max(int(np.rint(places[n, 2] / step)), 0), m - 1)
            # both slopes are read on the far side of the trace, away from the surface
            ip = i if away[0] > 0 else i - 1
            jq = j if away[1] > 0 else j - 1
            z = places[n, 2] + (i - places[n, 0]) * p[ip, j, k] + (j - places[n, 1]) * q[i, jq, k]
            b = int(np.floor(z))
            if b < 0 or b + 1 >= n2 or not (valid[i, j, b] and valid[i, j, b + 1]):
                continue
            f = z - b
            total += (1.0 - f) * volume[i, j, b] + f * volume[i, j, b + 1]
            count += 1
        if count > 0:
            side[n] = total / count
            known[n] = 1.0


@njit(cache=True, nogil=True)
def match_sides(sides, known, throw, products):  # type: ignore[no-untyped-def]
    """Write what the least-squares throw needs: weight, g g, g (a - b), (a - b)^2 and a a + b b at every node."""
    _, n_rows, n = sides.shape
    for r in range(n_rows):
        for k in range(n):
            up, down = k - 0.5 * throw[r, k], k + 0.5 * throw[r, k]
            a, b = int(np.floor(up)), int(np.floor(down))
            if a < 1 or b < 1 or a + 2 >= n or b + 2 >= n:
                continue
            if not (known[0, r, a] > 0 and known[0, r, a + 1] > 0 and known[1, r, b] > 0 and known[1, r, b + 1] > 0):
                continue
            f, g = up - a, down - b
            left = (1.0 - f) * sides[0, r, a] + f * sides[0, r, a + 1]
            right = (1.0 - g) * sides[1, r, b] + g * sides[1, r, b + 1]
            rise = 0.0
            if known[0, r, a - 1] > 0 and known[1, r, b - 1] > 0 and known[0, r, a + 2] > 0 and known[1, r, b + 2] > 0:
                rise = 0.25 * (
                    (1.0 - f) * (sides[0, r, a + 1] - sides[0, r, a - 1])
                    + f * (sides[0, r, a + 2] - sides[0, r, a])
                    + (1.0 - g) * (sides[1, r, b + 1] - sides[1, r, b - 1])
                    + g * (sides[1, r, b + 2] - sides[1, r, b])
                )
            products[0, r, k] = 1.0
            products[1, r, k] = rise * rise
            products[2, r, k] = rise * (left - right)
            products[3, r, k] = (left - right) ** 2
            products[4, r, k] = left * left + right * right
