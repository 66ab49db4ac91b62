"""Cubes to plain arrays and back: how a DataArray is laid into an archive without losing a coordinate."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray


def pack_labelled(values: Any, name: str) -> tuple[dict[str, AnyArray], dict[str, Any]]:
    """Split an array or DataArray into plain arrays and a description.

    Parameters
    ----------
    values : ndarray or xarray.DataArray
        What to split; a lazy array is computed.
    name : str
        Prefix of the arrays' names.

    Returns
    -------
    arrays : dict of str to ndarray
        ``name`` itself, and ``name.COORDINATE`` for every coordinate.
    description : dict
        Dimensions, attributes and coordinates; empty for a bare array.
    """
    if not hasattr(values, "dims"):
        return {name: np.asarray(values)}, {}
    arrays = {name: np.asarray(values.data)}
    coordinates = {}
    for key, coordinate in values.coords.items():
        arrays[f"{name}.{key}"] = np.asarray(coordinate.data)
        coordinates[str(key)] = {"dims": tuple(coordinate.dims), "attrs": dict(coordinate.attrs)}
    description = {"dims": tuple(values.dims), "name": values.name, "attrs": dict(values.attrs), "coords": coordinates}
    return arrays, description


def unpack_labelled(arrays: dict[str, AnyArray], name: str, *, description: dict[str, Any]) -> Any:
    """Rebuild what :func:`pack_labelled` split.

    Parameters
    ----------
    arrays : dict of str to ndarray
        The plain arrays.
    name : str
        Prefix of the arrays' names.
    description : dict
        What :func:`pack_labelled` gave with them.

    Returns
    -------
    ndarray or xarray.DataArray
        The array as it was.
    """
    if not description:
        return arrays[name]
    import xarray as xr

    coordinates = {
        key: (entry["dims"], arrays[f"{name}.{key}"], entry["attrs"]) for key, entry in description["coords"].items()
    }
    return xr.DataArray(
        arrays[name], dims=description["dims"], coords=coordinates, name=description["name"], attrs=description["attrs"]
    )
