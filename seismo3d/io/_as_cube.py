"""Convert an array or a DataArray to a cube or a section, or refuse it."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._validate import as_array, as_number, is_among, told
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.axis import USUAL_UNITS, unit_of


def as_cube(
    values: Any, *, domain: str = "time", interval: float | None = None, start: float = 0.0, name: str = "cube"
) -> Any:
    """Convert to a DataArray with dims (inline, crossline, time or depth), or (trace, time or depth); or refuse.

    Parameters
    ----------
    values : DataArray or array of 2 or 3 axes
        A DataArray must have those dimensions, in any order; it comes back as it is, in the right order. An array in
        memory or lazy (dask) is taken as (inline, crossline, sample) or (trace, sample), numbered from 0.
    domain : {"time", "depth"}
        What the samples of a bare array run along.
    interval, start : float
        Sample interval and first sample of a bare array in ms or m; without an interval, its coordinate is the
        sample's index, and its attribute ``sample_unit`` is "samples".
    name : str
        What to call it in an error.

    Returns
    -------
    DataArray

    Raises
    ------
    ShapeError
        If it has other axes, no element, or elements that are not real numbers.

    Examples
    --------
    >>> import numpy as np
    >>> as_cube(np.zeros((2, 3, 4)), interval=4.0).time.values.tolist()
    [0.0, 4.0, 8.0, 12.0]
    """
    import xarray as xr

    if isinstance(values, xr.Dataset):
        raise ShapeError(f"{name} is a Dataset; expected a DataArray. Select one of {list(values.data_vars)}.")
    if isinstance(values, xr.DataArray):
        return _ordered(values, name)
    if not is_among(domain, USUAL_UNITS):
        raise ParameterError(f"domain is {told(domain)}; expected 'time' or 'depth'.")
    data = values if _is_lazy(values) else as_array(values, name)
    _refuse_elements(data, name)
    if data.ndim not in (2, 3):
        raise ShapeError(f"{name} has shape {data.shape}; expected (inline, crossline, sample) or (trace, sample).")
    lateral = ("trace",) if data.ndim == 2 else ("inline", "crossline")
    step = 1.0 if interval is None else as_number(interval, "interval", low=0, strict=True)
    unit = "samples" if interval is None else USUAL_UNITS[domain]
    coords: dict[str, Any] = {dim: np.arange(n, dtype=np.int64) for dim, n in zip(lateral, data.shape)}
    coords[domain] = (domain, as_number(start, "start") + step * np.arange(data.shape[-1]), {"units": unit})
    return xr.DataArray(data, dims=(*lateral, domain), coords=coords, name="amplitude", attrs={"sample_unit": unit})


def _ordered(cube: Any, name: str) -> Any:
    dims = set(cube.dims)
    vertical = [d for d in ("time", "depth") if d in dims]
    lateral = ("trace",) if cube.ndim == 2 else ("inline", "crossline")
    if len(vertical) != 1 or dims != {*lateral, vertical[0]}:
        raise ShapeError(
            f"{name} has dimensions {tuple(cube.dims)}; expected (inline, crossline, time or depth) or "
            "(trace, time or depth). Rename them, or give the bare array."
        )
    _refuse_elements(cube, name)
    ordered = cube.transpose(*lateral, vertical[0])
    absent = {d: np.arange(ordered.sizes[d]) for d in ordered.dims if d not in ordered.coords}
    if absent:
        ordered = ordered.assign_coords(absent)
    if "sample_unit" not in ordered.attrs:
        ordered = ordered.assign_attrs(sample_unit="samples" if vertical[0] in absent else unit_of(ordered))
    return ordered


def _refuse_elements(data: Any, name: str) -> None:
    if data.dtype.kind not in "fiub":
        raise ShapeError(f"{name} has elements of type {data.dtype}; expected real numbers. Convert it first.")
    if data.size == 0:
        raise ShapeError(f"{name} has shape {tuple(data.shape)}: it is empty. Give at least one element.")


def _is_lazy(values: Any) -> bool:
    return hasattr(values, "dask") and hasattr(values, "chunks")
