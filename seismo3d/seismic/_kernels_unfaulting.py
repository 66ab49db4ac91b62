"""Where a surface crosses the edges of the grid, with what is known at its nodes."""

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
