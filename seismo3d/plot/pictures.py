"""Slices of a cube as flat pictures with numbered axes: what sections and time slices are drawn from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, BoolArray, Float64Array
from seismo3d._validate import as_number, check_array, told
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.axis import unit_of

_LABELS = {
    "inline": "Inline",
    "crossline": "Crossline",
    "trace": "Trace",
    "time": "Time",
    "depth": "Depth",
}


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """One slice of a cube, or a whole section.

    Attributes
    ----------
    values : ndarray of shape (n_rows, n_columns)
        Amplitudes; rows go down, columns to the right.
    live : ndarray of shape (n_rows, n_columns), bool
        Where there is data.
    rows, columns : ndarray, float64
        Coordinates of the rows and columns.
    row_name, column_name, title : str
        What they are, to be written beside the axes.
    axis : int
        The cube's axis that was held; -1 for a section that was drawn whole.
    index : float
        Where it was held.
    """

    values: AnyArray
    live: BoolArray
    rows: Float64Array
    columns: Float64Array
    row_name: str
    column_name: str
    title: str
    axis: int
    index: float

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top edges of the picture in coordinates, half a cell beyond the centres."""
        (left, right), (top, bottom) = outer_edges(self.columns), outer_edges(self.rows)
        return left, right, bottom, top

    def place(self, column_index: AnyArray, row_index: AnyArray) -> tuple[Float64Array, Float64Array]:
        """Turn fractional indices into coordinates on the picture."""
        return at_index(self.columns, column_index), at_index(self.rows, row_index)


def take_picture(cube: Any, **chosen: float | None) -> Picture:
    """Cut one picture out of a cube; of a lazy cube only that slice is read.

    Parameters
    ----------
    cube : DataArray or ndarray of 2 or 3 axes
        A section is taken whole.
    **chosen : float
        One of ``inline``, ``crossline``, ``time``, ``depth`` (in the cube's coordinates) or ``sample`` (an index);
        None counts as not given, none of them as the middle inline.

    Returns
    -------
    Picture
        Sections have traces as columns, time slices crosslines.

    Raises
    ------
    ParameterError
        If more than one is given, the cube has no such axis, or the value is not on it.
    ShapeError
        If the cube has neither 2 nor 3 axes.
    """
    given = {name: value for name, value in chosen.items() if value is not None}
    names = name_axes(cube)
    if len(names) == 2:
        if given:
            raise ParameterError(f"{next(iter(given))} is given for a section; it is drawn whole. Leave it out.")
        return _picture(cube, names, axis=-1, index=0)
    if len(given) > 1:
        raise ParameterError(f"{' and '.join(given)} are given; expected one of them. A picture holds one axis.")
    name, value = next(iter(given.items()), ("inline", None))
    axis = _find_axis(name, names)
    index = (
        cube.shape[axis] // 2
        if value is None
        else find_index(cube, axis, as_number(value, name), as_index=name == "sample")
    )
    return _picture(cube, names, axis=axis, index=index)


def name_axes(cube: Any) -> tuple[str, ...]:
    """Names of a cube's axes; a bare array's are inline, crossline (or trace) and sample."""
    check_array(cube, "cube")
    if hasattr(cube, "dims"):
        names = tuple(str(name) for name in cube.dims)
    else:
        names = {2: ("trace", "sample"), 3: ("inline", "crossline", "sample")}.get(np.ndim(cube), ())
    if getattr(cube, "dtype", np.dtype(float)).kind not in "fiub":
        raise ShapeError(f"cube has elements of type {cube.dtype}; expected real numbers. Convert it first.")
    if len(names) not in (2, 3):
        raise ShapeError(f"cube has shape {np.shape(cube)}; expected (inline, crossline, sample) or (trace, sample).")
    return names


def as_tracks(tracks: Any) -> list[Any]:
    """Return tracks as a list, none for none, or refuse what is no list of them."""
    if tracks is None:
        return []
    if not isinstance(tracks, (list, tuple)):
        raise ParameterError(f"tracks is {told(tracks)}; expected a list of Track. Give a list, be it of one.")
    return list(tracks)


def axis_coordinates(cube: Any, axis: int) -> Float64Array:
    """Coordinates along an axis; indices where the cube has none."""
    if hasattr(cube, "dims") and cube.dims[axis] in cube.coords:
        return np.asarray(cube[cube.dims[axis]].values, dtype=np.float64)
    return np.arange(cube.shape[axis], dtype=np.float64)


def outer_edges(coordinates: Float64Array) -> tuple[float, float]:
    """Coordinates half a step before the first and past the last, whichever way they go."""
    first, last = at_index(coordinates, np.array([-0.5, len(coordinates) - 0.5]))
    return float(first), float(last)


def at_index(coordinates: Float64Array, index: AnyArray) -> Float64Array:
    """Coordinates at fractional indices, carried on beyond both ends."""
    step = (coordinates[-1] - coordinates[0]) / (len(coordinates) - 1) if len(coordinates) > 1 else 1.0
    index = np.asarray(index, dtype=np.float64)
    inside = np.clip(index, 0, len(coordinates) - 1)
    return np.interp(inside, np.arange(len(coordinates)), coordinates) + (index - inside) * step


def axis_labels(cube: Any) -> tuple[str, ...]:
    """Return what is written beside each axis of a cube; a time or depth in samples is a sample number."""
    names = name_axes(cube)
    unit = unit_of(cube)
    last = "Sample" if unit == "samples" else f"{_LABELS.get(names[-1], names[-1])} ({unit})"
    return *(_LABELS.get(name, name) for name in names[:-1]), last


def find_index(cube: Any, axis: int, value: float, *, as_index: bool = False) -> int:
    """Find the line nearest to a coordinate that lies within the cube."""
    coordinates = np.arange(cube.shape[axis], dtype=np.float64) if as_index else axis_coordinates(cube, axis)
    distance = np.abs(coordinates - value)
    index = int(distance.argmin())
    low, high = coordinates.min(), coordinates.max()
    slack = 1e-3 * _step(coordinates)
    if not low - slack <= value <= high + slack:
        name = "sample" if as_index else name_axes(cube)[axis]
        raise ParameterError(f"{name} is {value:.8g}; expected {low:.8g} to {high:.8g}. Choose a line of the cube.")
    return index


def live_traces(cube: Any) -> BoolArray:
    """Traces with data, from the cube's ``live`` coordinate; without one all are.

    Of a cube whose live traces are not counted yet (a lazy one) all are taken for live: to count them is to read it.
    """
    if _has_live(cube) and is_live_counted(cube):
        return np.asarray(cube["live"].data, dtype=bool)
    return np.ones(cube.shape[:-1], dtype=bool)


def is_live_counted(cube: Any) -> bool:
    """Whether it is known without reading a cube which of its traces are live; of a lazy one it is not."""
    return not _has_live(cube) or isinstance(cube["live"].data, np.ndarray)


def _has_live(cube: Any) -> bool:
    return hasattr(cube, "coords") and "live" in cube.coords


def live_on_slice(cube: Any, axis: int, index: int) -> BoolArray:
    """Live traces of one slice, read from that slice where they are not known; all of them for axis 2 or -1."""
    if not _has_live(cube):
        return np.ones([n for k, n in enumerate(cube.shape[:-1]) if k != axis], dtype=bool)
    live = cube["live"]
    cut = live[(slice(None),) * axis + (index,)] if axis in (0, 1) else live
    return np.asarray(cut.data, dtype=bool)


def _find_axis(name: str, names: tuple[str, ...]) -> int:
    if name == "sample":
        return 2
    if name not in names:
        known = ", ".join((*names, "sample") if "sample" not in names else names)
        raise ParameterError(f"{name} is asked of a cube with axes {', '.join(names)}; expected one of {known}.")
    return names.index(name)


def _picture(cube: Any, names: tuple[str, ...], *, axis: int, index: int) -> Picture:
    cut = cube if axis < 0 else cube[(slice(None),) * axis + (index,)]
    values = np.asarray(cut.data if hasattr(cut, "dims") else cut)
    live = live_on_slice(cube, axis, index)
    labels = axis_labels(cube)
    kept = [k for k in range(len(names)) if k != axis]
    if axis == 2:
        unit = unit_of(cube)
        mask, title = live, f"{labels[2].split(' (')[0]} {axis_coordinates(cube, 2)[index]:.8g}"
        title += "" if unit == "samples" else f" {unit}"
        column, row = 1, 0
    else:
        column, row = kept
        mask = np.broadcast_to(live[None, :], values.T.shape)
        values = values.T
        title = "" if axis < 0 else f"{labels[axis]} {axis_coordinates(cube, axis)[index]:.8g}"
    return Picture(
        values=values,
        live=mask & np.isfinite(values),
        rows=axis_coordinates(cube, row),
        columns=axis_coordinates(cube, column),
        row_name=labels[row],
        column_name=labels[column],
        title=title,
        axis=axis,
        index=float(index),
    )


def _step(coordinates: Float64Array) -> float:
    return float(np.abs(np.diff(coordinates)).mean()) if len(coordinates) > 1 else 1.0
