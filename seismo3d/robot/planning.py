"""Ways for a robot through a map: feasible, clear of obstacles, timed, and repaired as the map changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seismo3d._settings import as_settings
from seismo3d._typing import AnyArray, ArrayLike
from seismo3d._validate import as_array, as_kind, as_points, as_real_array, freeze, told
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.robot.dstar import DStarLite, Repair
from seismo3d.robot.lattice import lattice_motions
from seismo3d.robot.motions import UNIT
from seismo3d.robot.occupancy import Occupancy
from seismo3d.robot.paths import Path
from seismo3d.robot.speeds import find_speeds
from seismo3d.robot.traversability import (
    OPEN,
    REASONS,
    TOO_NEAR,
    RobotLimits,
    Traversability,
    check_unknown,
    find_traversability,
    reach_of,
    renew,
)

__all__ = ["Path", "Planner", "RobotLimits", "plan_path"]

_TILE = 32
_WAY_OUT_PRICE = 16


class Planner:
    """Plans a way through a map, and repairs it as the map changes and the robot moves.

    The search is D* Lite (:class:`~seismo3d.robot.dstar.DStarLite`) over a lattice of feasible motions
    (:mod:`seismo3d.robot.lattice`): 16 headings a cell, 48 motions in all. Every way found keeps the limits: no motion
    turns tighter than ``max_curvature``, and every cell that one sweeps keeps the robot's disc off obstacles.

    With V = 16 x cells vertices, a plan is O(V (C + log V)), C the cells that a motion sweeps (some 2 + half a turning
    radius); a repair that expands E vertices, at most twice each, is O(E (C + log V)). An update of n changed cells
    is O(n A) with A the cells within the robot's reach. Since the search starts at the goal, what changes near the
    robot is cheap to repair; an obstacle on the way near the goal can cost as much as a new plan.

    Parameters
    ----------
    occupancy : Occupancy
        The map.
    start, goal : (x, y) or (x, y, heading)
        In map axes, metres and radians; without a heading, any. Headings are rounded to the lattice's 16.
    robot : RobotLimits, optional
    unknown : {"blocked", "passable"}
        Whether unknown ground stops the robot, or only costs three times as much.

    Raises
    ------
    GeometryError
        If the start or goal is outside the map, or where the robot can't stand.
    ParameterError
        If a setting is outside what it can be.
    """

    def __init__(
        self,
        occupancy: Occupancy,
        start: Sequence[float],
        goal: Sequence[float],
        *,
        robot: RobotLimits | None = None,
        unknown: str = "blocked",
    ) -> None:
        self.robot = as_settings(robot, RobotLimits, "robot")
        as_kind(occupancy, Occupancy, "occupancy", remedy="Give Occupancy(...), or what Mapper.occupancy returns.")
        self.occupancy = occupancy
        self._blocks = check_unknown(unknown)
        self._cells, self._height = np.array(occupancy.cells), np.array(occupancy.height)
        found = find_traversability(occupancy, self.robot, unknown=unknown)
        self._ground = Traversability(found.cost.copy(), found.reason.copy(), found.clearance.copy())
        self._way_out = (slice(0, 0), slice(0, 0))
        self._motions = lattice_motions(1.0 / (self.robot.max_curvature * occupancy.cell))
        self._search = DStarLite(
            self._ground.cost, self._motions, start=self._as_place(start, "start"), goal=self._as_place(goal, "goal")
        )

    @property
    def traversability(self) -> Traversability:
        """What each cell costs the robot now; the arrays change with the map."""
        return self._ground

    def plan(self) -> Path:
        """Find the best way from the start to the goal: all of the search at first, then only what changes ask for.

        Returns
        -------
        Path
            Its state says whether there is a way. Where something has come nearer to the robot than its radius, the
            way begins with one out of there, on which nothing comes nearer than it is.
        """
        self._open_way_out()
        repair = self._search.repair()
        if repair.state != "found":
            none, reason = freeze(np.zeros(0)), self._ground.reason
            blocked = [n for n in ("start", "goal") if reason[getattr(self._search, n)[:2]] != OPEN]
            state = f"{blocked[0]} blocked" if blocked else "no way"
            return Path(
                state, freeze(np.zeros((0, 3))), none, none, none, none, freeze(np.zeros((0, 3))), np.inf,
                repair.expansions,
            )  # fmt: skip
        return self._path(repair)

    def update(self, rows_columns: ArrayLike, cells: ArrayLike, *, height: ArrayLike | None = None) -> int:
        """Take in changed cells: an obstacle that has moved, ground that has been seen.

        Parameters
        ----------
        rows_columns : array_like of shape (n, 2)
            Row and column of each.
        cells : array_like of shape (n,)
            0 free, 1 occupied, 2 unknown.
        height : array_like of shape (n,), optional
            Height of the ground there, metres; as before by default.

        Returns
        -------
        int
            Number of cells whose cost has changed for the robot.

        Raises
        ------
        ShapeError, ParameterError
            If the cells are not of the map, or their values not what they can be.
        """
        values = as_array(cells, "cells")
        if not values.size:
            return 0
        as_real_array(values, "cells", ndim=1)
        where = as_points(rows_columns, "rows_columns", dim=2).astype(np.int64)
        if where.shape != (len(values), 2):
            raise ShapeError(f"rows_columns has shape {where.shape}; expected ({len(values)}, 2), one cell a row.")
        if (where < 0).any() or (where >= self._cells.shape).any():
            raise ParameterError(
                f"rows_columns leaves the map of {self._cells.shape[0]} x {self._cells.shape[1]} cells. "
                "Give cells within it."
            )
        if not np.isin(values, (0, 1, 2)).all():
            raise ParameterError("cells holds other values than 0, 1 and 2; expected 0 free, 1 occupied, 2 unknown.")
        if height is not None:
            heights = as_real_array(height, "height", ndim=1)
            if heights.shape != values.shape:
                raise ShapeError(f"height has shape {heights.shape}; expected that of cells, {values.shape}.")
            self._height[where[:, 0], where[:, 1]] = heights
        self._cells[where[:, 0], where[:, 1]] = values
        return self._renew(where)

    def update_map(self, occupancy: Occupancy) -> int:
        """Take in a whole map of the same place, such as the mapper's newest; only what differs is looked at.

        Returns
        -------
        int
            Number of cells whose cost has changed for the robot.

        Raises
        ------
        ParameterError
            If its cells are not the same places.
        """
        as_kind(occupancy, Occupancy, "occupancy", remedy="Give Occupancy(...), or what Mapper.occupancy returns.")
        old = self.occupancy
        same = occupancy.shape == old.shape and occupancy.cell == old.cell and occupancy.origin == old.origin
        if not same:
            raise ParameterError(
                f"occupancy has {occupancy.shape[0]} x {occupancy.shape[1]} cells of {occupancy.cell:g} m from "
                f"{occupancy.origin}; expected the planner's {old.shape[0]} x {old.shape[1]} of {old.cell:g} m from "
                f"{old.origin}. Make a new Planner."
            )
        other = (occupancy.cells != self._cells) | ~(
            (occupancy.height == self._height) | (np.isnan(occupancy.height) & np.isnan(self._height))
        )
        where = np.argwhere(other)
        self._cells, self._height = np.array(occupancy.cells), np.array(occupancy.height)
        self.occupancy = occupancy
        return self._renew(where)

    def move_to(self, start: Sequence[float]) -> None:
        """Go on from where the robot is now, (x, y) or (x, y, heading).

        Where it can't stand, the next plan leads out of there, or its state is "start blocked".

        Raises
        ------
        GeometryError
            If it is outside the map.
        """
        self._search.move_to(self._as_place(start, "start", must_stand=False))

    def _open_way_out(self) -> None:
        """Let the robot leave a place that has become too near to something: over cells that are no nearer, dearly."""
        row, column, _ = self._search.start
        reach, ground = reach_of(self.robot, self.occupancy.cell), self._ground
        here = (slice(max(row - reach, 0), row + reach + 1), slice(max(column - reach, 0), column + reach + 1))
        held = self._search.cost
        for window in (self._way_out, here):
            costs = ground.cost[window].copy()
            if window == here and ground.reason[row, column] == TOO_NEAR:
                near = (ground.reason[here] == TOO_NEAR) & (ground.clearance[here] >= ground.clearance[row, column])
                costs[near] = _WAY_OUT_PRICE * UNIT
            changed = np.argwhere(costs != held[window])
            places = changed + np.array([window[0].start, window[1].start])
            self._search.update(places, costs[changed[:, 0], changed[:, 1]])
        self._way_out = here

    def _renew(self, where: AnyArray) -> int:
        """Judge the surroundings of changed cells anew, tile by tile, and hand the search what came out different."""
        reach, cell = reach_of(self.robot, self.occupancy.cell), self.occupancy.cell
        rows, columns = self._cells.shape
        places, costs = [], []
        for tile in np.unique(where // _TILE, axis=0):
            inside = where[(where // _TILE == tile).all(axis=1)]
            low, high = inside.min(axis=0) - reach, inside.max(axis=0) + reach + 1
            area = (max(low[0], 0), min(high[0], rows), max(low[1], 0), min(high[1], columns))
            part = renew(self._ground, self._cells, self._height, cell, self.robot, blocks=self._blocks, area=area)
            window = (slice(*area[:2]), slice(*area[2:]))
            changed = np.argwhere(part.cost != self._ground.cost[window])
            places.append(changed + np.array([area[0], area[2]]))
            costs.append(part.cost[changed[:, 0], changed[:, 1]])
            for held, new in zip(
                (self._ground.cost, self._ground.reason, self._ground.clearance),
                (part.cost, part.reason, part.clearance),
                strict=True,
            ):
                held[window] = new
        if not places:
            return 0
        self._search.update(np.concatenate(places), np.concatenate(costs))
        return sum(len(each) for each in places)

    def _as_place(self, pose: Sequence[float], name: str, *, must_stand: bool = True) -> tuple[int, int, int]:
        try:
            values = np.asarray(pose, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            values = np.empty(0)
        if len(values) not in (2, 3) or not np.isfinite(values).all():
            raise ParameterError(f"{name} is {told(pose)}; expected (x, y) or (x, y, heading), finite.")
        said = f"{name} ({values[0]:g}, {values[1]:g})"
        row, column = (int(v) for v in self.occupancy.rows_columns(values[None, :2])[0])
        rows, columns = self._cells.shape
        if not (0 <= row < rows and 0 <= column < columns):
            left, right, low, high = self.occupancy.extent
            raise GeometryError(
                f"{said} lies outside the map; expected x from {left:g} to {right:g} and y from {low:g} to {high:g} m."
            )
        reason = int(self._ground.reason[row, column])
        if must_stand and reason != OPEN:
            clearance = float(self._ground.clearance[row, column])
            raise GeometryError(
                f"{said} is where the robot can't stand: {REASONS[reason]}; expected open ground at least "
                f"{self.robot.radius:g} m from obstacles (there: {max(clearance, 0.0):.2f} m). Choose another place."
            )
        heading = -1 if len(values) == 2 else self._motions.nearest_heading(float(values[2]))
        return row, column, heading

    def _path(self, repair: Repair) -> Path:
        cell = self.occupancy.cell
        heading, route = self._search.route()
        place = self.occupancy.centres([self._search.start[:2]])[0]
        x, y, gone = float(place[0]), float(place[1]), 0.0
        angle = float(self._motions.headings[heading])
        rows, bends = [np.array([[x, y, angle, gone]])], [np.zeros(0)]
        for number in route:
            step = self._motions.steps[number]
            turned = step.points[1:, 2] - step.points[0, 2] + angle
            rows.append(
                np.column_stack([step.points[1:, :2] * cell + [x, y], turned, step.points[1:, 3] * cell + gone])
            )
            bends.append(step.curvature / cell)
            x, y, angle, gone = x + step.columns * cell, y + step.rows * cell, float(turned[-1]), float(rows[-1][-1, 3])
        table, pieces = np.concatenate(rows), np.concatenate(bends)
        speeds, times = find_speeds(table[:, 3], pieces, self.robot)
        curvature = np.append(pieces, pieces[-1:] if len(pieces) else 0.0)
        cost = repair.cost / (408.0 * 128.0) * cell
        poses, length = np.ascontiguousarray(table[:, :3]), table[:, 3].copy()
        world = self.occupancy.in_world(poses[:, :2])
        for array in (poses, length, times, speeds, curvature, world):
            freeze(array)
        return Path("found", poses, length, times, speeds, curvature, world, cost, repair.expansions)


def plan_path(
    occupancy: Occupancy,
    start: Sequence[float],
    goal: Sequence[float],
    *,
    robot: RobotLimits | None = None,
    unknown: str = "blocked",
) -> Path:
    """Find the best way for a robot from one place of a map to another.

    Parameters
    ----------
    occupancy, start, goal, robot, unknown
        See :class:`Planner`, which also repairs a plan as the map changes.

    Returns
    -------
    Path
        Its state is "found", or "no way".

    Raises
    ------
    GeometryError
        If the start or goal is outside the map, or where the robot can't stand.

    Examples
    --------
    >>> import numpy as np
    >>> room = Occupancy(np.zeros((80, 80)), np.zeros((80, 80)), 0.05)
    >>> path = plan_path(room, (1.0, 1.0), (3.0, 3.0))
    >>> path.state, round(float(path.length[-1]), 2)
    ('found', 2.83)
    """
    return Planner(occupancy, start, goal, robot=robot, unknown=unknown).plan()
