"""Traversability: what it costs a robot to stand at each cell, and why it can't where it can't."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from scipy import ndimage

from seismo3d._settings import Amount, Positive, check_fields
from seismo3d._typing import AnyArray, Float32Array
from seismo3d._validate import freeze, is_among, told
from seismo3d.errors import ParameterError
from seismo3d.robot._kernels_ground import find_steps, fit_slopes
from seismo3d.robot.motions import UNIT
from seismo3d.robot.occupancy import FREE, OCCUPIED, UNKNOWN, Occupancy

OPEN, BLOCKED, UNSEEN, STEP, TOO_NEAR, STEEP = range(6)
REASONS = (
    "it can be entered",
    "it is occupied",
    "it is unknown ground",
    "it has a step that is too high",
    "it lies too near to an obstacle or unknown ground",
    "it is too steep",
)
"""What each value of ``Traversability.reason`` means."""
_SLOPE_PRICE, _NEARNESS_PRICE, _UNKNOWN_PRICE = 2.0, 2.0, 2.0
_WIDEST_FIT = 10
_Edges: TypeAlias = tuple[bool, bool, bool, bool]


@dataclass(frozen=True, slots=True)
class RobotLimits:
    """What a robot can do.

    Attributes
    ----------
    radius : float in [0, inf)
        Of the disc that holds the robot seen from above, metres; nothing may come nearer to its middle.
    max_curvature : float in (0, inf)
        Tightest turn, one over metres: the inverse of the least turning radius.
    max_speed, max_acceleration, max_lateral_acceleration : float in (0, inf)
        Metres, seconds; braking is as strong as accelerating.
    max_slope_deg : float in (0, 90)
        Steepest ground, fitted over the robot's size.
    max_step : float in (0, inf)
        Highest step between neighbouring cells, metres.
    margin : float in [0, inf)
        Room beyond the radius that the robot likes to have: less is allowed, and costs more. Metres.
    """

    radius: Amount = 0.25
    max_curvature: Positive = 2.0
    max_speed: Positive = 0.8
    max_acceleration: Positive = 0.5
    max_lateral_acceleration: Positive = 0.5
    max_slope_deg: Annotated[float, "(0, 90)"] = 20.0
    max_step: Positive = 0.08
    margin: Amount = 0.2

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, slots=True, eq=False)
class Traversability:
    """Cost of standing at each cell.

    Attributes
    ----------
    cost : ndarray of shape (rows, columns), int32
        0 where the robot's middle must not be; else 128 on open, level ground, and up to some 7 times that on slopes,
        near obstacles and on unknown ground.
    reason : ndarray of shape (rows, columns), uint8
        0, or why the cost is 0: see :data:`REASONS`.
    clearance : ndarray of shape (rows, columns), float32
        Metres between the cell and the nearest cell that nothing must touch, at their nearest points; told right up to
        what the robot asks for.
    """

    cost: AnyArray
    reason: AnyArray
    clearance: Float32Array


def reach_of(robot: RobotLimits, cell: float) -> int:
    """Return within how many cells a change of the map can change a cell's cost."""
    return max(math.ceil((robot.radius + robot.margin) / cell) + 3, _fit_reach(robot, cell)) + 1


def find_traversability(occupancy: Occupancy, robot: RobotLimits, *, unknown: str = "blocked") -> Traversability:
    """Judge each cell of a map for a robot.

    A cell that is occupied, has a step that is too high, or is unknown must not be touched by the robot's disc; from
    any point of a cell that can be entered to any point of such a cell it is ``radius`` at least. Beyond the map's
    sides lies unknown ground. A cell whose
    surroundings, fitted by a plane over the robot's size, are too steep must not hold its middle.

    O(n) for n cells but for the plane fit: O(n w^2), w the robot's diameter in cells, at most 21.

    Parameters
    ----------
    occupancy : Occupancy
        Where its height is unknown, free ground counts as level.
    robot : RobotLimits
    unknown : {"blocked", "passable"}
        Whether unknown ground stops the robot, or only costs three times as much.

    Returns
    -------
    Traversability

    Raises
    ------
    ParameterError
        If ``unknown`` is neither.
    """
    whole = (True, True, True, True)
    return _judge(occupancy.cells, occupancy.height, occupancy.cell, robot, check_unknown(unknown), whole)


def check_unknown(unknown: str) -> bool:
    """Return whether unknown ground blocks."""
    if not is_among(unknown, ("blocked", "passable")):
        raise ParameterError(f"unknown is {told(unknown)}; expected 'blocked' or 'passable'.")
    return unknown == "blocked"


def renew(
    found: Traversability, cells: AnyArray, height: Float32Array, cell: float, robot: RobotLimits, *, blocks: bool,
    area: tuple[int, int, int, int],
) -> Traversability:  # fmt: skip
    """Judge a part of a map anew: rows ``area[0]`` to ``area[1]``, columns ``area[2]`` to ``area[3]``, ends excluded.

    What lies within reach of it is looked at too; the answer is that of the whole map, cut to the area.
    """
    reach = reach_of(robot, cell)
    rows, columns = found.cost.shape
    top, bottom = max(area[0] - reach, 0), min(area[1] + reach, rows)
    left, right = max(area[2] - reach, 0), min(area[3] + reach, columns)
    edges = (top == 0, bottom == rows, left == 0, right == columns)
    part = _judge(cells[top:bottom, left:right], height[top:bottom, left:right], cell, robot, blocks, edges)
    inner = (slice(area[0] - top, area[1] - top), slice(area[2] - left, area[3] - left))
    return Traversability(part.cost[inner], part.reason[inner], part.clearance[inner])


def _judge(
    cells: AnyArray, height: Float32Array, cell: float, robot: RobotLimits, blocks: bool, edges: _Edges
) -> Traversability:
    """Judge cells; ``edges`` says on which sides (top, bottom, left, right) the map ends: beyond is unknown ground."""
    ground = np.where(cells == FREE, height, np.float32(np.nan)).astype(np.float32)
    slope, step = np.empty(cells.shape), np.empty(cells.shape)
    fit_slopes(ground, cell, _fit_reach(robot, cell), slope)
    find_steps(ground, step)
    reason = np.full(cells.shape, OPEN, dtype=np.uint8)
    steepest = math.tan(math.radians(robot.max_slope_deg))
    reason[slope > steepest] = STEEP
    high = step > robot.max_step
    untouchable = (cells == OCCUPIED) | high | ((cells == UNKNOWN) if blocks else False)
    beyond = edges if blocks else (False, False, False, False)
    clearance = _clearance(untouchable, cell, robot, beyond)
    reason[clearance < robot.radius] = TOO_NEAR
    reason[high] = STEP
    if blocks:
        reason[cells == UNKNOWN] = UNSEEN
    reason[cells == OCCUPIED] = BLOCKED
    price = 1.0 + _SLOPE_PRICE * (np.nan_to_num(slope) / steepest) ** 2
    if robot.margin > 0.0:
        price += _NEARNESS_PRICE * np.clip(1.0 - (clearance - robot.radius) / robot.margin, 0.0, 1.0)
    price[cells == UNKNOWN] += _UNKNOWN_PRICE
    cost = np.where(reason == OPEN, np.round(UNIT * price), 0.0).astype(np.int32)
    return Traversability(freeze(cost), freeze(reason), freeze(clearance))


def _clearance(untouchable: AnyArray, cell: float, robot: RobotLimits, edges: _Edges) -> Float32Array:
    """Distance between the nearest points of squares: of centres, once the untouchable squares have grown by one."""
    most = robot.radius + robot.margin + cell
    top, bottom, left, right = (int(edge) for edge in edges)
    framed = np.pad(untouchable, ((top, bottom), (left, right)), constant_values=True)
    if not framed.any():
        return np.full(untouchable.shape, most, dtype=np.float32)
    grown = ndimage.binary_dilation(framed, np.ones((3, 3), dtype=bool))
    away = cell * ndimage.distance_transform_edt(~grown)
    away = away[top : away.shape[0] - bottom, left : away.shape[1] - right]
    away[untouchable] = -cell
    return np.asarray(np.minimum(away, most), dtype=np.float32)


def _fit_reach(robot: RobotLimits, cell: float) -> int:
    return min(max(round(robot.radius / cell), 1), _WIDEST_FIT)
