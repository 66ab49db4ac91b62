"""Lineaments of a terrain map: straight lines of slope or hollow that drainage does not explain."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

import numpy as np
from scipy import ndimage

from seismo3d._settings import Amount, Share, Smoothing, Steps, Threshold, as_settings
from seismo3d._stages import as_progress
from seismo3d._typing import Float64Array, Progress
from seismo3d._validate import freeze
from seismo3d.errors import ShapeError
from seismo3d.geometry.map_grid import MapGrid, elevation_values, like_map
from seismo3d.terrain.choosing import choose_lines, is_not_drained, regional_slope
from seismo3d.terrain.evidence import TerrainEvidence, fill_smoothly, measure_levels, square_map
from seismo3d.terrain.support import LineSupport, scan_lines
from seismo3d.terrain.tracing import TracedLine, trace_lines
from seismo3d.terrain.valleys import find_valleys

_LEAST_SIDE = 48


@dataclass(frozen=True, slots=True)
class LineamentSettings:
    """Settings of the search; lengths are in cells of the level that a line is seen on.

    Attributes
    ----------
    length : float in [4, 1000]
        Width of the Gaussian window along which a line must be straight.
    n_levels : int in [1, 16]
        Levels of halved resolution that are searched.
    n_valley_levels : int in [0, 16]
        The same for valleys along faults, which are wider than scarps.
    n_strikes : int in [1, 100]
        Strikes tried in a quarter of the compass.
    floor : float in [0, inf)
        Standard error that every mean has at least, as a share of the steepness around.
    least_score : float in [0, inf]
        Mean evidence along the line, in its own standard errors, that a crest needs; noise reaches 3.5.
    least_contrast : float in [0, inf]
        The same over the steepness around.
    least_piece : float in [0, 1000]
        Shortest piece that is linked from crests, in windows (`length`).
    gap : float in [0, inf]
        Widest gap that is bridged, in windows.
    near : float in [0, 1000]
        Distance within which lines of different evidence are one.
    least_length : float in (0, inf]
        Shortest lineament, in windows, of the map's own cells: a line as short as the window is the window's own.
    least_strength : float in [0, inf]
        Mean score times the root of the length in cells that a lineament needs.
    least_prominence : float in [0, inf]
        Mean evidence of a lineament over that of the same path laid beside it, which is what the terrain's own texture
        draws by chance at that strike, see :mod:`seismo3d.terrain.prominence`. For the shortest lineament; it falls
        with the root of the length, as every part of a line must hold a crest, and long ones by chance are rare.
    least_valley : float in [0, inf]
        The same of a valley across divides, over the unevenness of its floor, see :mod:`seismo3d.terrain.valleys`.
        Rivers' own valleys, pieced together, reach 16 in mountains that nothing but water has shaped.
    drainage : float in [0, 1]
        Largest share of the surrounding slope that may run along a lineament: what runs down the slope is a valley or a
        spur between valleys, which running water makes straight by itself. Steps between two even grounds are kept,
        see :mod:`seismo3d.terrain.offsets`.
    """

    length: Annotated[float, "[4, 1000]"] = 24.0
    n_levels: Annotated[int, "[1, 16]"] = 2
    n_valley_levels: Annotated[int, "[0, 16]"] = 3
    n_strikes: Steps = 12
    floor: Amount = 0.02
    least_score: Threshold = 3.5
    least_contrast: Threshold = 0.15
    least_piece: Smoothing = 0.67
    gap: Threshold = 1.5
    near: Smoothing = 4.0
    least_length: Annotated[float, "(0, inf]"] = 3.0
    least_strength: Threshold = 35.0
    least_prominence: Threshold = 9.0
    least_valley: Threshold = 18.0
    drainage: Share = 0.45


@dataclass(frozen=True, slots=True, eq=False)
class Lineament:
    """One line on the map.

    Attributes
    ----------
    points : ndarray of shape (n, 2), float64
        Map coordinates (x, y); places without a georeference.
    places : ndarray of shape (n, 2), float64
        (column, row) on the map's array.
    score : ndarray of shape (n,), float64
        Evidence at each point, in standard errors.
    kind : str
        What speaks for it most: "step" in elevation, "trough", or "both"; "valley" for troughs lined up across divides.
    length : float
        In metres; cells without a georeference.
    strike_deg : float
        Mean strike, 0 to 180 degrees clockwise from north.
    confidence : float
        0 to 1; one half at the least score of a crest.
    prominence : float
        Its evidence over that of the same path laid beside it, whose texture is what chance draws here.
    """

    points: Float64Array
    places: Float64Array
    score: Float64Array
    kind: str
    length: float
    strike_deg: float
    confidence: float
    prominence: float


@dataclass(frozen=True, slots=True, eq=False)
class LineamentSet:
    """All lineaments of a map.

    Attributes
    ----------
    lines : tuple of Lineament
        Most significant first.
    likelihood : DataArray or ndarray of the map's shape, float32
        0 to 1 at every cell, of the finest level; the map's own form.
    grid : MapGrid
    settings : dict
    """

    lines: tuple[Lineament, ...]
    likelihood: Any
    grid: MapGrid
    settings: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.lines)

    @property
    def total_length(self) -> float:
        """Sum of the lengths, in metres (cells)."""
        return float(sum(line.length for line in self.lines))


def lineaments(
    elevation: Any, *, settings: LineamentSettings | None = None, progress: Progress | None = None
) -> LineamentSet:
    """Find straight lines in terrain that running water does not explain: faults, scarps, fault-line valleys.

    At each level of resolution the slope and the curvature of the map are compared with those of the regional surface,
    and their signed means along straight lines of every strike with their own standard error: a scarp keeps its side
    and a trough its hollow, while hills and rivers turn. Crests of that score are linked by the tracer that links a
    cube's faults, lines of different evidence fused and carried on straight as long as they stand out from the same
    path laid beside them, and those left out that do not, or that run along the slope around them.

    Parameters
    ----------
    elevation : DataArray or array_like of shape (rows, columns)
        As ``read_elevation`` gives it; elevations in metres. NaN where unknown.
    settings : LineamentSettings, optional
    progress : callable, optional
        Called with the stage and the share done.

    Returns
    -------
    LineamentSet

    Raises
    ------
    ShapeError
        If the map has fewer than 48 rows or columns.
    GeometryError
        If every cell is nodata.

    Notes
    -----
    The line scan is that of :mod:`seismo3d.seismic` in two dimensions, in the manner of [1]_ for steps: there the
    signal-to-noise of a template along a scarp, here the signed mean against its own scatter. What runs along the slope
    is water's, unless it is a valley that goes on over divides (:mod:`seismo3d.terrain.valleys`) or a step between two
    even grounds (:mod:`seismo3d.terrain.offsets`); what keeps to one height where the ground beside it does not is the
    edge of a terrace (:mod:`seismo3d.terrain.contours`). A fault whose valley only runs down the slope, or that bends
    within its window, is not found; some edges of terraces, dunes and roads are
    lines too. A straight scarp is placed on its steepest part.

    References
    ----------
    .. [1] G. Hilley et al., Geophys. Res. Lett. 37, L04301, 2010. :doi:`10.1029/2009GL042044`
    """
    settings = as_settings(settings, LineamentSettings)
    z = elevation_values(elevation)
    if min(z.shape) < _LEAST_SIDE:
        raise ShapeError(f"elevation has shape {z.shape}; expected at least {_LEAST_SIDE} rows and columns.")
    grid = MapGrid.from_elevation(elevation)
    steps = tuple(float(np.hypot(*column)) for column in grid.steps_m.T)
    square, stretch = square_map(z, (steps[0], steps[1]))
    report = as_progress(progress)
    filled = fill_smoothly(square, np.isfinite(square))
    n_levels = max(settings.n_levels, settings.n_valley_levels)
    levels = measure_levels(square, n_levels, 2.0 * settings.length)
    supports, lines, troughs = _search(filled, levels, settings, report)
    report("fuse", 0.0)
    valleys = find_valleys(troughs, supports[1], filled, levels[: settings.n_valley_levels], settings)
    report("fuse", 0.5)
    chosen = choose_lines(lines, valleys, supports, filled, levels, settings)
    report("fuse", 1.0)
    made = tuple(make_lineament(line, grid, stretch, settings.least_score, prominence) for line, prominence in chosen)
    likelihood = to_likelihood(supports[2].score, settings.least_score)
    return LineamentSet(made, _like(elevation, likelihood, z, stretch), grid, asdict(settings))


def to_likelihood(score: Any, least: float) -> Any:
    """Turn a score into a likelihood from 0 to 1: one half at the least score of a crest."""
    return 1.0 - np.exp2(-((np.asarray(score) / least) ** 2))


def _search(
    filled: Float64Array, levels: list[TerrainEvidence], settings: LineamentSettings, report: Progress
) -> tuple[list[LineSupport], list[TracedLine], list[TracedLine]]:
    """Return the supports of the finest level, the pieces that do not run along the slope, and all troughs' pieces."""
    first: list[LineSupport] = []
    pieces: list[TracedLine] = []
    troughs: list[TracedLine] = []
    for number, evidence in enumerate(levels):
        report("scan", number / len(levels))
        supports = scan_lines(evidence, length=settings.length, n_strikes=settings.n_strikes, floor=settings.floor)
        first = first or supports
        slope = regional_slope(filled, 0.5 * settings.length * evidence.factor)
        for support in supports:
            found = trace_lines(
                support,
                least=settings.least_score,
                least_contrast=settings.least_contrast,
                least_length=settings.least_piece * settings.length,
            )
            if number < settings.n_levels:
                pieces += [line for line in found if is_not_drained(line, filled, slope, settings)]
            if number < settings.n_valley_levels and support.kind != "step":
                troughs += found
    report("scan", 1.0)
    return first, pieces, troughs


def make_lineament(
    line: TracedLine, grid: MapGrid, stretch: tuple[float, float], least_score: float, prominence: float
) -> Lineament:
    """Return a traced line with its place on the map."""
    places = line.places[:, ::-1] / np.array(stretch)
    last = np.array(grid.shape[::-1]) - 1.0
    # smoothed beyond its ends a line can leave the map
    inside = ((places >= -0.5) & (places <= last + 0.5)).all(axis=1)
    places, score = np.clip(places[inside], 0.0, last), line.score[inside]
    points = grid.to_map(places)
    metres = points * np.array(grid.metres_per_unit)
    way = metres[-1] - metres[0]
    # rows of a bare array run down: north is up
    north = way[1] if grid.has_place else -way[1]
    return Lineament(
        points=freeze(points),
        places=freeze(places),
        score=freeze(score),
        kind=line.kind,
        length=float(np.linalg.norm(np.diff(metres, axis=0), axis=1).sum()),
        strike_deg=float(np.degrees(np.arctan2(way[0], north)) % 180.0),
        confidence=float(to_likelihood(score.mean(), least_score)),
        prominence=prominence,
    )


def _like(elevation: Any, likelihood: Float64Array, z: Float64Array, stretch: tuple[float, float]) -> Any:
    """Return the likelihood on the map's own cells and in its form, NaN where the map is unknown."""
    if likelihood.shape != z.shape:
        rows, columns = (np.arange(n) * s for n, s in zip(z.shape, stretch[::-1]))
        grid = np.meshgrid(rows, columns, indexing="ij")
        likelihood = ndimage.map_coordinates(likelihood, grid, order=1, mode="nearest")
    return like_map(elevation, np.where(np.isfinite(z), likelihood, np.nan).astype(np.float32), "likelihood")
