"""Compiled loops that follow grains from before a fault moved to where they lie today."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import numpy as np
from numba import njit, prange

from seismo3d.synthetic import _kernels as k
from seismo3d.synthetic._kernels import _bend, _ramp, _slide

ROUNDS = 80


@njit(cache=True, nogil=True)
def undo_on_side(place, f, hanging):
    """Return where a grain lay before a fault moved, taken to be on a given side of it."""
    ui, ux, z = place[0] - f[k.CI], place[1] - f[k.CX], place[2] - f[k.CS]
    a = ui * f[k.DX] - ux * f[k.DI]
    bent = ui * f[k.DI] + ux * f[k.DX] - _bend(a, f)
    out = place.copy()
    if f[k.SHAPE] == k.LISTRIC:
        if hanging:
            heave = f[k.THROW] * f[k.COT] * k.slip_profile(a, z, f)
            out[0] -= heave * f[k.DI]
            out[1] -= heave * f[k.DX]
            out[2] -= _ramp(bent, f) - _ramp(bent - heave, f)
        return out
    moved = f[k.THROW] * k.slip_profile(a, z, f) * (f[k.SHARE] if hanging else f[k.SHARE] - 1.0)
    if f[k.DRAG] > 0.0:
        side = bent - z * (f[k.COT] + 0.5 * f[k.BEND_S] * z)
        moved *= max(0.0, 1.0 - abs(side) * f[k.SIN_DIP] / f[k.DRAG]) ** 2
    down_dip, along = _slide(a, z, moved, f)
    out[0] -= down_dip * f[k.DI] + along * f[k.DX]
    out[1] -= down_dip * f[k.DX] - along * f[k.DI]
    out[2] -= moved
    return out


@njit(cache=True, nogil=True)
def move_on_side(place, f, hanging):
    """Return where a grain that lay at a place lies after the fault has moved; NaN where no place maps back to it."""
    out = place.copy()
    for _ in range(ROUNDS):
        back = undo_on_side(out, f, hanging)
        worst = 0.0
        for d in range(3):
            out[d] += place[d] - back[d]
            worst = max(worst, abs(place[d] - back[d]))
        if worst < 1e-4:
            return out
    out[:] = np.nan
    return out


@njit(cache=True, nogil=True)
def _move(place, f):
    """Move a grain by a fault of which it is not told on which side it lies."""
    for hanging in (True, False):
        out = move_on_side(place, f, hanging)
        if (k.undo_fault(out[0], out[1], out[2], f)[3] > 0.0) == hanging:
            return out
    out = place.copy()
    out[:] = np.nan
    return out


@njit(cache=True, nogil=True)
def _undo_from(place, faults, first):
    """Bring a grain, in place, back to before the faults from a first one on moved."""
    for m in range(len(faults) - 1, first - 1, -1):
        place[0], place[1], place[2] = k.undo_fault(place[0], place[1], place[2], faults[m])[:3]


@njit(cache=True, nogil=True)
def _move_from(place, faults, first):
    """Return where a grain lies after the faults from a first one on have moved."""
    for m in range(first, len(faults)):
        place = _move(place, faults[m])
    return place


@njit(cache=True, nogil=True, parallel=True)
def find_counterparts(voxels, numbers, faults):
    """Vectors to voxels of faults (numbered from the oldest, 0) from where their footwall counterparts lie today."""
    slips = np.empty(voxels.shape)
    for n in prange(len(voxels)):
        place = voxels[n].copy()
        _undo_from(place, faults, numbers[n] + 1)
        place = move_on_side(undo_on_side(place, faults[numbers[n]], True), faults[numbers[n]], False)
        place = _move_from(place, faults, numbers[n] + 1)
        for d in range(3):
            slips[n, d] = voxels[n, d] - place[d]
    return slips


@njit(cache=True, nogil=True, parallel=True)
def follow_grains(shape, faults):
    """Vectors from every place of a grid to where the grain that lay there before all faults moved lies today."""
    moves = np.empty((3, shape[0], shape[1], shape[2]), np.float32)
    for i in prange(shape[0]):
        for x in range(shape[1]):
            for s in range(shape[2]):
                place = _move_from(np.array([float(i), float(x), float(s)]), faults, 0)
                moves[0, i, x, s] = place[0] - i
                moves[1, i, x, s] = place[1] - x
                moves[2, i, x, s] = place[2] - s
    return moves


@njit(cache=True, nogil=True, parallel=True)
def undo_all(points, faults):
    """Return where grains lay before all faults moved that lie at points today."""
    before = points.copy()
    for n in prange(len(points)):
        _undo_from(before[n], faults, 0)
    return before
