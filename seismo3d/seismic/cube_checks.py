"""Refuse cubes whose axes are in another order, and faults or cubes that are of another survey."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import check_array, told
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry.axis import check_downwards
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry, usual_spacing

_ORDER = ("inline", "crossline", "trace", "time", "depth")
# share of a step by which coordinates that are the same may differ
_SAME = 0.01
# share of the distance between traces by which places on the map may differ and be the same: those of maps fitted to
# rounded coordinates do
_SAME_PLACE = 0.25


def check_order(cube: Any, name: str = "cube") -> None:
    """Refuse a DataArray whose axes, as far as they have usual names, are in another order, or whose samples run up."""
    check_array(cube, name)
    dims = [str(dim) for dim in getattr(cube, "dims", ())]
    known = [dim for dim in dims if dim in _ORDER]
    wanted = sorted(known, key=_ORDER.index)
    if known != wanted or (known and known[-1] in ("time", "depth") and dims[-1] != known[-1]):
        order = ", ".join(repr(dim) for dim in [*(d for d in dims if d not in _ORDER), *wanted])
        raise ShapeError(f"{name} has the axes {', '.join(dims)} in this order. Give {name}.transpose({order}).")
    if dims and dims[-1] not in _ORDER[:3]:
        check_downwards(cube, name)


def check_cube(cube: Any, faults: Any) -> None:
    """Refuse what is no cube of the usual axes, and faults of another one; None is fine."""
    check_order(cube)
    if np.ndim(cube) != 3:
        raise ShapeError(f"cube has shape {np.shape(cube)}; expected (inline, crossline, sample). Give a cube.")
    check_faults_of(cube, faults)


def tell_extent(cube: Any) -> str:
    """Say from which coordinate to which each axis of a cube or section runs, of a bare array by index."""
    usual = ("inline", "crossline", "sample") if np.ndim(cube) == 3 else ("trace", "sample")
    words = []
    for name, n in zip(getattr(cube, "dims", usual), np.shape(cube), strict=True):
        has_own = hasattr(cube, "dims") and name in cube.coords
        ends = (float(cube[name][0]), float(cube[name][-1])) if has_own else (0.0, n - 1.0)
        words.append(f"{name} {ends[0]:.8g} to {ends[1]:.8g}")
    return ", ".join(words)


def check_faults(faults: Any) -> None:
    """Refuse what is no set of faults."""
    if not (hasattr(faults, "labels") and hasattr(faults, "surfaces")):
        raise ParameterError(f"faults is {told(faults)}; expected a FaultSet. Give what trace_faults returned.")


def check_faults_of(cube: Any, faults: Any, name: str = "cube") -> None:
    """Refuse faults of a cube or section of another shape, or of the same shape elsewhere; None is fine."""
    if faults is None:
        return
    check_faults(faults)
    if np.shape(faults.labels) != np.shape(cube):
        raise ShapeError(
            f"faults are of a {name} of shape {np.shape(faults.labels)}; {name} has shape {np.shape(cube)}. "
            f"Give the {name} that they were traced in."
        )
    axis = differing_axis(faults.labels, cube)
    if axis is not None:
        raise GeometryError(
            f"faults are of a {name} with other {axis} coordinates than {name} has. Give the {name} that they were "
            "traced in."
        )


def placing_cube(cube: Any, faults: Any) -> Any:
    """Return what tells where faults of a cube lie: that cube, refused where it is another one, or their labels."""
    check_faults(faults)
    if np.ndim(faults.labels) != 3:
        raise ShapeError(
            f"faults are of a section of shape {np.shape(faults.labels)}; expected those of a cube. Trace a cube."
        )
    if cube is None:
        return faults.labels
    check_cube(cube, faults)
    return cube


def differing_axis(one: Any, other: Any) -> str | None:
    """Return in which coordinates two cubes or sections of one shape differ; None for bare arrays.

    That is an axis, the line that both are cut from, or "map" where both have one and their traces lie elsewhere on it.
    """
    if not (hasattr(one, "dims") and hasattr(other, "dims")):
        return None
    cut = [name for name in _ORDER if all(name in a.coords and a[name].ndim == 0 for a in (one, other))]
    for name in (*one.dims, *cut):
        if name not in one.coords:
            continue
        if name not in other.coords:
            return str(name)
        first, second = (np.atleast_1d(np.asarray(a[name].values, dtype=np.float64)) for a in (one, other))
        step = float(np.min(np.abs(np.diff(first)))) if len(first) > 1 else 1.0
        if first.shape != second.shape or np.abs(first - second).max(initial=0.0) > _SAME * step:
            return str(name)
    return "map" if _lies_elsewhere(one, other) else None


def _lies_elsewhere(one: Any, other: Any) -> bool:
    """Tell whether traces of two cubes or sections lie apart on the map."""
    first, second = (_places(a) for a in (one, other))
    if first is None or second is None:
        return False
    apart = np.linalg.norm(first - second, axis=-1)
    # of a cube the first traces each way are neighbours
    spacing = usual_spacing(first[:2, :2] if first.ndim == 3 else first)
    return bool(np.nanmax(apart, initial=0.0) > _SAME_PLACE * spacing)


def _places(cube: Any) -> Float64Array | None:
    """Map coordinates of a section's traces, or of a cube's first and last ones of each line: x and y come last."""
    if len(cube.dims) == 2:
        return SectionGeometry.from_cube(cube).xy
    try:
        geometry = SurveyGeometry.from_cube(cube)
    except GeometryError:  # lines that are not evenly spaced have no affine map
        return None
    if not geometry.has_map:
        return None
    ends = [[0.0, 1.0, float(n - 1)] for n in cube.shape[:2]]
    corners = np.stack(np.meshgrid(*ends, [0.0], indexing="ij"), axis=-1)
    return geometry.index_to_map(corners.reshape(-1, 3))[:, :2].reshape(3, 3, 2)
