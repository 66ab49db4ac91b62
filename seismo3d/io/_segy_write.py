"""Write SEG-Y: on the geometry and headers of an existing file, or with headers made from the cube's coordinates."""

from __future__ import annotations

from pathlib import Path
from typing import IO, Any

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import AnyArray, Int64Array, Progress
from seismo3d._validate import as_kind, as_number, as_whole_number
from seismo3d.errors import FileAccessError, GeometryError, ParameterError, Seismo3dError
from seismo3d.geometry.survey import Axis
from seismo3d.io._as_cube import as_cube
from seismo3d.io._files import as_path, written_aside
from seismo3d.io._segy_axis import judge_domain, sample_axis
from seismo3d.io._segy_encode import check_fresh, encode, fresh_file_header, fresh_heads, sample_fields
from seismo3d.io._segy_find import find_grid
from seismo3d.io._segy_grid import TraceGrid, line_grid
from seismo3d.io._segy_layout import SegyLayout, read_layout, set_header_field

_BLOCK_BYTES = 64 * 2**20
# that 4-byte floats hold
_LARGEST = float(np.finfo(np.float32).max)


def write_segy(
    path: Any,
    cube: Any,
    *,
    like: Any = "input",
    sample_format: int = 5,
    fill: float = 0.0,
    title: str = "",
    progress: Progress | None = None,
) -> Path:
    """Write a cube or a section as SEG-Y, atomically: the file appears complete, or not at all.

    Parameters
    ----------
    path : path
        The file to write; one that is there is replaced.
    cube : DataArray or array
        Shape (inline, crossline, sample) or (trace, sample), in memory or lazy; lazy ones are computed a block of
        inlines at a time.
    like : path, "input" or None
        The SEG-Y file whose geometry is taken: its textual, binary and trace headers, its order of traces, its
        duplicates, and no trace where it has none. The cube may be a part of it. "input" is the SEG-Y file that the
        cube was opened from; for a cube from elsewhere None, except that one from a store takes the headers of the
        SEG-Y file it was converted from while that is there. None: headers are made from the cube's coordinates, and
        traces that are missing (all NaN and not live) are left out.
    sample_format : {5, 1}
        IEEE or IBM float, 4 bytes.
    fill : float
        Written for NaN and infinite samples; a finite number.
    title : str
        First line of a textual header that is made.
    progress : callable, optional
        Called with "write" and the share done.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    GeometryError
        If the cube's lines are not among those of ``like``, or SEG-Y cannot hold its axes or map coordinates.
    ParameterError
        If an option is of the wrong kind, or finite samples or `fill` are too large for 4-byte floats. Whole numbers
        that these round are warned of, and lines of samples that are all too small for them.
    FileAccessError
        If the file cannot be written, or the cube was opened from a SEG-Y file that is not there any more.
    """
    if as_whole_number(sample_format, "sample_format") not in (1, 5):
        raise ParameterError(f"sample_format is {sample_format}; expected 5 (IEEE float) or 1 (IBM float).")
    fill = as_number(fill, "fill", low=-_LARGEST, high=_LARGEST)
    as_kind(title, str, "title", remedy="Give text, or leave it out.")
    volume = as_cube(cube)
    out = as_path(path)
    template = _template(volume, cube, like)
    for other in (volume.attrs.get("path"), template.layout.path if template else None):
        if other and out.exists() and Path(other).exists() and out.samefile(other):
            raise ParameterError(
                f"{out} is the file that the cube was read from; expected another name for the result."
            )
    step = as_progress(progress)
    with written_aside(out) as aside, aside.open("wb") as stream:
        if template is not None:
            _write_like(stream, volume, template, sample_format, fill, step)
        else:
            _write_fresh(stream, volume, sample_format, fill, title, step)
    return out


def check_segy(cube: Any) -> None:
    """Refuse a cube that SEG-Y cannot hold, as :func:`write_segy` would, before there is work to lose.

    Raises
    ------
    GeometryError
        If its lines are not among those of the SEG-Y file it comes from, or SEG-Y has no place for its units, samples,
        line numbers or map coordinates.
    FileAccessError
        If it was opened from a SEG-Y file that is not there any more.
    """
    volume = as_cube(cube)
    template = _template(volume, cube, "input")
    if template is None:
        check_fresh(volume)
    elif not _has_axis(template.layout, volume):
        sample_fields(volume)


class _Template:
    """A SEG-Y file to take headers from, and where its lines are in the cube."""

    __slots__ = ("crosslines", "grid", "inlines", "layout")

    def __init__(self, layout: SegyLayout, grid: TraceGrid, inlines: Int64Array, crosslines: Int64Array) -> None:
        self.layout, self.grid = layout, grid
        self.inlines, self.crosslines = inlines, crosslines


def _template(volume: Any, given: Any, like: Any) -> _Template | None:
    """Open the file to take headers from, and match its lines with the cube's; None to make headers."""
    if like is None:
        return None
    if not (isinstance(like, str) and like == "input"):
        return _match(read_layout(like), volume, is_bare=not hasattr(given, "dims"))
    source = volume.attrs.get("segy_path")
    if source is None:
        return None
    # a store that was converted from SEG-Y stands on its own: it may outlive that file
    is_own = volume.attrs.get("file_format") == "SEG-Y"
    if is_own and not Path(source).is_file():
        raise FileAccessError(
            f"{source}, which the cube was opened from, is not there any more; its trace headers were to be taken. "
            "Put it back, give a file with the same lines as like=, or like=None to make headers from the coordinates."
        )
    try:
        return _match(read_layout(source), volume, is_bare=not hasattr(given, "dims"))
    except Seismo3dError:
        if is_own:
            raise
        return None


def _match(layout: SegyLayout, volume: Any, *, is_bare: bool) -> _Template:
    if volume.ndim == 2:
        grid = line_grid(layout)
        numbers = [volume["trace"].values]
    else:
        found = find_grid(
            layout, inline_byte=volume.attrs.get("inline_byte"), crossline_byte=volume.attrs.get("crossline_byte")
        )
        if found.is_line:
            raise GeometryError(
                f"{layout.path} is a 2D line; the cube has shape {volume.shape}. Give a file that holds a cube."
            )
        grid = found.grid
        numbers = [volume["inline"].values, volume["crossline"].values]
    axes = (grid.inline, grid.crossline)[: len(numbers)]
    if is_bare:
        if volume.shape[:-1] != tuple(axis.n for axis in axes):
            raise GeometryError(
                f"array has shape {volume.shape}; {layout.path} has {' x '.join(str(a.n) for a in axes)} lines."
            )
        places = [np.arange(axis.n) for axis in axes]
    else:
        places = [_places(axis, values, layout) for axis, values in zip(axes, numbers)]
    if len(places) == 1:
        places.append(np.zeros(1, dtype=np.int64))
    return _Template(layout, grid, places[0], places[1])


def _places(axis: Axis, numbers: AnyArray, layout: SegyLayout) -> Int64Array:
    """Index in the cube of each line of the file, -1 where the cube does not have it."""
    index = axis.index(np.asarray(numbers, dtype=np.float64))
    nearest = np.rint(index).astype(np.int64)
    if (
        (np.abs(index - nearest) > 1e-6).any()
        or nearest.min() < 0
        or nearest.max() >= axis.n
        or np.unique(nearest).size < nearest.size
    ):
        raise GeometryError(
            f"cube has lines {numbers[0]} to {numbers[-1]}, and not all are among the {axis.n} of {layout.path}, "
            f"{axis.first:.0f} to {axis.last:.0f}. Give the file it was made from, or like=None."
        )
    places = np.full(axis.n, -1, dtype=np.int64)
    places[nearest] = np.arange(nearest.size)
    return places


def _write_like(stream: IO[bytes], volume: Any, template: _Template, code: int, fill: float, step: Progress) -> None:
    layout, grid = template.layout, template.grid
    little = layout.little_endian
    n_samples = volume.shape[-1]
    record = np.dtype([("head", np.uint8, 240), ("data", np.dtype(f"{'<' if little else '>'}u4"), (n_samples,))])
    axis_fields = {} if _has_axis(layout, volume) else sample_fields(volume)
    stream.write(_patched_file_header(layout, volume, code, axis_fields.get(117)))
    ranks = _ranks(template)
    inlines = np.flatnonzero(template.inlines >= 0)
    line_bytes = record.itemsize * max(1, grid.crossline.n)
    block = max(1, _BLOCK_BYTES // line_bytes)
    for start in range(0, inlines.size, block):
        part = inlines[start : start + block]
        rows, i, j = grid.all_rows(int(part[0]), int(part[-1]) + 1)
        ci, cj = template.inlines[i], template.crosslines[j]
        keep = (ci >= 0) & (cj >= 0)
        rows, ci, cj = rows[keep], ci[keep], cj[keep]
        if rows.size == 0:
            continue
        low, high = int(ci.min()), int(ci.max()) + 1
        values = np.asarray(volume[low:high].data if volume.ndim == 3 else volume[low:high].data[:, None])
        records = np.empty(rows.size, dtype=record)
        # mapped anew for each block, so that memory stays bounded
        records["head"] = layout.map_traces()["head"][rows]
        records["data"] = encode(values[ci - low, cj], code, fill)
        for byte, value in axis_fields.items():
            set_header_field(records["head"], byte, value, little_endian=little)
        places = rows if ranks is None else np.searchsorted(ranks, rows)
        _write_runs(stream, records, places, layout.data_offset)
        step("write", min(1.0, (start + part.size) / inlines.size))


def _has_axis(layout: SegyLayout, volume: Any) -> bool:
    """Whether a file's headers already mean the cube's sample axis: then they stay as they are."""
    own = sample_axis(layout, domain="time").axis
    axis = Axis.from_coordinates(volume[volume.dims[-1]].values, str(volume.dims[-1]))
    tolerance = 1e-4 * own.step
    # one sample tells no interval
    is_step = own.n == 1 or abs(own.step - axis.step) < tolerance / own.n
    return own.n == axis.n and abs(own.first - axis.first) < tolerance and is_step


def _patched_file_header(layout: SegyLayout, volume: Any, code: int, interval_us: int | None) -> bytes:
    n_samples = volume.shape[-1]
    with Path(layout.path).open("rb") as source:
        head = bytearray(source.read(layout.data_offset))
    order = "<" if layout.little_endian else ">"
    fields = {3221: n_samples, 3225: code} | ({} if interval_us is None else {3217: interval_us})
    for byte, value in fields.items():
        head[byte - 1 : byte + 1] = np.array([value % 65536], dtype=f"{order}u2").tobytes()
    domain = str(volume.dims[-1])
    step = float(volume[domain][1] - volume[domain][0]) if n_samples > 1 else 1.0
    if judge_domain(layout, step, by_name=False)[0] != domain:
        _state_domain(head, domain)
    return bytes(head)


def _state_domain(head: bytearray, domain: str) -> None:
    """Say time or depth on the last free line of the textual header: nothing else in the file would tell."""
    is_ebcdic = head[:3200].count(0x40) > head[:3200].count(0x20)
    encoding = "cp037" if is_ebcdic else "latin-1"
    for line in reversed(range(40)):
        text = bytes(head[80 * line : 80 * line + 80]).decode(encoding)
        if not text[3:].strip("\0 "):
            head[80 * line : 80 * line + 80] = f"C{line + 1:2d} Domain: {domain}".ljust(80).encode(encoding)
            return


def _ranks(template: _Template) -> Int64Array | None:
    """Traces of the file that are written, sorted; None where all are."""
    grid = template.grid
    is_whole = bool((template.inlines >= 0).all() and (template.crosslines >= 0).all())
    if is_whole and not grid.n_unplaced:
        return None
    rows, i, j = grid.all_rows(0, grid.inline.n)
    return np.sort(rows[(template.inlines[i] >= 0) & (template.crosslines[j] >= 0)])


def _write_runs(stream: IO[bytes], records: AnyArray, places: Int64Array, offset: int) -> None:
    """Write records at their places in the file, neighbours together."""
    breaks = np.flatnonzero(np.diff(places) != 1) + 1
    for run in np.split(np.arange(places.size), breaks):
        stream.seek(offset + int(places[run[0]]) * records.dtype.itemsize)
        stream.write(records[run[0] : run[-1] + 1].tobytes())


def _write_fresh(stream: IO[bytes], volume: Any, code: int, fill: float, title: str, step: Progress) -> None:
    n_samples = volume.shape[-1]
    record = np.dtype([("head", np.uint8, 240), ("data", ">u4", (n_samples,))])
    factor = check_fresh(volume)
    stream.write(fresh_file_header(volume, code, title))
    lines = int(np.prod(volume.shape[1:-1], dtype=np.int64)) * record.itemsize
    block = max(1, _BLOCK_BYTES // max(lines, 1))
    n_written = 0
    for start in range(0, volume.shape[0], block):
        part = volume[start : start + block].compute()
        values = part.values.reshape(-1, n_samples)
        missing = ~np.isfinite(values).any(axis=1)
        if "live" in part.coords:
            missing &= ~part["live"].values.ravel()
        keep = np.flatnonzero(~missing)
        records = np.empty(keep.size, dtype=record)
        records["head"] = fresh_heads(part, keep, n_written, factor=factor)
        records["data"] = encode(values[keep], code, fill)
        stream.write(records.tobytes())
        n_written += keep.size
        step("write", min(1.0, (start + block) / volume.shape[0]))
    if n_written == 0:
        raise GeometryError("cube has no trace with data: every sample is NaN. There is nothing to write.")
