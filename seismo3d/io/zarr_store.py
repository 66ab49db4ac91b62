"""Cubes in Zarr: bricks that can be read along any axis, with coordinates and attributes beside them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import Progress
from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.io._as_cube import as_cube
from seismo3d.io._files import as_path, written_aside
from seismo3d.io.numpy_files import check_declared, refuse_damage

_BRICK = 64
_SLAB_BYTES = 512 * 2**20


def write_zarr(path: Any, cube: Any, *, brick: int = _BRICK, progress: Progress | None = None) -> Path:
    """Write a cube or a section as a Zarr group, a slab of bricks at a time; it appears complete, or not at all.

    Parameters
    ----------
    path : path
        The folder to make; a Zarr group that is there is replaced, any other folder is refused.
    cube : DataArray or array
        In memory or lazy.
    brick : int
        Edge of a brick, the unit of reading, in samples.
    progress : callable, optional
        Called with "write" and the share done.

    Raises
    ------
    FileAccessError
        If the folder cannot be written, or is there and is no Zarr group.
    """
    volume = as_cube(cube)
    out = as_path(path)
    if brick < 1:
        raise ParameterError(f"brick is {brick}; expected at least 1.")
    if out.is_file() or (out.is_dir() and not (out / "zarr.json").is_file()):
        raise FileAccessError(f"{out} is there and is no Zarr group; expected a free name. Remove it, or name another.")
    report = as_progress(progress)
    name = str(volume.name or "amplitude")
    volume = volume.rename(name)
    slab_bytes = int(np.prod(volume.shape[1:], dtype=np.int64)) * volume.dtype.itemsize
    edge = int(max(1, min(brick, volume.shape[0], _SLAB_BYTES // max(1, slab_bytes))))
    chunks = (edge, *(min(brick, n) for n in volume.shape[1:]))
    with written_aside(out, folder=True) as aside:
        make_group(aside, volume, name, chunks)
        first_dim = str(volume.dims[0])
        for start in range(0, volume.shape[0], edge):
            part = volume[start : start + edge].compute()
            _write_slab(aside, part, name, first_dim, start)
            report("write", min(1.0, (start + edge) / volume.shape[0]))
    return out


def read_zarr(path: Any, *, variable: str | None = None, lazy_above: int = 2 * 2**30) -> Any:
    """Open a cube or a section from a Zarr group; lazy above a size, with the store's own chunks.

    Raises
    ------
    FileAccessError, FormatError
        If it cannot be read, or holds no such array.
    """
    import xarray as xr

    store = as_path(path)
    if not store.exists():
        raise FileAccessError(f"{store} does not exist. Check the path.")
    if not store.is_dir():
        raise FormatError(f"{store} is a file; expected a folder that holds a Zarr group.")
    with refuse_damage(store, "Zarr group"):
        is_mdio = _is_mdio(store)
        dataset = xr.open_zarr(store, chunks=None, consolidated=False, drop_variables=_MDIO_RECORDS)
        dataset = dataset.rename({name: usual for name, usual in _USUAL_NAMES.items() if name in dataset.dims})
        cube = dataset[_choose(dataset, variable, store)]
        loaded = sum(c.nbytes for c in cube.coords.values()) + (cube.nbytes if cube.nbytes <= lazy_above else 0)
        if loaded > 0:
            check_declared(loaded, _stored_bytes(store, loaded), str(store))
        coords = {n: c.compute() for n, c in cube.coords.items() if c.nbytes < 2**30}
        attrs = dict(cube.attrs)
        if is_mdio:
            coords |= _mdio_coordinates(dataset, cube)
            attrs.pop("statsV1", None)
        lazy = xr.DataArray(_as_dask(cube, store), dims=cube.dims, coords=coords, name=cube.name, attrs=attrs)
        file_format = "MDIO" if is_mdio else "Zarr"
        made = as_cube(lazy, name=str(store)).assign_attrs(path=str(store), file_format=file_format)
        if (note := _doubt_unit(lazy)) is not None:
            made = made.assign_attrs(notes=[*made.attrs.get("notes", ()), note])
    return made if made.nbytes > lazy_above else made.compute()


# names of axes that segysak gives
_USUAL_NAMES = {"iline": "inline", "xline": "crossline", "twt": "time"}


def _choose(dataset: Any, variable: str | None, store: Path) -> str:
    """Return the name of the array to take: the one asked for, or the only one that may be a cube or a section."""
    held = {name: tuple(dataset[name].dims) for name in sorted(map(str, dataset.data_vars))}
    if variable is not None:
        if variable not in held:
            raise ParameterError(f"{store} has no array {variable!r}; expected one of {list(held)}.")
        return variable
    names = [name for name, dims in held.items() if len(dims) in (2, 3) and {"time", "depth"} & {*dims}]
    if not names:
        listed = ", ".join(f"{name} ({', '.join(map(str, dims))})" for name, dims in held.items()) or "no array"
        raise FormatError(
            f"{store} holds {listed}; expected an array (inline, crossline, time or depth) or (trace, time or depth). "
            "Rename its dimensions."
        )
    if len(names) > 1:
        raise FormatError(f"{store} holds the arrays {names}; expected one. Name it by variable (--variable).")
    return names[0]


# least sample interval of a time in ms
_FINEST_MS = 0.1


def _doubt_unit(cube: Any) -> str | None:
    """Say so where a time without a unit has steps that are hardly ms."""
    time = cube.coords.get("time")
    if time is None or time.size < 2 or "units" in time.attrs or "sample_unit" in cube.attrs:
        return None
    step = float(time[1] - time[0])
    if abs(step) >= _FINEST_MS:
        return None
    return (
        f"time has steps of {step:g} and no unit: taken as ms; if they are seconds, set its attribute units, or "
        "give interval and start in ms"
    )


# trace and file headers of an MDIO store: records, which no cube needs
_MDIO_RECORDS = ("headers", "raw_headers", "segy_file_header")


def _is_mdio(store: Path) -> bool:
    """Tell whether a Zarr group is an MDIO store of the first version."""
    import zarr

    group = zarr.open_group(str(store), mode="r")
    return "apiVersion" in group.attrs and "trace_mask" in group


def _mdio_coordinates(dataset: Any, cube: Any) -> dict[str, Any]:
    """Return the coordinates of a cube of an MDIO store that have another name, type or attribute of the unit there."""
    vertical = str(cube.dims[-1])
    axis = dataset[vertical]
    on_map = {name: cube[name] for name in ("cdp_x", "cdp_y") if name in cube.coords}
    return {
        vertical: (vertical, axis.values.astype(np.float64), _mdio_units(axis)),
        "live": (cube.dims[:-1], dataset["trace_mask"].values.astype(bool)),
        **{name: (values.dims, values.values, _mdio_units(values)) for name, values in on_map.items()},
    }


def _mdio_units(coordinate: Any) -> dict[str, str]:
    """Return the attribute ``units`` of a coordinate of an MDIO store, which names them by what they measure."""
    stated = coordinate.attrs.get("unitsV1") or {}
    unit = stated.get("length", stated.get("time"))
    return {} if unit is None else {"units": str(unit)}


@dataclass(frozen=True, slots=True, eq=False)
class _Guarded:
    """An array of a store, indexed as an array; what damaged bricks raise is turned into one clear line."""

    array: Any
    store: Path

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self.array.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(self.array.dtype)

    @property
    def ndim(self) -> int:
        return int(self.array.ndim)

    def __getitem__(self, key: Any) -> Any:
        with refuse_damage(self.store, "Zarr group whose bricks can be read"):
            return np.asarray(self.array.variable[key].values)


def _as_dask(cube: Any, store: Path) -> Any:
    """Return the samples, lazily, in the store's own bricks."""
    import dask.array as da

    chunks = cube.encoding.get("chunks") or "auto"
    guarded = _Guarded(cube, store)
    empty = np.empty((0,) * guarded.ndim, guarded.dtype)
    return da.from_array(guarded, chunks=chunks, name=f"zarr-{uuid4().hex}", lock=False, meta=empty)


def _stored_bytes(store: Path, enough: int) -> int:
    """Bytes of the store's files; counting stops where there are enough of them."""
    total = 0
    for path in store.rglob("*"):
        total += path.stat().st_size if path.is_file() else 0
        if total >= enough:
            break
    return total


def make_group(aside: Path, volume: Any, name: str, chunks: tuple[int, ...]) -> None:
    """Write everything but the samples and the coordinates that vary along the first axis; `chunks` are the bricks."""
    import dask.array as da
    import xarray as xr

    empty = xr.DataArray(
        da.zeros(volume.shape, chunks=chunks, dtype=volume.dtype), dims=volume.dims, attrs=volume.attrs
    )
    for key, coord in volume.coords.items():
        is_lateral = volume.dims[0] in coord.dims and key not in volume.dims
        data = da.zeros(coord.shape, chunks=chunks[: coord.ndim], dtype=coord.dtype) if is_lateral else coord.data
        empty = empty.assign_coords({key: (coord.dims, data, coord.attrs)})
    dataset = empty.to_dataset(name=name)
    encoding: dict[str, Any] = {name: {"chunks": chunks, "fill_value": None}}
    dataset.to_zarr(aside, mode="w", compute=False, consolidated=False, zarr_format=3, encoding=encoding)


def _write_slab(aside: Path, part: Any, name: str, first_dim: str, start: int) -> None:
    import zarr

    group: Any = zarr.open_group(aside, mode="r+")
    stop = start + part.shape[0]
    group[name][start:stop] = part.values
    for key, coord in part.coords.items():
        if first_dim in coord.dims and key not in part.dims:
            group[str(key)][start:stop] = coord.values
