"""SEG-Y files of every kind, made byte by byte: what the reader must cope with, independent of what writes SEG-Y."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

STORED = {1: "u4", 2: "i4", 3: "i2", 5: "f4", 6: "f8", 8: "i1", 10: "u4", 11: "u2", 16: "u1"}
SHORT = {29, 31, 33, 35, 69, 71, 89, 109, 115, 117, 215}


def field(buffer: bytearray, byte: int, value: int, *, width: int, order: str) -> None:
    buffer[byte - 1 : byte - 1 + width] = int(value).to_bytes(
        width, "little" if order == "<" else "big", signed=value < 0
    )


def file_header(
    n_samples: int, *, code: int = 5, interval: int = 4000, order: str = ">", text: str = "", **binary: int
) -> bytes:
    head = bytearray(text.ljust(3200)[:3200].encode("cp037") + bytes(400))
    for byte, value in {3217: interval, 3221: n_samples, 3225: code, 3501: 0x0100, 3503: 1}.items():
        field(head, byte, value, width=2, order=order)
    for name, value in binary.items():
        field(head, int(name[1:]), value, width=2, order=order)
    return bytes(head)


def trace_header(fields: dict[int, int], order: str = ">") -> bytes:
    head = bytearray(240)
    for byte, value in fields.items():
        field(head, byte, value, width=2 if byte in SHORT else 4, order=order)
    return bytes(head)


def write_raw(
    path: Path,
    traces: Any,
    headers: list[dict[int, int]],
    *,
    code: int = 5,
    order: str = ">",
    **head: Any,
) -> Path:
    """Write traces, an array (n, n_samples) of stored values, under headers given as byte number -> value."""
    stored = np.asarray(traces).astype(STORED[code]).astype(order + STORED[code])
    with path.open("wb") as stream:
        stream.write(file_header(stored.shape[1], code=code, order=order, **head))
        for values, fields in zip(stored, headers):
            stream.write(trace_header(fields, order) + values.tobytes())
    return path


def grid_headers(
    inlines: Any, crosslines: Any, *, bytes_: tuple[int, int] = (189, 193), by: str = "inline", **more: int
) -> list[dict[int, int]]:
    """Headers of a full grid in the order of the file, line by line."""
    pairs = (
        [(i, x) for i in inlines for x in crosslines]
        if by == "inline"
        else [(i, x) for x in crosslines for i in inlines]
    )
    extra = {int(name[1:]): value for name, value in more.items()}
    return [{bytes_[0]: int(i), bytes_[1]: int(x)} | extra for i, x in pairs]


@pytest.fixture
def maker() -> SimpleNamespace:
    """The functions above, as a fixture: test folders are not packages."""
    return SimpleNamespace(
        write=write_raw, headers=grid_headers, file_header=file_header, trace_header=trace_header, stored=STORED
    )
