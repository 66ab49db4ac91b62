"""Flow paths: the ways of least resistance along the faults of a cube."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int64Array
from seismo3d._validate import as_number, freeze
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.cube_checks import placing_cube, tell_extent
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.index_frame import IndexFrame


@dataclass(frozen=True, slots=True, eq=False)
class FlowPath:
    """One way through a cube.

    Attributes
    ----------
    voxels : ndarray of shape (n, 3), int64
        The voxels from start to end, each a neighbour of the one before.
    points : ndarray of shape (n, 3), float64
        Their places: x, y, z on the map, or line numbers, and time or depth.
    resistance : float
        Sum of the resistance per length along it.
    length : float
        Its length in `unit`.
    unit : {"m", "ft", "bin"}
        The map's where the cube is in depth on a map; else a bin, which is a trace sideways and a sample down.
    share_on_faults : float
        Share of its voxels that lie on a fault surface.
    surfaces : tuple of int
        Labels of the faults that it follows, in order.
    straight : float
        Resistance of the shortest such way between the same ends through rock without faults, over `resistance`: how
        much easier the faults make it, 1 where they do not.
    """

    voxels: Int64Array
    points: Float64Array
    resistance: float
    length: float
    unit: str
    share_on_faults: float
    surfaces: tuple[int, ...]
    straight: float


def flow_path(faults: FaultSet, start: Any, end: Any, *, cube: Any = None, contrast: float = 50.0) -> FlowPath:
    r"""Find the way of least resistance between two points, or two horizons, through the faults of a cube.

    Resistance per length is :math:`1 / (1 + (c - 1) L)`, with L on a surface the larger of the fault likelihood and one
    half, off all surfaces 0, whatever the likelihood there, and c the contrast of a sure fault to unbroken rock. The
    cheapest way over the 26 neighbours of each voxel is Dijkstra's, by scikit-image's ``MCP_Geometric``; where lines
    meet at no right angle it is chosen as if they did. Lengths and resistances along it are those of the map.

    Parameters
    ----------
    faults : FaultSet
        Faults of a cube.
    start, end : point or horizon
        A point (inline, crossline, time or depth) in the cube's coordinates; or a map of shape (inline, crossline) of
        times or depths with NaN where the horizon is not known, such as ``Track.depth``. Fluid may leave a horizon
        anywhere, and reach the other anywhere.
    cube : DataArray, optional
        The cube, for its coordinates. [default: those of ``faults.labels``]
    contrast : float
        How much better a sure fault conducts than rock, 1 or more.

    Returns
    -------
    FlowPath

    Raises
    ------
    ShapeError
        If start or end is neither a point nor such a map, or the faults are of a section or another cube.
    ParameterError
        If a point lies outside the cube or is not of finite numbers, a horizon lies nowhere in it, `contrast` is below
        1, or `faults` is no FaultSet.
    GeometryError
        If start and end share a voxel, or the cube lies elsewhere than the faults.
    """
    home = placing_cube(cube, faults)
    factor = as_number(contrast, "contrast", low=1.0, high=1e9)
    frame, geometry = IndexFrame.of(home), SurveyGeometry.from_cube(home)
    starts, ends = (_as_voxels(entry, name, geometry, home) for entry, name in ((start, "start"), (end, "end")))
    if len(starts) + len(ends) != len(np.unique(np.concatenate([starts, ends]), axis=0)):
        raise GeometryError(
            "start and end share a voxel; expected two places. Choose points or horizons farther apart."
        )
    labels = np.asarray(faults.labels)
    resistance = _resistance(np.asarray(faults.likelihood), labels, factor)
    voxels = _find_way(resistance, starts, ends, frame)
    unbroken = _find_way(np.ones_like(resistance), voxels[:1], voxels[-1:], frame)
    at = tuple(voxels.T)
    lengths, across = _step_lengths(voxels, frame), resistance[at].astype(np.float64)
    cost = float((lengths * 0.5 * (across[1:] + across[:-1])).sum())
    return FlowPath(
        voxels=freeze(voxels),
        points=freeze(geometry.index_to_map(voxels.astype(np.float64))),
        resistance=cost,
        length=float(lengths.sum()),
        unit=frame.unit,
        share_on_faults=float((labels[at] > 0).mean()),
        surfaces=_in_order(labels[at]),
        straight=float(_step_lengths(unbroken, frame).sum()) / cost,
    )


def _find_way(resistance: Float32Array, starts: Int64Array, ends: Int64Array, frame: IndexFrame) -> Int64Array:
    """Voxels of the cheapest way from any start to any end."""
    from skimage.graph import MCP_Geometric

    search = MCP_Geometric(resistance, sampling=frame.steps)
    costs, _ = search.find_costs(starts.tolist(), ends.tolist(), find_all_ends=False)
    return np.array(search.traceback(ends[np.argmin(costs[tuple(ends.T)])]), dtype=np.int64)


def _step_lengths(voxels: Int64Array, frame: IndexFrame) -> Float64Array:
    return np.asarray(np.linalg.norm(frame.carry(np.diff(voxels, axis=0)), axis=1))


def _resistance(likelihood: AnyArray, labels: AnyArray, contrast: float) -> Float32Array:
    # ridges of the likelihood that are no fault conduct as rock does
    conducting = np.where(labels > 0, np.maximum(np.nan_to_num(likelihood), 0.5), 0.0)
    return (1.0 / (1.0 + (contrast - 1.0) * np.clip(conducting, 0.0, 1.0))).astype(np.float32)


def _as_voxels(entry: Any, name: str, geometry: SurveyGeometry, home: Any) -> Int64Array:
    """Voxels of a point or a horizon in the cube `home`."""
    shape = np.shape(home)
    try:
        values = np.asarray(entry, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(
            f"{name} is {entry!r:.60}; expected a point (inline, crossline, time or depth) or a horizon, of numbers."
        ) from error
    if values.shape == (3,):
        if not np.isfinite(values).all():
            raise ParameterError(f"{name} is {tuple(values.tolist())}; expected finite numbers.")
        at = np.rint(geometry.lines_to_index(values[None]))
        if not ((at >= 0) & (at < shape)).all():
            raise ParameterError(
                f"{name} {tuple(values.tolist())} lies outside the cube: {tell_extent(home)}. "
                "Give a point in it, in this order."
            )
        return at.astype(np.int64)
    if values.shape != tuple(shape[:2]):
        raise ShapeError(
            f"{name} has shape {values.shape}; expected a point (inline, crossline, time or depth) or a horizon of "
            f"shape {tuple(shape[:2])}."
        )
    depth = geometry.sample.index(values)
    known = np.isfinite(depth) & (depth > -0.5) & (depth < shape[2] - 0.5)
    if not known.any():
        raise ParameterError(f"{name} lies nowhere in the cube; expected a horizon in its own time or depth.")
    return np.column_stack([np.argwhere(known), np.rint(depth[known])]).astype(np.int64)


def _in_order(labels: AnyArray) -> tuple[int, ...]:
    """Labels along a path, each where it is first met."""
    seen = dict.fromkeys(int(label) for label in labels if label > 0)
    return tuple(seen)
