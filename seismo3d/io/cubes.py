"""Open and convert cubes and sections, whatever the format of the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import AnyArray, Progress
from seismo3d._validate import as_flag, as_number, is_among, told
from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.geometry.axis import USUAL_UNITS, length_unit_of, unit_of
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.io._as_cube import as_cube
from seismo3d.io._files import as_path, refuse_os_errors, refuse_rival, written_aside
from seismo3d.io.numpy_files import list_npz, read_npy, read_npz

__all__ = ["as_cube", "convert_cube", "open_cube", "write_npy"]

LAZY_ABOVE = 2 * 2**30
"""Size in memory, in bytes, above which a cube is opened lazily."""

_SEGY_SUFFIXES = (".sgy", ".segy", ".seg")


def open_cube(
    path: Any,
    *,
    inline_byte: int | None = None,
    crossline_byte: int | None = None,
    x_byte: int | None = None,
    y_byte: int | None = None,
    domain: str | None = None,
    interval: float | None = None,
    start: float | None = None,
    lazy: bool | None = None,
    scan: str = "auto",
    variable: str | None = None,
) -> Any:
    r"""Open a cube or a 2D line: SEG-Y, Zarr, NPY or NPZ.

    Parameters
    ----------
    path : path
        A SEG-Y file (any suffix), a Zarr folder, an MDIO store (version 1), ``.npy`` or ``.npz``.
    inline_byte, crossline_byte : int, optional
        SEG-Y trace header bytes, from 1, of the line numbers. Without them 189 and 193, and where those hold no
        geometry, the first pair that does (9 and 21, 17 and 21, ...); the attribute ``header_bytes`` says which.
    x_byte, y_byte : int, optional
        Header bytes of the map coordinates; without them 181 and 185, else 73 and 77, else 81 and 85.
    domain : {"time", "depth"}, optional
        What the samples run along; judged from the textual header, the interval and the file's name where it is not
        given, and ``domain_reason`` says why.
    interval, start : float, optional
        Sample interval and first sample in ms, m or ft (a depth of a file in feet), in place of the headers' or a
        store's. A start is taken for all traces, whatever their headers say.
    lazy : bool, optional
        True: backed by dask, in chunks of whole inlines, read when asked for. False: in memory. Without it, lazy
        above 2 GiB. Values are identical.
    scan : {"auto", "full"}
        Whether to read every trace header of a large SEG-Y file. "auto" derives the geometry of a regular file from a
        few hundred headers, and compares the headers of every trace as it is read.
    variable : str, optional
        The array to take from a Zarr group or an NPZ file with several. Axes of a Zarr group named iline, xline and
        twt, as segysak does, are taken for inline, crossline and time.

    Returns
    -------
    xarray.DataArray
        Dims (inline, crossline, time or depth); a 2D line (trace, time or depth). Float32, or float64 where that is
        needed to hold every value; missing traces NaN. Coordinates: line numbers, time in ms or depth in m, ``live``
        (False on missing and on all-zero traces) and, where the file has them, ``cdp_x`` and ``cdp_y`` in metres, NaN
        on traces whose headers leave both 0; depth and map in feet where the file says so, as ``units`` of each then
        do. Attributes: plain values that say where it came from, what was found, and ``survey``, the geometry.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    FormatError
        If it is cut short, not what its name says, not stacked, or its traces start a sample or more apart.
    ParameterError
        If an option has a value that cannot be, or does not serve files of this kind, such as header bytes for Zarr.
    """
    if not is_among(scan, ("auto", "full")):
        raise ParameterError(f"scan is {told(scan)}; expected 'auto' or 'full'.")
    file = as_path(path)
    limit = LAZY_ABOVE if lazy is None else (-1 if as_flag(lazy, "lazy") else 2**63)
    with refuse_os_errors(file, "read"):
        is_zarr = is_zarr_store(file)
    is_numpy = file.suffix.lower() in (".npy", ".npz")
    if is_zarr or is_numpy:
        asked = {"inline_byte": inline_byte, "crossline_byte": crossline_byte, "x_byte": x_byte, "y_byte": y_byte}
        refuse_unused(asked, file, "SEG-Y trace headers")
    if variable is not None and not is_zarr and file.suffix.lower() != ".npz":
        refuse_unused({"variable": variable}, file, "Zarr groups and NPZ files")
    if is_zarr:
        from seismo3d.io.zarr_store import read_zarr

        stored = read_zarr(file, variable=variable, lazy_above=limit)
        return _on_axis(stored, domain=domain, interval=interval, start=start)
    if is_numpy:
        return _read_numpy(file, domain=domain, interval=interval, start=start, variable=variable, lazy_above=limit)
    from seismo3d.io.segy import read_segy

    return read_segy(
        file,
        inline_byte=inline_byte,
        crossline_byte=crossline_byte,
        x_byte=x_byte,
        y_byte=y_byte,
        domain=domain,
        interval=interval,
        start=start,
        lazy_above=limit,
        scan=scan,
    )


def refuse_unused(given: dict[str, Any], file: Path, served: str) -> None:
    """Refuse options that do not serve files of this kind; those that are None were not given."""
    for name, value in given.items():
        if value is not None:
            raise ParameterError(f"{name} is {value!r}; expected none for {file}: it serves {served}. Leave it out.")


def _on_axis(cube: Any, *, domain: str | None, interval: float | None, start: float | None) -> Any:
    """Return a stored cube with another sample axis: what the caller gives wins."""
    if domain not in (None, *USUAL_UNITS):
        raise ParameterError(f"domain is {told(domain)}; expected 'time' or 'depth'.")
    held, unit = str(cube.dims[-1]), unit_of(cube)
    name = domain or held
    if name == held and interval is None and start is None:
        return cube
    values: AnyArray = np.asarray(cube[held].values, dtype=np.float64)
    first = values[0] if start is None else as_number(start, "start")
    if interval is None:
        values = values - values[0] + first
    else:
        values = first + as_number(interval, "interval", low=0, strict=True) * np.arange(values.size)
    if (name != held and unit != "samples") or (interval is not None and unit == "samples"):
        unit = length_unit_of(cube) if name == "depth" else USUAL_UNITS[name]
    named = cube if name == held else cube.rename({held: name})
    made = named.assign_coords({name: (name, values, {"units": unit})}).assign_attrs(sample_unit=unit)
    if domain is not None:
        made = made.assign_attrs(domain_reason="as given")
    return made.assign_attrs(survey=SurveyGeometry.from_cube(made).to_dict()) if "survey" in cube.attrs else made


def convert_cube(
    source: Any,
    target: Any,
    *,
    overwrite: bool = False,
    every: int = 1,
    progress: Progress | None = None,
    **options: Any,
) -> Path:
    """Convert between SEG-Y, Zarr and NPY, a block of inlines at a time.

    Parameters
    ----------
    source, target : path
        The target's suffix tells its format: ``.sgy`` or ``.segy``, ``.zarr``, ``.npy``.
    overwrite : bool
        Whether a target that is there may be replaced; the source never is.
    every : int
        Every how many samples of the traces are kept, where they are denser than reflections need.
    progress : callable, optional
        Called with "write" and the share done.
    **options
        Given to :func:`open_cube`.

    Returns
    -------
    Path
        The target.

    Raises
    ------
    ParameterError
        If `every` is less than 1, leaves no two samples or an interval too long for SEG-Y, the target's suffix is
        another, or the target is the source, holds it or lies in it, or is SEG-Y and neither the source nor the options
        tell the sample interval.
    FileAccessError
        If the target is there and is not to be replaced, another process is writing it, or a file cannot be read or
        written.
    """
    out = Path(target)
    suffix = out.suffix.lower()
    if suffix not in (*_SEGY_SUFFIXES, ".zarr", ".npy"):
        raise ParameterError(
            f"{out} has the suffix {suffix!r}; expected .sgy, .segy, .zarr or .npy, which tells the format."
        )
    _check_apart(Path(source), out)
    _check_free(out, overwrite=overwrite)
    cube = open_cube(source, **({"lazy": True} | options))
    if suffix in _SEGY_SUFFIXES and unit_of(cube) == "samples":
        raise ParameterError(
            f"{source} states no sample interval; expected one, which SEG-Y needs. Give interval (--interval) and "
            "start (--start) in ms, or in m with domain (--domain) depth."
        )
    _check_every(every, cube, is_segy=suffix in _SEGY_SUFFIXES)
    cube = cube[..., ::every]
    refuse_rival(out, folder=suffix == ".zarr")
    _check_free(out, overwrite=overwrite)  # opening takes its time
    if suffix == ".zarr":
        from seismo3d.io.zarr_store import write_zarr

        return write_zarr(out, cube, progress=progress)
    if suffix == ".npy":
        return write_npy(out, cube, progress=progress)
    from seismo3d.io.segy import write_segy

    return write_segy(out, cube, progress=progress)


def _check_every(every: int, cube: Any, *, is_segy: bool) -> None:
    """Refuse to thin traces to less than two samples, or to an interval that SEG-Y cannot hold."""
    n = cube.shape[-1]
    most, why = max(1, n - 1), f"for traces of {n}"
    if is_segy and n > 1:
        from seismo3d.io._segy_encode import LONGEST_INTERVAL

        step = abs(float(cube[cube.dims[-1]][1] - cube[cube.dims[-1]][0]))
        if most * step > LONGEST_INTERVAL:
            most = max(1, int(LONGEST_INTERVAL / step))
            why = f"for SEG-Y holds intervals of at most {LONGEST_INTERVAL} and samples are {step:g} apart"
    if not 1 <= every <= most:
        raise ParameterError(f"every is {every}; expected 1 to {most}, {why}.")


def _check_free(out: Path, *, overwrite: bool) -> None:
    if out.exists() and not overwrite:
        raise FileAccessError(f"{out} exists already. Choose another name, or overwrite it (--overwrite).")


def _check_apart(source: Path, out: Path) -> None:
    """Refuse a target that is the source, holds it, or lies in it."""
    if out.exists() and source.exists() and out.samefile(source):
        raise ParameterError(f"{out} is the input too; expected another name for the result.")
    read, made = source.resolve(), out.resolve()
    if made in read.parents or read in made.parents:
        raise ParameterError(f"{out} and the input {source} lie in each other; expected a place of its own.")


def write_npy(path: Any, cube: Any, *, progress: Progress | None = None) -> Path:
    """Write the samples alone as NPY, a block of inlines at a time; NPY has no room for geometry."""
    volume = as_cube(cube)
    out = as_path(path)
    report = as_progress(progress)
    block = max(1, 64 * 2**20 // max(1, int(np.prod(volume.shape[1:], dtype=np.int64)) * volume.dtype.itemsize))
    with written_aside(out) as aside, aside.open("wb") as stream:
        header = {"descr": np.lib.format.dtype_to_descr(volume.dtype), "fortran_order": False, "shape": volume.shape}
        np.lib.format.write_array_header_1_0(stream, header)
        for first in range(0, volume.shape[0], block):
            stream.write(np.ascontiguousarray(volume[first : first + block].data).tobytes())
            report("write", min(1.0, (first + block) / volume.shape[0]))
    return out


def is_zarr_store(path: Path) -> bool:
    """Return whether a path is, or is named as, a Zarr store."""
    return path.suffix.lower() == ".zarr" or any(
        (path / name).is_file() for name in ("zarr.json", ".zgroup", ".zattrs", ".zmetadata")
    )


def _read_numpy(
    file: Path,
    *,
    domain: str | None,
    interval: float | None,
    start: float | None,
    variable: str | None,
    lazy_above: int,
) -> Any:
    array = read_npy(file, mapped=True) if file.suffix.lower() == ".npy" else _from_npz(file, variable)
    data: Any = array
    if array.nbytes > lazy_above:
        import dask.array as da

        inline_bytes = max(1, array[:1].nbytes)
        chunks = (max(1, 32 * 2**20 // inline_bytes), *array.shape[1:])
        data = da.from_array(array, chunks=chunks, name=f"npy-{uuid4().hex}", lock=False)
    else:
        data = np.array(array)
    first = 0.0 if start is None else as_number(start, "start")
    cube = as_cube(data, domain="time" if domain is None else domain, interval=interval, start=first, name=str(file))
    return cube.assign_attrs(path=str(file), file_format=file.suffix[1:].upper())


def _from_npz(file: Path, variable: str | None) -> Any:
    entries = list_npz(file)
    if variable is not None:
        if variable not in entries:
            raise ParameterError(f"{file} has no array {variable!r}; expected one of {list(entries)}.")
        return read_npz(file, [variable])[variable]
    found = [name for name, entry in entries.items() if entry.ndim in (2, 3) and entry.dtype.kind in "fiu"]
    cubes = [name for name in found if entries[name].ndim == 3] or found
    if len(cubes) != 1:
        raise FormatError(
            f"{file} has {len(cubes)} arrays that could be the cube: {cubes}; expected one. Name it by "
            "variable (--variable)."
        )
    return read_npz(file, cubes)[cubes[0]]
