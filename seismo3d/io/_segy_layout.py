"""The layout of a SEG-Y file: what its textual and binary headers say, checked against the file's size.

Byte numbers count from 1 as in the SEG-Y standard: 3201 to 3600 in the binary header, 1 to 240 in a trace header.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from seismo3d._typing import AnyArray, IntArray
from seismo3d.errors import FormatError
from seismo3d.io._files import as_readable_file, refuse_os_errors

SAMPLE_FORMATS: dict[int, tuple[str, str]] = {
    1: (">u4", "IBM float, 4 bytes"),
    2: (">i4", "integer, 4 bytes"),
    3: (">i2", "integer, 2 bytes"),
    5: (">f4", "IEEE float, 4 bytes"),
    6: (">f8", "IEEE float, 8 bytes"),
    8: ("i1", "integer, 1 byte"),
    10: (">u4", "unsigned integer, 4 bytes"),
    11: (">u2", "unsigned integer, 2 bytes"),
    16: ("u1", "unsigned integer, 1 byte"),
}
"""Sample format code -> (type as stored in a big-endian file, words)."""

_SHORT_FIELDS = frozenset([29, 31, 33, 35, 69, 71, *range(89, 180, 2), 215])
_HEADER = 240


@dataclass(frozen=True, slots=True)
class SegyLayout:
    """Where the traces of a SEG-Y file are, and how their samples are stored.

    Attributes
    ----------
    path : str
        The file.
    format_code, little_endian : int, bool
        Sample format code of the standard, and the order of bytes.
    n_samples, n_traces : int
        Samples a trace, traces in the file.
    interval_us : int
        Sample interval of the binary header: microseconds, or millimetres where the file is in depth; may be 0.
    data_offset : int
        Position of the first trace header: 3600, and the extended textual headers.
    text : str
        The textual header, 40 lines.
    in_feet : bool
        Whether the binary header says that lengths are in feet.
    """

    path: str
    format_code: int
    little_endian: bool
    n_samples: int
    n_traces: int
    interval_us: int
    data_offset: int
    text: str
    in_feet: bool = False

    @property
    def length_unit(self) -> str:
        """Unit of lengths: "m" or "ft"."""
        return "ft" if self.in_feet else "m"

    @property
    def stored_dtype(self) -> np.dtype[Any]:
        """Type of a stored sample, in the file's order of bytes (IBM floats as unsigned integers)."""
        dtype = np.dtype(SAMPLE_FORMATS[self.format_code][0])
        return dtype.newbyteorder("<") if self.little_endian else dtype

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of an amplitude in memory: float32, or float64 where float32 would not hold every stored value."""
        return np.dtype(np.float64 if self.format_code in (2, 6, 10) else np.float32)

    @property
    def trace_bytes(self) -> int:
        """Size of a trace with its header."""
        return _HEADER + self.n_samples * self.stored_dtype.itemsize

    @property
    def format_words(self) -> str:
        """The sample format in words."""
        order = "little-endian" if self.little_endian else "big-endian"
        return f"{SAMPLE_FORMATS[self.format_code][1]}, {order}"

    def map_traces(self) -> AnyArray:
        """Map the file into memory as records with fields ``head`` (240 bytes) and ``data`` (n_samples)."""
        record = np.dtype([("head", np.uint8, _HEADER), ("data", self.stored_dtype, (self.n_samples,))])
        with refuse_os_errors(Path(self.path), "read"):
            return np.memmap(self.path, dtype=record, mode="r", offset=self.data_offset, shape=(self.n_traces,))


def read_layout(path: Any) -> SegyLayout:
    """Read the textual and binary headers and check them against the file's size.

    Raises
    ------
    FileAccessError
        If the file cannot be read.
    FormatError
        If it is not SEG-Y, is cut short, or its headers hold values that cannot be.
    """
    file = as_readable_file(path)
    with refuse_os_errors(file, "read"), file.open("rb") as stream:
        head = stream.read(3600)
        size = file.stat().st_size
    if size == 0:
        raise FormatError(f"{file} is empty (zero bytes); expected a SEG-Y file. Copy it again.")
    if len(head) < 3600:
        raise FormatError(f"{file} has {size} bytes; a SEG-Y file has at least 3600. It is cut short, or not SEG-Y.")
    code, little = _sample_format(head, file)
    order: Literal["little", "big"] = "little" if little else "big"
    interval, n_samples = (int.from_bytes(head[k - 1 : k + 1], order, signed=True) for k in (3217, 3221))
    if interval < 0:
        raise FormatError(
            f"{file} has a sample interval of {interval} in its binary header (bytes 3217-3218); expected 0 to 32767."
        )
    if n_samples == 0:
        raise FormatError(f"{file} has 0 samples a trace in its binary header (bytes 3221-3222); expected at least 1.")
    n_samples %= 65536
    offset = _data_offset(file, head, order, size)
    trace_bytes = _HEADER + n_samples * np.dtype(SAMPLE_FORMATS[code][0]).itemsize
    n_traces, left = divmod(size - offset, trace_bytes)
    if n_traces == 0 or left:
        raise FormatError(
            f"{file} has {size} bytes: {n_traces} traces of {n_samples} samples, as its header says, and {left} bytes "
            "over; expected whole traces. It is cut short, or its headers are wrong."
        )
    in_feet = int.from_bytes(head[3254:3256], order) == 2
    text = _decode_text(head[:3200])
    return SegyLayout(str(file), code, little, n_samples, n_traces, interval, offset, text, in_feet)


def read_fields(layout: SegyLayout, rows: Any, byte_numbers: list[int]) -> dict[int, IntArray]:
    """Read fields of trace headers.

    Parameters
    ----------
    layout : SegyLayout
        The file.
    rows : slice or array of int
        The traces.
    byte_numbers : list of int
        First bytes of the fields, 1 to 237.

    Returns
    -------
    dict
        Byte number -> int64 values, one a trace.
    """
    traces = layout.map_traces()
    index = np.arange(*rows.indices(layout.n_traces)) if isinstance(rows, slice) else np.asarray(rows)
    out: dict[int, IntArray] = {byte: np.empty(index.size, dtype=np.int64) for byte in byte_numbers}
    block = 65536
    for start in range(0, index.size, block):
        part = index[start : start + block]
        contiguous = part.size and part[-1] - part[0] == part.size - 1 and bool((np.diff(part) == 1).all())
        heads = traces["head"][part[0] : part[-1] + 1] if contiguous else traces["head"][part]
        for byte, values in out.items():
            values[start : start + block] = header_field(heads, byte, little_endian=layout.little_endian)
    return out


def header_field(heads: AnyArray, byte: int, *, little_endian: bool) -> IntArray:
    """Decode one field of trace headers, an array of shape (n, 240) of bytes, to int64."""
    width = 2 if byte in _SHORT_FIELDS else 4
    raw = np.ascontiguousarray(heads[:, byte - 1 : byte - 1 + width])
    return raw.view(f"{'<' if little_endian else '>'}i{width}")[:, 0].astype(np.int64)


def set_header_field(heads: AnyArray, byte: int, values: Any, *, little_endian: bool) -> None:
    """Write one field of trace headers, an array of shape (n, 240) of bytes, in place."""
    width = 2 if byte in _SHORT_FIELDS else 4
    encoded = np.broadcast_to(np.rint(values), (len(heads),)).astype(np.int64)
    raw = np.ascontiguousarray(encoded.astype(f"{'<' if little_endian else '>'}i{width}"))
    heads[:, byte - 1 : byte - 1 + width] = raw.view(np.uint8).reshape(len(heads), width)


def _sample_format(head: bytes, file: Path) -> tuple[int, bool]:
    big, small = int.from_bytes(head[3224:3226], "big"), int.from_bytes(head[3224:3226], "little")
    for code, little in ((big, False), (small, True)):
        if code in SAMPLE_FORMATS:
            return code, little
    known = ", ".join(str(code) for code in SAMPLE_FORMATS)
    printable = sum(32 <= b < 127 or b in (9, 10, 13) for b in head) / len(head)
    kind = " It looks like a text file." if printable > 0.95 else ""
    raise FormatError(
        f"{file} is not SEG-Y that can be read: its sample format code is {big}; expected one of {known}.{kind}"
    )


def _data_offset(file: Path, head: bytes, order: Literal["little", "big"], size: int) -> int:
    n_extended = int.from_bytes(head[3504:3506], order, signed=True)
    offset = 3600 + 3200 * n_extended if n_extended >= 0 else _end_of_extended_text(file, size)
    if offset >= size:
        raise FormatError(
            f"{file} has {size} bytes, and its header announces {n_extended} extended textual headers (bytes 3505-6); "
            "expected traces behind them. It is cut short, or holds no trace."
        )
    return offset


def _end_of_extended_text(file: Path, size: int) -> int:
    """Find the end of an unannounced number of extended textual headers by its end mark."""
    with file.open("rb") as stream:
        stream.seek(3600)
        for offset in range(3600, min(size, 3600 + 3200 * 1000), 3200):
            if "((SEG:ENDTEXT))" in _decode_text(stream.read(3200)).upper().replace(" ", ""):
                return offset + 3200
    raise FormatError(
        f"{file} announces extended textual headers of unknown number, and none has the end mark ((SEG: EndText))."
    )


def _decode_text(raw: bytes) -> str:
    # spaces are by far the commonest character: 0x40 in EBCDIC, 0x20 in ASCII
    text = raw.decode("cp037" if raw.count(0x40) > raw.count(0x20) else "latin-1")
    lines = (text[k : k + 80].rstrip() for k in range(0, len(text), 80))
    return "\n".join("".join(c if c.isprintable() else " " for c in line) for line in lines)
