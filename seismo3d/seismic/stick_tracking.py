"""A fault stick followed from slice to slice."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, Float32Array, Float64Array
from seismo3d._validate import as_number, as_points, as_whole_number
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.geometry.triangles import simplify_line
from seismo3d.io.fault_sticks import FaultStick
from seismo3d.seismic.cube_checks import check_cube

# farthest that a stick moves from a slice to the next beyond its own drift, and the step in which it is sought
_FARTHEST, _STEP = 2.5, 0.25
# cost of a bend: evidence lost for a trace that it moves from a sample to the next
_STIFF = 1.5
# slices in a row without evidence at which a stick ends
_PATIENCE = 3


def follow_stick(
    cube: Any, stick: Any, *, faults: Any = None, farthest: int | None = None, least: float = 0.4, name: str = "stick"
) -> list[FaultStick]:
    """Follow a fault stick, picked on one inline or crossline, to the slices on both sides of it.

    On each next slice the stick may shift and bend a little from where its drift so far leads it: the course over the
    strongest breaks wins, found by dynamic programming from its top to its foot. It ends where it loses too much of the
    evidence that it had on its own slice.

    Parameters
    ----------
    cube : DataArray or array_like
        A cube (inline, crossline, sample).
    stick : array_like of shape (n, 3)
        Nodes (inline, crossline, time or depth) from top to foot, all on one inline or all on one crossline, in the
        cube's coordinates (indices on a bare array).
    faults : FaultSet, optional
        Faults of this cube: their likelihood, in place of what semblance lacks, is then the evidence.
    farthest : int, optional
        Most slices to follow it to each way. [default: to the cube's ends]
    least : float
        Share of its own evidence below which it ends, 0 to 1.
    name : str
        Name of the fault.

    Returns
    -------
    list of FaultStick
        One a slice, in the order of the slices, the picked one among them.

    Raises
    ------
    ShapeError
        If the cube has not three axes, the faults are of another one, or the stick is no such array.
    GeometryError
        If the stick lies on no one slice, leaves the cube, or does not run downwards.
    ParameterError
        If `least` or `farthest` has no meaning.
    """
    check_cube(cube, faults)
    share = as_number(least, "least", low=0.0, high=1.0)
    most = as_whole_number(farthest, "farthest", low=0) if farthest is not None else max(np.shape(cube))
    geometry = SurveyGeometry.from_cube(cube)
    axis, start, samples, places = _lay_out(geometry.lines_to_index(as_points(stick, "stick", dim=3)), np.shape(cube))
    evidence = np.moveaxis(_evidence(cube, faults), axis, 0)
    own = _mean_along(evidence[start], places, samples)
    if not own > 0.0:
        raise ParameterError("stick lies where nothing breaks; expected it on a fault. Pick it anew.")
    found = {start: places}
    for step in (-1, 1):
        found |= _walk(evidence, (start, places), samples, step=step, most=most, least=share * own)
    return [_as_stick(geometry, axis, k, found[k], samples, name, n) for n, k in enumerate(sorted(found), start=1)]


def _lay_out(nodes: Float64Array, shape: tuple[int, ...]) -> tuple[int, int, AnyArray, Float64Array]:
    """Axis that the stick holds, its slice there, every sample that it spans, and its place across at each."""
    if len(nodes) < 2 or not (np.diff(nodes[:, 2]) > 0).all():
        raise GeometryError("stick does not run downwards; expected two nodes or more, each below the one before.")
    spread = np.ptp(nodes[:, :2], axis=0)
    axis = int(spread.argmin())
    slice_number = int(np.rint(nodes[0, axis]))
    if spread[axis] > 0.5 or np.abs(nodes[:, axis] - slice_number).max() > 0.5:
        raise GeometryError(
            f"stick spans {spread[0]:.1f} inlines and {spread[1]:.1f} crosslines; expected it on one inline or on one "
            "crossline."
        )
    if (nodes < -0.5).any() or (nodes > np.array(shape) - 0.5).any():
        raise GeometryError("stick leaves the cube; expected it inside, in the cube's coordinates.")
    samples = np.arange(int(np.ceil(nodes[0, 2])), int(np.floor(nodes[-1, 2])) + 1)
    if len(samples) < 4:
        raise GeometryError(f"stick spans {len(samples)} samples; expected four or more. Pick a longer one.")
    return axis, slice_number, samples, np.interp(samples, nodes[:, 2], nodes[:, 1 - axis])


def _evidence(cube: Any, faults: Any) -> Float32Array:
    """How strongly layers break at every voxel, smoothed by a voxel, less what is usual in the cube."""
    if faults is not None:
        return np.asarray(ndimage.gaussian_filter(np.nan_to_num(np.asarray(faults.likelihood, np.float32)), 0.8))
    from seismo3d.seismic.attributes import compute_attributes

    values = getattr(cube, "values", cube)
    semblance = np.asarray(compute_attributes(np.asarray(values, dtype=np.float32))["semblance"], dtype=np.float32)
    known = np.isfinite(semblance)
    usual = np.median(semblance[known]) if known.any() else 0.0
    # where there are no data nothing unusual is known
    lack = np.where(known, usual - semblance, np.float32(0.0))
    return np.asarray(ndimage.gaussian_filter(lack, (0.5, 0.5, 2.0)), dtype=np.float32)


def _walk(
    evidence: Float32Array, begin: tuple[int, Float64Array], samples: AnyArray, *, step: int, most: int, least: float
) -> dict[int, Float64Array]:
    """Places on the slices one way from the first, until the evidence is lost."""
    k, places = begin
    drift, weak = 0.0, 0
    found: dict[int, Float64Array] = {}
    while 0 <= k + step < len(evidence) and abs(k + step - begin[0]) <= most and weak < _PATIENCE:
        k += step
        moved = _best_course(evidence[k], places + drift, samples)
        inside = (moved >= 0).mean() > 0.5 and (moved <= evidence.shape[1] - 1).mean() > 0.5
        if not inside:
            break
        weak = 0 if _mean_along(evidence[k], moved, samples) >= least else weak + 1
        if weak == 0:
            drift = 0.7 * drift + 0.3 * float(np.mean(moved - places))
        places = moved if weak == 0 else places + drift
        found[k] = places
    for last in sorted(found, key=lambda n: abs(n - begin[0]))[len(found) - weak :]:
        del found[last]  # nothing was there
    return found


def _best_course(picture: Float32Array, expected: Float64Array, samples: AnyArray) -> Float64Array:
    """Course near the expected one over the most evidence, with little bending."""
    offsets = np.arange(-_FARTHEST, _FARTHEST + _STEP / 2, _STEP)
    at = np.stack(np.broadcast_arrays(expected[:, None] + offsets, samples[:, None]))
    worth = ndimage.map_coordinates(picture, at, order=1, cval=0.0)
    bend = _STIFF * (offsets[:, None] - offsets[None, :]) ** 2 * max(float(worth.max()), 1e-9)
    total, came = worth[0].copy(), np.zeros(worth.shape, np.int64)
    for k in range(1, len(samples)):
        through = total[:, None] - bend
        came[k] = through.argmax(axis=0)
        total = through.max(axis=0) + worth[k]
    course = np.empty(len(samples), np.int64)
    course[-1] = int(total.argmax())
    for k in range(len(samples) - 1, 0, -1):
        course[k - 1] = came[k, course[k]]
    return np.asarray(expected + ndimage.gaussian_filter1d(offsets[course], 3.0, mode="nearest"))


def _mean_along(picture: Float32Array, places: Float64Array, samples: AnyArray) -> float:
    return float(ndimage.map_coordinates(picture, np.stack([places, samples]), order=1, cval=0.0).mean())


def _as_stick(
    geometry: SurveyGeometry, axis: int, k: int, places: Float64Array, samples: AnyArray, name: str, number: int
) -> FaultStick:
    line = np.column_stack([places, samples])
    line = line[simplify_line(line, tolerance=0.25)]
    columns = [np.full(len(line), float(k)), line[:, 0]]
    index = np.column_stack([*(columns if axis == 0 else columns[::-1]), line[:, 1]])
    return FaultStick(name, number, geometry.index_to_map(index), geometry.index_to_lines(index)[:, :2])
