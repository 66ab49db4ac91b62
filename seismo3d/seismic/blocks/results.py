"""The volumes that a run in blocks gives: Zarr groups with the cube's coordinates, written block by block."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.io._files import refuse_os_errors, written_aside
from seismo3d.io.zarr_store import make_group, read_zarr
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.run import BlockRun

_KINDS = {"likelihood": np.float32, "labels": np.int32, "throw": np.float32, "layer_time": np.float32}
_DEPTH = 128


def make_result(run: BlockRun, name: str, cube: Any) -> None:
    """Make a volume's group, with the cube's coordinates and no sample yet."""
    import dask.array as da
    import xarray as xr
    import zarr

    from seismo3d.io._as_cube import as_cube

    folder = run.folder / f"{name}.zarr"
    if (folder / "zarr.json").is_file():
        return
    brick, shape = run.plan.brick, run.plan.shape
    chunks = (min(brick, shape[0]), min(brick, shape[1]), min(_DEPTH, shape[2]))
    like = as_cube(cube)
    values = xr.DataArray(
        da.zeros(shape, chunks=chunks, dtype=_KINDS[name]), dims=like.dims, coords=like.coords, name=name,
        attrs=like.attrs,
    )  # fmt: skip
    with refuse_os_errors(folder, "write"), written_aside(folder, folder=True) as aside:
        make_group(aside, values, name, chunks)
        group: Any = zarr.open_group(str(aside), mode="r+")
        for key, coordinate in like.coords.items():
            if like.dims[0] in coordinate.dims and key not in like.dims:
                group[str(key)][...] = coordinate.values


def write_result(run: BlockRun, name: str, box: Box, values: AnyArray) -> None:
    """Write a block of a volume."""
    import zarr

    folder = run.folder / f"{name}.zarr"
    with refuse_os_errors(folder, "write"):
        group: Any = zarr.open_group(str(folder), mode="r+")
        group[name][box.i0 : box.i1, box.j0 : box.j1] = values


def open_result(run: BlockRun, name: str, cube: Any) -> Any:
    """Return a finished volume, lazy: a DataArray with the cube's coordinates where the cube is one."""
    store = run.folder / f"{name}.zarr"
    found = read_zarr(store, lazy_above=-1)
    if not hasattr(cube, "dims"):
        return found.data
    made = cube.copy(data=found.data).rename(name)
    # so that saving the faults in this folder leaves the store as it is
    made.encoding["source"] = str(store.resolve())
    return made
