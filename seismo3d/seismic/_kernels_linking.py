"""Growing surfaces over ridge points, best point first, and finding where two grown surfaces continue each other."""

from __future__ import annotations

import heapq

import numpy as np
from numba import njit, types
from numba.typed import Dict


@njit(cache=True, nogil=True)
def number_cells(voxels, n0, n1, n2):  # type: ignore[no-untyped-def]
    """Return a number for each cell of 4 x 4 x 4 voxels that holds points, -1 for the others, and how many hold any."""
    cells = np.full(((n0 + 3) >> 2, (n1 + 3) >> 2, (n2 + 3) >> 2), -1, np.int32)
    count = 0
    for a in range(len(voxels)):
        i, j, k = voxels[a, 0] >> 2, voxels[a, 1] >> 2, voxels[a, 2] >> 2
        if cells[i, j, k] < 0:
            cells[i, j, k] = count
            count += 1
    return cells, count


@njit(cache=True, nogil=True)
def fill_cells(voxels, cells, points):  # type: ignore[no-untyped-def]
    """Write, for every cell that holds points, the number of the point in each of its voxels, -1 where there is none.

    This is an index whose memory grows with the number of points, not with the cube.
    """
    points[:] = -1
    for a in range(len(voxels)):
        i, j, k = voxels[a, 0], voxels[a, 1], voxels[a, 2]
        points[cells[i >> 2, j >> 2, k >> 2], ((k & 3) << 4) | ((i & 3) << 2) | (j & 3)] = a


@njit(cache=True, nogil=True)
def find_points(cells, points, i, j, k, reach, holds, but, found):  # type: ignore[no-untyped-def]
    """Write the numbers of the points within reach of a voxel in its time slice; return how many there are.

    Cells are looked up once each: most hold no points. Those that hold nothing `but` one surface are left out, where
    `holds` has a surface for each cell.
    """
    n0, n1 = cells.shape[0] << 2, cells.shape[1] << 2
    i0, i1, j0, j1 = max(0, i - reach), min(n0, i + reach + 1), max(0, j - reach), min(n1, j + reach + 1)
    count = 0
    level = (k & 3) << 4
    for ci in range(i0 >> 2, (i1 + 3) >> 2):
        for cj in range(j0 >> 2, (j1 + 3) >> 2):
            cell = cells[ci, cj, k >> 2]
            if cell < 0 or (len(holds) > 0 and holds[cell] == but):
                continue
            for ii in range(max(i0, ci << 2), min(i1, (ci << 2) + 4)):
                for jj in range(max(j0, cj << 2), min(j1, (cj << 2) + 4)):
                    b = points[cell, level | ((ii & 3) << 2) | (jj & 3)]
                    if b >= 0:
                        found[count] = b
                        count += 1
    return count


@njit(cache=True, nogil=True)
def _on_each_other(positions, normals, a, b, least_cosine, off_plane):  # type: ignore[no-untyped-def]
    """Whether two points' planes agree and each point lies on the other's plane."""
    cosine = np.float32(0.0)
    from_a = np.float32(0.0)
    from_b = np.float32(0.0)
    for d in range(3):
        step = positions[b, d] - positions[a, d]
        cosine += normals[a, d] * normals[b, d]
        from_a += normals[a, d] * step
        from_b += normals[b, d] * step
    return abs(cosine) >= least_cosine and abs(from_a) <= off_plane and abs(from_b) <= off_plane


@njit(cache=True, nogil=True)
def _carried(voxels, normals, a, down):  # type: ignore[no-untyped-def]
    """Inline and crossline at which a point's plane, straight down its dip, is `down` samples deeper."""
    flat = normals[a, 0] * normals[a, 0] + normals[a, 1] * normals[a, 1]
    move = -normals[a, 2] * down / max(flat, np.float32(1e-6))
    return int(np.rint(voxels[a, 0] + move * normals[a, 0])), int(np.rint(voxels[a, 1] + move * normals[a, 1]))


@njit(cache=True, nogil=True)
def grow_surfaces(  # type: ignore[no-untyped-def]
    voxels,
    positions,
    normals,
    score,
    order,
    shape,
    index,
    step,
    reach,
    least_cosine,
    off_plane,
    fold,
    widest,
    first,
    number,
    most,
    height,
    owner,
    label,
):
    """Write the surface number of every point, growing each surface from the best point that is still free.

    A surface takes the best free point beside it that lies on the plane of the point it is reached from; beside means
    near where that plane passes through the levels above and below, which a low dip carries far off. A surface is a
    height field over its seed's plane: a point that would be its second one at a place (farther than `fold` from the
    first), or whose plane turns away too far from the seed's (cosine below `widest`), stays free.

    Begins with the seed at `first` of the order and surface `number`, and pauses between two surfaces once `most`
    points are taken: returns the next seed's place and surface. `height` and `owner` have room for each place of a
    surface: (2 (inlines + crosslines) + 1, levels); `label` and `owner` are -1 at first. A point that waits to be taken
    has the label -2: it waits once.
    """
    n0, n1, n2 = shape
    cells, points = index
    found, any_cell = np.empty((2 * reach + 1) ** 2, np.int64), np.empty(0, np.int32)
    span = n0 + n1
    taken = 0
    for place in range(first, len(order)):
        if taken >= most:
            return place, number
        seed = order[place]
        if label[seed] >= 0:
            continue
        length = np.hypot(normals[seed, 0], normals[seed, 1])
        nx, ny = normals[seed, 0] / length, normals[seed, 1] / length
        cotangent = -normals[seed, 2] / length
        heap = [(-score[seed], np.int64(seed))]
        while len(heap) > 0:
            _, a = heapq.heappop(heap)
            label[a] = -1
            x, y = positions[a, 0] - positions[seed, 0], positions[a, 1] - positions[seed, 1]
            w = nx * x + ny * y - cotangent * (positions[a, 2] - positions[seed, 2])
            row = int(np.rint(nx * y - ny * x)) + span
            k = voxels[a, 2]
            fits = True
            for dr in range(-1, 2):
                for dk in range(-1, 2):
                    r, kk = row + dr, k + dk
                    if (
                        0 <= r < 2 * span + 1
                        and 0 <= kk < n2
                        and owner[r, kk] == number
                        and abs(height[r, kk] - w) > fold
                    ):
                        fits = False
            if not fits:
                continue
            label[a] = number
            taken += 1
            owner[row, k] = number
            height[row, k] = w
            for kk in range(max(0, k - reach), min(n2, k + reach + 1)):
                i, j = _carried(voxels, normals, a, (kk - k) * step)
                for m in range(find_points(cells, points, i, j, kk, reach, any_cell, 0, found)):
                    b = found[m]
                    if label[b] != -1:
                        continue
                    turned = (
                        normals[b, 0] * normals[seed, 0]
                        + normals[b, 1] * normals[seed, 1]
                        + normals[b, 2] * normals[seed, 2]
                    )
                    if abs(turned) < widest:
                        continue
                    if _on_each_other(positions, normals, a, b, least_cosine, off_plane):
                        heapq.heappush(heap, (-score[b], b))
                        label[b] = -2
        number += 1
    return len(order), number


@njit(cache=True, nogil=True)
def find_lone_surfaces(voxels, label, cells, n_cells):  # type: ignore[no-untyped-def]
    """Return the surface of each cell whose points are of no other; -1 where none is, -2 where more are."""
    holds = np.full(n_cells, -1, np.int32)
    for a in range(len(voxels)):
        if label[a] >= 0:
            cell = cells[voxels[a, 0] >> 2, voxels[a, 1] >> 2, voxels[a, 2] >> 2]
            if holds[cell] == -1:
                holds[cell] = label[a]
            elif holds[cell] != label[a]:
                holds[cell] = -2
    return holds


@njit(cache=True, nogil=True)
def _add(near, along, one, other, n_surfaces, n_near, n_along):  # type: ignore[no-untyped-def]
    """Add to the counts of two surfaces; no count is kept where there is nothing to add."""
    key = min(one, other) * n_surfaces + max(one, other)
    if n_near > 0:
        near[key] = near.get(key, 0) + n_near
    if n_along > 0:
        along[key] = along.get(key, 0) + n_along


@njit(cache=True, nogil=True)
def count_contacts(  # type: ignore[no-untyped-def]
    voxels,
    positions,
    normals,
    label,
    n_surfaces,
    shape,
    index,
    holds,
    step,
    reach,
    least_cosine,
    off_plane,
    first,
    last,
):
    """Return a row (surface, surface, pairs of near points, those of them that agree) for every two in touch.

    Counts what is seen from the points `first` to `last`. `holds` is from :func:`find_lone_surfaces`.
    """
    near, along = Dict.empty(types.int64, types.int64), Dict.empty(types.int64, types.int64)
    n2 = shape[2]
    cells, points = index
    found = np.empty((2 * reach + 1) ** 2, np.int64)
    for a in range(first, last):
        la = np.int64(label[a])
        if la < 0:
            continue
        k = voxels[a, 2]
        # neighbours of one surface mostly come one after another: they are added up together
        other, n_near, n_along = np.int64(-1), 0, 0
        for kk in range(max(0, k - reach), min(n2, k + reach + 1)):
            i, j = _carried(voxels, normals, a, (kk - k) * step)
            for m in range(find_points(cells, points, i, j, kk, reach, holds, la, found)):
                b = found[m]
                lb = np.int64(label[b])
                if lb < 0 or lb == la:
                    continue
                if lb != other:
                    _add(near, along, la, other, n_surfaces, n_near, n_along)
                    other, n_near, n_along = lb, 0, 0
                n_near += 1
                n_along += _on_each_other(positions, normals, a, b, least_cosine, off_plane)
        _add(near, along, la, other, n_surfaces, n_near, n_along)
    rows = np.empty((len(near), 4), np.int64)
    for row, key in enumerate(near):
        rows[row, 0], rows[row, 1] = key // n_surfaces, key % n_surfaces
        rows[row, 2], rows[row, 3] = near[key], along.get(key, 0)
    return rows
