"""Robust Gauss-Newton for the pose of one map on another, at one level of resolution."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.registration.robust import robust_scale
from seismo3d.terrain import _kernels_align as kernels

TUKEY = 4.685
"""Cutoff of Tukey's weights, in standard deviations."""
LEAST_CELLS = 30
PATCH = 16
"""Side, in cells, of the patches whose residuals are taken as independent of each other."""
NEAR = 1e-2
"""Step, in cells, from which on the robust weights' cutoff holds still."""
LAST = 8
"""Steps at the end that tell how restless a pose still is."""
FARTHEST = 4.0
"""Cells that a step shifts a map by at most: slopes tell no farther."""
MOST_PACE = 4.0
"""Factor by which horizontal steps are lengthened at most."""
SAMPLE = 200_000
"""Most residuals that a spread is taken from."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """A pair of maps at one resolution; the frame is metres (x, y) about the target's middle.

    Attributes
    ----------
    target, source : ndarray, float64
        Elevations, NaN where unknown.
    gx, gy : ndarray of the target's shape, float64
        Its slopes in the frame.
    steps : ndarray of shape (2, 2), float64
        Metres to the target's next column and row.
    centre : ndarray of shape (2,), float64
        Target's place (column, row) of the frame's origin.
    to_source : ndarray of shape (3, 3), float64
        Frame -> the source's places, before any motion.
    half : float
        Half the target's longer side, in metres.
    """

    target: Float64Array
    gx: Float64Array
    gy: Float64Array
    source: Float64Array
    steps: Float64Array
    centre: Float64Array
    to_source: Float64Array
    half: float

    @property
    def cell(self) -> float:
        """Side of a square of a cell's area, in metres."""
        return float(np.sqrt(abs(np.linalg.det(self.steps))))

    @property
    def smaller(self) -> float:
        """How many of the target's cells the known ground of the smaller map fills."""
        source_cell = 1.0 / abs(np.linalg.det(self.to_source[:2, :2]))
        source = np.isfinite(self.source).sum() * source_cell / self.cell**2
        return float(min(np.isfinite(self.target).sum(), source))

    def places_in_source(self, motion: Float64Array) -> Float64Array:
        """Return the map (2, 3) from the target's places to the source's, the source moved by `motion`."""
        to_frame = np.eye(3)
        to_frame[:2, :2] = self.steps
        to_frame[:2, 2] = -self.steps @ self.centre
        return np.ascontiguousarray((self.to_source @ np.linalg.inv(motion) @ to_frame)[:2])


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A motion of the source and what is done to its elevations.

    Attributes
    ----------
    motion : ndarray of shape (3, 3), float64
        In the frame: source to target.
    vertical : ndarray of shape (4,), float64
        Offset, elevation per metre along x and y, scale.
    """

    motion: Float64Array = field(default_factory=lambda: np.eye(3))
    vertical: Float64Array = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The end of the iteration at a level.

    Attributes
    ----------
    pose : Pose
    spread, first_spread : float
        Normalised median absolute deviation of the residuals at the end and at the start.
    overlap : float
        Share of the target's cells with a residual, of those with a slope.
    share : float
        The same cells, as a share of the smaller map's known ground.
    settled : bool
        Whether the steps became smaller than the tolerance.
    unrest : ndarray of shape (4,), float64
        Longest of the last steps of shift, turn and growth (metres, radians, logarithm); infinite where one of them was
        longer than a hundredth of a cell.
    cutoff : float
        Residual at which the robust weights reach zero.
    residuals : ndarray of the target's shape, float64
    middle : float
        Median of the source's elevations.
    """

    pose: Pose
    spread: float
    first_spread: float
    overlap: float
    share: float
    settled: bool
    unrest: Float64Array
    cutoff: float
    residuals: Float64Array
    middle: float


def fit_pose(level: Level, start: Pose, free: tuple[int, ...], *, tolerance: float, most: int = 40) -> Fit | None:
    """Refine a pose at one level; None where fewer than 30 cells of both maps meet.

    Parameters
    ----------
    level : Level
    start : Pose
    free : tuple of int
        Numbers of the parameters that are estimated, see :mod:`seismo3d.terrain._kernels_align`.
    tolerance : float
        Step, in cells, that ends the iteration.
    most : int
        Most steps.
    """
    middle = float(np.nanmedian(level.source[:: max(1, level.source.shape[0] // 200)]))
    known = max(int(np.isfinite(level.gx).sum()), 1)
    # elevations about their middle: offset and scale then hardly depend on each other
    source = level.source - middle
    vertical = _about_middle(start.vertical, middle, level.half)
    motion, cutoff, first, spread = start.motion, np.inf, np.nan, np.nan
    residuals = np.empty(level.target.shape)
    sums = np.empty((level.target.shape[0], kernels.N_SUMS))
    settled, is_near, count = False, False, 0
    pace = _Pace(level)
    E = level.steps / level.half
    for step in range(most + 1):
        M = level.places_in_source(motion)
        kernels.alignment_sums(
            level.target, level.gx, level.gy, source, M, vertical, level.centre, E, level.half, cutoff, residuals, sums
        )
        seen = residuals[np.isfinite(residuals)]
        count = len(seen)
        if count < LEAST_CELLS:
            return None
        offset, spread = _spread(seen)
        first = spread if step == 0 else first
        if step == 0:
            # bring the offset near first: the robust weights are about zero
            vertical = vertical + np.array([offset, 0.0, 0.0, 0.0])
        if settled or step == most:
            break
        if not is_near:
            cutoff = max(TUKEY * spread, 1e-9)
        if step == 0:
            continue
        x = _solve_free(sums, free)
        motion = _moved(pace.step(x[:4], is_near)) @ motion
        vertical = vertical + x[4:]
        reach = pace.reach
        # the spread of whole metres jumps; a cutoff that followed it would lead the pose round and round
        is_near = is_near or reach < NEAR
        settled = reach < tolerance and step >= 2
    pose = Pose(motion, _about_zero(vertical, middle, level.half))
    share = count / max(level.smaller, 1.0)
    return Fit(pose, spread, first, count / known, share, settled, pace.unrest, cutoff, residuals, middle)


class _Pace:
    """How long horizontal steps are made, and how long they have been.

    Noise in the slopes makes steps too short; where cells join and leave at edges and holes, they turn back.
    """

    def __init__(self, level: Level) -> None:
        self._cell = level.cell
        self._cells = np.array([1.0, 1.0, level.half, level.half]) / level.cell
        self._factor = 1.0
        self._last = np.zeros(4)
        self._steps: list[Float64Array] = []

    def step(self, x: Float64Array, is_near: bool) -> Float64Array:
        """Return a step of shift, turn and growth at the pace: slower where it turns back, faster near the end."""
        if (x * self._cells) @ self._last < 0.0:
            self._factor *= 0.5
        elif is_near:
            self._factor = min(1.5 * self._factor, MOST_PACE)
        x = x * self._factor
        length = float(np.hypot(x[0], x[1]))
        if length > FARTHEST * self._cell:
            x *= FARTHEST * self._cell / length
        self._last = x * self._cells
        self._steps.append(np.abs(x) if self.reach < NEAR else np.full(4, np.inf))
        return x

    @property
    def reach(self) -> float:
        """How far the last step moved the source's ground, in cells."""
        return float(np.abs(self._last).max())

    @property
    def unrest(self) -> Float64Array:
        """Longest of the last steps, infinite where one of them was far."""
        return np.max(self._steps[-LAST:], axis=0) if self._steps else np.full(4, np.inf)


def _about_middle(vertical: Float64Array, middle: float, half: float) -> Float64Array:
    """Return what is done to elevations about their middle, with tilts over half the target."""
    c0, c1, c2, k = vertical
    return np.array([c0 + k * middle, c1 * half, c2 * half, k])


def _about_zero(vertical: Float64Array, middle: float, half: float) -> Float64Array:
    """Return the inverse of :func:`_about_middle`."""
    c0, c1, c2, k = vertical
    return np.array([c0 - k * middle, c1 / half, c2 / half, k])


def relief(level: Level, found: Fit) -> float:
    """Return the spread about their plane of the target's elevations that a fit saw: what the source could explain."""
    rows, columns = np.nonzero(np.isfinite(found.residuals))
    step = max(1, len(rows) // 20_000)
    rows, columns = rows[::step], columns[::step]
    z = level.target[rows, columns]
    design = np.column_stack([np.ones(len(z)), columns, rows])
    return _spread(z - design @ np.linalg.lstsq(design, z, rcond=None)[0])[1]


def measure_covariance(level: Level, found: Fit, free: tuple[int, ...]) -> Float64Array:
    """Return the covariance of the eight parameters: a sandwich of sums over patches.

    What a step changes is told by products of the slopes of both maps: in squares of one map's slopes its noise would
    count as relief, which on flat ground is most of it.
    """
    rows, columns = level.target.shape
    n_patches = -(-rows // PATCH) * -(-columns // PATCH)
    scores, change = np.zeros((n_patches, 8)), np.zeros((8, 8))
    turned = np.linalg.inv((level.to_source @ np.linalg.inv(found.pose.motion))[:2, :2])
    # on the source's own cells, where a hole does not take its neighbours with it
    slopes = measure_slopes(found.pose.vertical[3] * level.source, turned)
    M, moved = level.places_in_source(found.pose.motion), np.empty((3, rows, columns))
    for part, out in zip((*slopes, level.source - found.middle), moved, strict=True):
        kernels.resample(part, M, out)
    kernels.patch_scores(
        np.stack([level.gx, level.gy]), moved[:2], moved[2], found.residuals, level.centre, level.steps / level.half,
        level.half, found.cutoff, PATCH, scores, change,
    )  # fmt: skip
    chosen = np.array(free)
    bread = np.linalg.pinv(change[np.ix_(chosen, chosen)], rcond=1e-14)
    sums = scores[:, chosen]
    covariance = np.zeros((8, 8))
    covariance[np.ix_(chosen, chosen)] = bread @ (sums.T @ sums) @ bread.T
    unit = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0 / level.half, 1.0 / level.half, 1.0])
    return covariance * unit[:, None] * unit[None, :]


def measure_slopes(z: Float64Array, steps: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the slopes of a map along x and y, whose columns and rows are `steps` (2, 2) apart; NaN where unknown."""
    gu, gv = np.empty_like(z), np.empty_like(z)
    kernels.slopes_with_holes(z, gu, gv)
    # slopes are covectors: per cell -> per metre
    back = np.linalg.inv(steps)
    return back[0, 0] * gu + back[1, 0] * gv, back[0, 1] * gu + back[1, 1] * gv


def _spread(values: Float64Array) -> tuple[float, float]:
    """Return the median and the normalised median absolute deviation, of an even sample of many values."""
    some = values[:: max(1, len(values) // SAMPLE)]
    middle = float(np.median(some))
    return middle, robust_scale(some - middle)


def _solve_free(sums: Float64Array, free: tuple[int, ...]) -> Float64Array:
    """Return the step of all eight parameters, zero for those that are not estimated."""
    matrix, vector = _form(sums)
    step, chosen = np.zeros(8), np.array(free)
    step[chosen] = _solve(matrix[np.ix_(chosen, chosen)], vector[chosen])
    return step


def _form(sums: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the normal matrix (8, 8) and the right side (8,) from the rows' sums, of which it holds the upper half."""
    total = sums.sum(axis=0)
    upper = total[:64].reshape(8, 8)
    return np.triu(upper) + np.triu(upper, 1).T, total[64:72]


def _solve(matrix: Float64Array, vector: Float64Array) -> Float64Array:
    """Solve the step; along what the terrain does not show the step is zero."""
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale[None, :])
    seen = values > 1e-10
    parts = vectors[:, seen].T @ (vector / scale) / values[seen]
    return np.asarray(vectors[:, seen] @ parts) / scale


def _moved(x: Float64Array) -> Float64Array:
    """Return the motion of a step: shift, turn, logarithm of growth."""
    cosine, sine, growth = np.cos(x[2]), np.sin(x[2]), np.exp(x[3])
    return np.array([[growth * cosine, -growth * sine, x[0]], [growth * sine, growth * cosine, x[1]], [0.0, 0.0, 1.0]])
