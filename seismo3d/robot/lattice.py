"""The lattice of feasible motions: place by place and heading by heading, forwards, never turning too tightly.

Headings are the 16 directions to the cells around a block of 5 x 5, so that each leads straight to a cell's middle.
From each there is one straight step, and one turn to either neighbouring heading: a line, an arc of a circle and a
line, joined without a kink, to the nearest cell that leaves room for the arc. Turning counts a tenth more than driving
straight on: of ways of one length, the one with the fewest turns is taken.
"""

from __future__ import annotations

import math

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_number, freeze
from seismo3d.errors import ParameterError
from seismo3d.robot.motions import SIDE, Motion, Motions, make_motions

_QUADRANT = ((1, 0), (2, 1), (1, 1), (1, 2))
DIRECTIONS = tuple((c * x - s * y, s * x + c * y) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)) for x, y in _QUADRANT)
"""(columns, rows) of the 16 headings, counterclockwise from x."""
_FINE = 1e-3
_STEP = 0.5
_WIDEST = 200.0
_TURN_PRICE = 1.1


def lattice_motions(radius: float) -> Motions:
    """Make the motions of a robot that drives forwards.

    Parameters
    ----------
    radius : float
        Least radius of a turn, in cells.

    Returns
    -------
    Motions
        48 of them.

    Raises
    ------
    ParameterError
        If the radius is not positive, or so large that a turn would span hundreds of cells.
    """
    r = as_number(radius, "radius", low=0.0, strict=True)
    if r > _WIDEST:
        raise ParameterError(
            f"the least turning radius is {r:.0f} cells; expected at most {_WIDEST:.0f}. Use larger cells."
        )
    headings = np.array([math.atan2(y, x) % (2 * math.pi) for x, y in DIRECTIONS])
    steps = []
    for k, (x, y) in enumerate(DIRECTIONS):
        steps.append(_along(k, k, x, y, [(0.0, math.hypot(x, y))], headings[k]))
        steps.extend(_turn(k, (k + turn) % 16, headings, r) for turn in (1, -1))
    angles = np.radians(np.arange(0.0, 90.1, 11.25))
    # rounded towards zero: never longer than the way itself
    floor = np.floor(SIDE * np.stack([np.cos(angles), np.sin(angles)], axis=1) + 1e-9)
    return make_motions(headings, steps, floor)


def _turn(k: int, after: int, headings: Float64Array, radius: float) -> Motion:
    """Return the shortest turn from one heading to the next: to the nearest cell whose tangents leave room."""
    theta = math.remainder(headings[after] - headings[k], 2 * math.pi)
    half = math.tan(abs(theta) / 2)
    u = np.array([math.cos(headings[k]), math.sin(headings[k])])
    v = np.array([math.cos(headings[after]), math.sin(headings[after])])
    reach = math.ceil(2 * radius * half) + 8
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1)))
    cross = u[0] * v[1] - u[1] * v[0]
    before, later = (x * v[1] - y * v[0]) / cross, (u[0] * y - u[1] * x) / cross
    room = np.minimum(before, later)
    arc = room / half  # the widest arc that fits
    length = before + later - 2 * room + arc * abs(theta)
    length[(room < radius * half * (1 + 1e-12)) | (room <= 1e-9)] = np.inf
    best = int(np.lexsort((-arc, length.round(9)))[0])
    pieces = [
        (0.0, before[best] - room[best]),
        (math.copysign(1.0, theta) / arc[best], arc[best] * abs(theta)),
        (0.0, later[best] - room[best]),
    ]
    return _along(k, after, int(x[best]), int(y[best]), pieces, headings[k])


def _along(k: int, after: int, columns: int, rows: int, pieces: list[tuple[float, float]], heading: float) -> Motion:
    """Return the motion along pieces (curvature, length), with the cells that it sweeps and points along it."""
    kept = [(curvature, length) for curvature, length in pieces if length > 1e-9]
    fine = _points(kept, heading, _FINE)[0]
    weights: dict[tuple[int, int], float] = {(0, 0): 0.0}
    middle = 0.5 * (fine[1:] + fine[:-1])
    cells = np.floor(middle[:, 1::-1] + 0.5).astype(int)
    for (row, column), length in zip(cells.tolist(), np.diff(fine[:, 3]), strict=True):
        weights[(row, column)] = weights.get((row, column), 0.0) + float(length)
    weights.setdefault((rows, columns), 0.0)
    side = SIDE * (1.0 if k == after else _TURN_PRICE)
    swept = tuple((row, column, math.ceil(side * length)) for (row, column), length in weights.items())
    points, curvature = _points(kept, heading, _STEP)
    return Motion(k, after, rows, columns, swept, freeze(points), freeze(curvature))


def _points(pieces: list[tuple[float, float]], heading: float, step: float) -> tuple[Float64Array, Float64Array]:
    """Return points (x, y, heading, length) along lines and arcs, and the curvature between them."""
    rows, bends = [np.array([[0.0, 0.0, heading, 0.0]])], []
    for curvature, length in pieces:
        x, y, angle, before = rows[-1][-1]
        n = max(math.ceil(length / step), 1)
        s = np.linspace(0.0, length, n + 1)[1:]
        along = angle + curvature * s
        if curvature:
            dx, dy = (np.sin(along) - np.sin(angle)) / curvature, (np.cos(angle) - np.cos(along)) / curvature
        else:
            dx, dy = s * np.cos(angle), s * np.sin(angle)
        rows.append(np.column_stack([x + dx, y + dy, along, before + s]))
        bends.append(np.full(n, curvature))
    return np.concatenate(rows), np.concatenate(bends)
