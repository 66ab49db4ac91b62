"""SEG-Y in and out: cubes and lines as DataArrays, results on the input's own geometry and headers."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from seismo3d.geometry.map_fit import OFF_BINS
from seismo3d.geometry.survey import MapFit, SurveyGeometry, fit_map
from seismo3d.io._segy_axis import SampleAxis, refuse_other_starts, sample_axis
from seismo3d.io._segy_find import Found, find_coordinates, find_grid
from seismo3d.io._segy_layout import SegyLayout, read_fields, read_layout
from seismo3d.io._segy_samples import SegyCube, SegyHeaders, read_places
from seismo3d.io._segy_write import check_segy, write_segy

__all__ = ["check_segy", "read_segy", "write_segy"]

_CHUNK_BYTES = 32 * 2**20
# traces up to which every header is read, lazy or not
_SCANNED_BELOW = 100_000
_N_UNITS = 64
# what trace headers may say that coordinates are in, and the number that stands for a full turn
_ANGLES = {2: ("seconds of arc", 1_296_000), 3: ("degrees", 360), 4: ("degrees, minutes and seconds", 3_600_000)}


def read_segy(
    path: Any,
    *,
    inline_byte: int | None = None,
    crossline_byte: int | None = None,
    x_byte: int | None = None,
    y_byte: int | None = None,
    domain: str | None = None,
    interval: float | None = None,
    start: float | None = None,
    lazy_above: int = 2 * 2**30,
    scan: str = "auto",
) -> Any:
    """Open a SEG-Y file; see :func:`seismo3d.open_cube` for the parameters and what comes back."""
    layout = read_layout(path)
    size = layout.n_traces * layout.n_samples * layout.dtype.itemsize
    is_lazy = size > lazy_above
    scan_all = scan == "full" or not is_lazy or layout.n_traces <= _SCANNED_BELOW
    found = find_grid(layout, inline_byte=inline_byte, crossline_byte=crossline_byte, scan_all=scan_all)
    xy_bytes = find_coordinates(layout, x_byte=x_byte, y_byte=y_byte)
    axis = sample_axis(layout, domain=domain, interval=interval, start=start)
    if start is None:
        refuse_other_starts(layout, axis.axis)
    if found.is_line:
        return _read_line(layout, found, axis, xy_bytes, is_lazy=is_lazy)
    return _read_cube(layout, found, axis, xy_bytes, lazy_above=lazy_above)


def _read_cube(
    layout: SegyLayout, found: Found, axis: SampleAxis, xy_bytes: tuple[int, int] | None, *, lazy_above: int
) -> Any:
    import xarray as xr

    grid = found.grid
    source = SegyCube(layout, grid, check=found.is_sampled)
    # missing traces make the cube larger than its file
    is_lazy = int(np.prod(source.shape, dtype=np.int64)) * source.dtype.itemsize > lazy_above
    data = _as_dask(source) if is_lazy else source[:]
    coords: dict[str, Any] = {
        "inline": grid.inline.coordinates().astype(np.int64),
        "crossline": grid.crossline.coordinates().astype(np.int64),
        axis.domain: (axis.domain, axis.axis.coordinates(), {"units": axis.unit}),
        "live": (("inline", "crossline"), live_traces(data)),
    }
    if xy_bytes is not None:
        for column, name in enumerate(("cdp_x", "cdp_y")):
            header = SegyHeaders(layout, grid, xy_bytes, column)
            places = _as_dask(header) if is_lazy else header[:]
            coords[name] = (("inline", "crossline"), places, {"units": layout.length_unit})
    attrs = _attributes(layout, found, axis, xy_bytes)
    map_fit, notes = _fit_map(layout, found, xy_bytes)
    attrs["notes"] += notes
    survey = SurveyGeometry(grid.inline, grid.crossline, axis.axis, axis.unit, map_fit, layout.length_unit)
    attrs["survey"] = survey.to_dict()
    return xr.DataArray(data, dims=("inline", "crossline", axis.domain), coords=coords, name="amplitude", attrs=attrs)


def _read_line(
    layout: SegyLayout, found: Found, axis: SampleAxis, xy_bytes: tuple[int, int] | None, *, is_lazy: bool
) -> Any:
    import xarray as xr

    source = SegyCube(layout, found.grid)
    data = _as_dask(source)[:, 0] if is_lazy else source[:, 0]
    coords: dict[str, Any] = {
        "trace": np.arange(layout.n_traces, dtype=np.int64),
        axis.domain: (axis.domain, axis.axis.coordinates(), {"units": axis.unit}),
        "live": ("trace", live_traces(data)),
    }
    attrs = _attributes(layout, found, axis, xy_bytes)
    rows = np.arange(layout.n_traces, dtype=np.int64)
    if found.line_bytes is not None:
        numbers = read_fields(layout, rows, list(found.line_bytes))
        for name, byte in zip(("inline", "crossline"), found.line_bytes):
            coords[name] = ("trace", numbers[byte])
    cdp = read_fields(layout, rows, [21])[21]
    if np.ptp(cdp) > 0:
        coords["cdp"] = ("trace", cdp)
    if xy_bytes is not None:
        for name, values in zip(("cdp_x", "cdp_y"), read_places(layout, rows, xy_bytes).T):
            coords[name] = ("trace", values, {"units": layout.length_unit})
    return xr.DataArray(data, dims=("trace", axis.domain), coords=coords, name="amplitude", attrs=attrs)


def live_traces(data: Any) -> Any:
    """Tell the live traces: those with a sample that is neither zero nor NaN. Lazy where the data are."""
    if not isinstance(data, np.ndarray):
        return ((data != 0) & (data == data)).any(axis=-1)  # NaN differs from itself
    live = np.empty(data.shape[:-1], dtype=bool)
    for k, line in enumerate(data):  # line by line: no temporary of the cube's size
        live[k] = ((line != 0) & (line == line)).any(axis=-1)
    return live


def _attributes(layout: SegyLayout, found: Found, axis: SampleAxis, xy_bytes: tuple[int, int] | None) -> dict[str, Any]:
    grid = found.grid
    attrs: dict[str, Any] = {
        "path": layout.path,
        "segy_path": str(Path(layout.path).resolve()),
        "file_format": "SEG-Y",
        "sample_format": layout.format_words,
        "sample_format_code": layout.format_code,
        "little_endian": layout.little_endian,
        "sample_unit": axis.unit,
        "domain_reason": axis.reason,
        "header_bytes": found.how,
        "sorting": grid.sorting,
        "n_traces": layout.n_traces,
        "n_missing": grid.n_missing,
        "n_duplicates": grid.n_duplicates,
        "notes": [*found.notes, *axis.notes],
        "text_header": layout.text,
    }
    if found.line_bytes is not None:
        attrs["inline_byte"], attrs["crossline_byte"] = found.line_bytes
    if xy_bytes is not None:
        attrs["x_byte"], attrs["y_byte"] = xy_bytes
        attrs["notes"] += _angle_notes(layout, xy_bytes)
    if layout.in_feet:
        attrs["notes"].append("the binary header says feet: map coordinates, and depths, are in feet")
    if found.is_sampled:
        attrs["notes"].append(
            "a regular file: geometry read from a sample of the trace headers, checked as traces are read"
        )
    return attrs


def _angle_notes(layout: SegyLayout, xy_bytes: tuple[int, int]) -> list[str]:
    """Tell of angles that trace headers say their coordinates are in, be it so or not."""
    rows = np.unique(np.linspace(0, layout.n_traces - 1, min(layout.n_traces, _N_UNITS)).astype(np.int64))
    codes = [code for code in np.unique(read_fields(layout, rows, [89])[89]).tolist() if code in _ANGLES]
    largest = float(np.abs(read_places(layout, rows, xy_bytes)).max()) if codes else 0.0
    notes = []
    for unit, turn in (_ANGLES[code] for code in codes):
        said = f"trace headers say that coordinates are in {unit} (byte 89)"
        if largest > turn:
            notes.append(f"{said}, which {largest:.10g} cannot be: they are taken for lengths")
        else:
            told = "they are taken for lengths: strikes and distances on the map are wrong; project them to metres"
            notes.append(f"{said}: {told}")
    return notes


def _fit_map(layout: SegyLayout, found: Found, xy_bytes: tuple[int, int] | None) -> tuple[MapFit | None, list[str]]:
    """Fit the map from some thousand traces on evenly spread lines, both ends included; tell what does not fit it."""
    if xy_bytes is None:
        return None, []
    grid = found.grid
    i = np.unique(np.linspace(0, grid.inline.n - 1, min(grid.inline.n, 32)).astype(np.int64))
    j = np.unique(np.linspace(0, grid.crossline.n - 1, min(grid.crossline.n, 64)).astype(np.int64))
    rows = np.stack([grid.rows(slice(int(k), int(k) + 1))[0, j] for k in i])
    if found.grid.table is not None and (rows >= 0).sum() < 64:
        bins = np.flatnonzero(found.grid.table.ravel() >= 0)
        bins = bins[np.unique(np.linspace(0, bins.size - 1, min(bins.size, 2048)).astype(np.int64))]
        ij, rows = np.stack(np.divmod(bins, grid.crossline.n), axis=1), found.grid.table.ravel()[bins]
    else:
        ij = np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1).reshape(-1, 2)
        rows = rows.ravel()
    ij, rows = ij[rows >= 0], rows[rows >= 0]
    places = read_places(layout, rows, xy_bytes)
    fit = fit_map(ij, places) if rows.size else None
    if fit is None:
        return None, []
    most = OFF_BINS * fit.shorter_step
    n_off = int((fit.distances(ij, places) > most).sum())
    if fit.rms > most:
        told = (
            f"map coordinates lie {fit.rms:.3g} {layout.length_unit} (root mean square) off any map of evenly spaced "
            "lines, more than half a bin: strikes and places on the map are wrong where they are; check x_byte, y_byte "
            "and the scalar (trace header byte 71)"
        )
    else:
        told = f"map coordinates of {n_off} of {rows.size} traces looked at lie more than half a bin off the map"
    return fit, [told] if n_off else []


def _as_dask(source: SegyCube | SegyHeaders) -> Any:
    """Wrap a file's array: chunks of whole inlines, of about 32 MiB, each read by a handle of its own."""
    import dask.array as da

    inline_bytes = int(np.prod(source.shape[1:])) * source.dtype.itemsize
    n = max(1, min(source.shape[0], _CHUNK_BYTES // max(inline_bytes, 1)))
    empty = np.empty((0,) * source.ndim, source.dtype)
    chunks = (n, *source.shape[1:])
    # a name of its own: to hash a table of traces would take longer than to open the file
    return da.from_array(source, chunks=chunks, name=f"segy-{uuid4().hex}", lock=False, meta=empty)
