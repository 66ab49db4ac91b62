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
# traces by which a stick may spread more along one axis than along the other and still hold both as well
_AS_WELL = 0.1
# slices to each side over which the two ways of a vertical stick are compared; how many times the evidence of the other
# the better one gathers; traces within which both find one fault
_COMPARED, _CLEARLY, _ONE_FAULT = 8, 1.25, 4.0

_Laid = tuple[int, int, AnyArray, Float64Array]
"""Axis that a stick holds, its slice there, every sample that it spans, and its place across at each."""


def follow_stick(
    cube: Any, stick: Any, *, faults: Any = None, farthest: int | None = None, least: float = 0.4, name: str = "stick"
) -> list[FaultStick]:
    """Follow a fault stick, picked on one inline or crossline, to the slices on both sides of it.

    On each next slice the stick may shift and bend a little from where its drift so far leads it: the course over the
    strongest breaks wins, found by dynamic programming from its top to its foot. It ends where it loses too much of the
    evidence that it had on its own slice.

    A vertical stick lies on an inline and on a crossline. It is followed a few slices both ways then, and on the way
    that gathers more evidence.

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
        If `least` or `farthest` has no meaning, nothing breaks along the stick, or it is vertical and the evidence does
        not tell which way its fault runs.
    """
    check_cube(cube, faults)
    share = as_number(least, "least", low=0.0, high=1.0)
    most = as_whole_number(farthest, "farthest", low=0) if farthest is not None else max(np.shape(cube))
    geometry = SurveyGeometry.from_cube(cube)
    laid = _lay_out(geometry.lines_to_index(as_points(stick, "stick", dim=3)), np.shape(cube))
    evidence = _evidence(cube, faults)
    chosen = laid[0] if len(laid) == 1 else _choose_way(evidence, laid, share)
    found = _follow(evidence, chosen, most=most, share=share)
    axis, _, samples, _ = chosen
    return [_as_stick(geometry, axis, k, found[k], samples, name, n) for n, k in enumerate(sorted(found), start=1)]


def _lay_out(nodes: Float64Array, shape: tuple[int, ...]) -> list[_Laid]:
    """Return the stick on the slice that it lies on; on both where it lies as well on an inline as on a crossline."""
    if len(nodes) < 2 or not (np.diff(nodes[:, 2]) > 0).all():
        raise GeometryError("stick does not run downwards; expected two nodes or more, each below the one before.")
    spread = np.ptp(nodes[:, :2], axis=0)
    slices = np.rint(nodes[0, :2]).astype(int)
    off = np.abs(nodes[:, :2] - slices).max(axis=0)
    held = np.flatnonzero((off <= 0.5) & (spread <= min(0.5, spread.min() + _AS_WELL)))
    if not len(held):
        raise GeometryError(
            f"stick spans {spread[0]:.1f} inlines and {spread[1]:.1f} crosslines; expected it on one inline or on one "
            "crossline."
        )
    if (nodes < -0.5).any() or (nodes > np.array(shape) - 0.5).any():
        raise GeometryError("stick leaves the cube; expected it inside, in the cube's coordinates.")
    samples = np.arange(int(np.ceil(nodes[0, 2])), int(np.floor(nodes[-1, 2])) + 1)
    if len(samples) < 4:
        raise GeometryError(f"stick spans {len(samples)} samples; expected four or more. Pick a longer one.")
    return [(int(k), int(slices[k]), samples, np.interp(samples, nodes[:, 2], nodes[:, 1 - k])) for k in held]


def _choose_way(evidence: Float32Array, ways: list[_Laid], share: float) -> _Laid:
    """Return the way on which the stick gathers clearly more evidence; the better one where both find one fault."""
    found = [_follow(evidence, way, most=_COMPARED, share=share) for way in ways]
    gathered = [_gathered(evidence, way, courses) for way, courses in zip(ways, found, strict=True)]
    if max(gathered) < _CLEARLY * min(gathered) and _apart(found[0], found[1]) > _ONE_FAULT:
        raise ParameterError(
            "stick is vertical, and breaks run along both the inlines and the crosslines; expected one clearest way. "
            "Tilt the stick by one line, or pick it on a section that crosses the fault."
        )
    return ways[int(np.argmax(gathered))]


def _gathered(evidence: Float32Array, way: _Laid, found: dict[int, Float64Array]) -> float:
    """Evidence along the stick, averaged over all slices that it might have been followed to for comparison."""
    axis, start, samples, _ = way
    slices = np.moveaxis(evidence, axis, 0)
    n_slices = min(start + _COMPARED, len(slices) - 1) - max(start - _COMPARED, 0) + 1
    return sum(_mean_along(slices[k], places, samples) for k, places in found.items()) / n_slices


def _apart(by_inline: dict[int, Float64Array], by_crossline: dict[int, Float64Array]) -> float:
    """Farthest in map view that the nearer-reaching of the two ways lies from the other."""
    one = np.array([(k, places.mean()) for k, places in by_inline.items()])
    other = np.array([(places.mean(), k) for k, places in by_crossline.items()])
    distances = np.linalg.norm(one[:, None] - other[None, :], axis=2)
    return float(min(distances.min(axis=1).max(), distances.min(axis=0).max()))


def _follow(evidence: Float32Array, way: _Laid, *, most: int, share: float) -> dict[int, Float64Array]:
    """Places on every slice that the stick is followed to, its own among them."""
    axis, start, samples, places = way
    slices = np.moveaxis(evidence, axis, 0)
    own = _mean_along(slices[start], places, samples)
    if not own > 0.0:
        raise ParameterError("stick lies where nothing breaks; expected it on a fault. Pick it anew.")
    found = {start: places}
    for step in (-1, 1):
        found |= _walk(slices, (start, places), samples, step=step, most=most, least=share * own)
    return found


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
