"""Refuse cubes whose axes are in another order, and faults or cubes that are of another survey."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d.errors import GeometryError, ShapeError

_ORDER = ("inline", "crossline", "trace", "time", "depth")
# share of a step by which coordinates that are the same may differ
_SAME = 0.01


def check_order(cube: Any, name: str = "cube") -> None:
    """Refuse a DataArray whose axes, as far as they have the usual names, are in another order than the usual one."""
    dims = [str(dim) for dim in getattr(cube, "dims", ())]
    known = [dim for dim in dims if dim in _ORDER]
    wanted = sorted(known, key=_ORDER.index)
    if known != wanted or (known and known[-1] in ("time", "depth") and dims[-1] != known[-1]):
        order = ", ".join(repr(dim) for dim in [*(d for d in dims if d not in _ORDER), *wanted])
        raise ShapeError(f"{name} has the axes {', '.join(dims)} in this order. Give {name}.transpose({order}).")


def check_cube(cube: Any, faults: Any) -> None:
    """Refuse what is no cube of the usual axes, and faults of another one; None is fine."""
    check_order(cube)
    if np.ndim(cube) != 3:
        raise ShapeError(f"cube has shape {np.shape(cube)}; expected (inline, crossline, sample). Give a cube.")
    check_faults_of(cube, faults)


def check_faults_of(cube: Any, faults: Any) -> None:
    """Refuse faults of a cube of another shape, or of the same shape elsewhere; None is fine."""
    if faults is None:
        return
    if np.shape(faults.labels) != np.shape(cube):
        raise ShapeError(
            f"faults are of a cube of shape {np.shape(faults.labels)}; cube has shape {np.shape(cube)}. "
            "Give the cube that they were traced in."
        )
    axis = differing_axis(faults.labels, cube)
    if axis is not None:
        raise GeometryError(
            f"faults are of a cube with other {axis} coordinates than cube has. Give the cube that they were traced in."
        )


def differing_axis(one: Any, other: Any) -> str | None:
    """Return an axis along which the coordinates of two cubes of one shape differ; None for bare arrays."""
    if not (hasattr(one, "dims") and hasattr(other, "dims")):
        return None
    for name in one.dims:
        if name not in one.coords:
            continue
        if name not in other.coords:
            return str(name)
        first, second = (np.asarray(a[name].values, dtype=np.float64) for a in (one, other))
        step = float(np.min(np.abs(np.diff(first)))) if len(first) > 1 else 1.0
        if first.shape != second.shape or np.abs(first - second).max(initial=0.0) > _SAME * step:
            return str(name)
    return None
