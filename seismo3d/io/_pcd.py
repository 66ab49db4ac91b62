"""PCD files of points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FormatError
from seismo3d.io import _lzf
from seismo3d.io._point_tables import pick_columns, text_table

_TYPES = {
    (kind, str(size)): f"<{kind.lower()}{size}" for kind in "IUF" for size in (1, 2, 4, 8) if (kind, size) != ("F", 1)
}


def read_pcd(path: Path) -> tuple[AnyArray, AnyArray | None]:
    """Return the points of a PCD file, ASCII, binary or compressed, and their normals."""
    data = path.read_bytes()
    header: dict[str, list[str]] = {}
    start = 0
    while "DATA" not in header:
        end = data.find(b"\n", start)
        if end < 0 or start > 65536:
            raise FormatError(f"{path.name} has no PCD header; expected lines up to DATA.")
        words = data[start:end].decode("ascii", errors="replace").split()
        start = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    try:
        names, count = header["FIELDS"], int(header["POINTS"][0])
        counts = [int(c) for c in header.get("COUNT", ["1"] * len(names))]
        kinds = [_TYPES[t.upper(), s] for t, s in zip(header["TYPE"], header["SIZE"])]
        layout = np.dtype([(n, k, (c,)) if c > 1 else (n, k) for n, k, c in zip(_unique(names), kinds, counts)])
        form = header["DATA"][0]
    except (KeyError, ValueError, IndexError, TypeError, OverflowError) as error:
        raise FormatError(f"{path.name} has a broken PCD header: {error}. Write it again.") from error
    if count < 0 or min(counts, default=1) < 1:
        raise FormatError(
            f"{path.name} has a broken PCD header: {count} points of {counts} values a field. Write it again."
        )
    if form == "ascii":
        lines = data[start:].decode("ascii", errors="replace").split("\n")
        spread = [n if c == 1 else f"{n}{k}" for n, c in zip(_unique(names), counts) for k in range(c)]
        return pick_columns(text_table(lines[:count], spread, count, path), path)
    return pick_columns(_pcd_binary(data[start:], layout, count, form, path), path)


def _pcd_binary(body: bytes, layout: np.dtype[Any], count: int, form: str, path: Path) -> dict[str, AnyArray]:
    size = count * layout.itemsize
    if form == "binary":
        if len(body) < size:
            raise FormatError(f"{path.name} is cut short: expected {count} points. Get the file again.")
        rows = np.frombuffer(body, dtype=layout, count=count)
        return {name: rows[name] for name in layout.names or ()}
    if form != "binary_compressed" or len(body) < 8:
        raise FormatError(f"{path.name} has DATA {form!r}; expected ascii, binary or binary_compressed.")
    packed, full = (int(value) for value in np.frombuffer(body, dtype="<u4", count=2))
    # three bytes of LZF unpack to 264 at most
    if packed > len(body) - 8 or full > 88 * packed + 264:
        raise FormatError(f"{path.name} announces {full} bytes of points in {packed}; expected fewer. It is damaged.")
    out = _lzf.decompress(np.frombuffer(body, dtype=np.uint8)[8 : 8 + int(packed)], int(full))
    if out.size < size:
        raise FormatError(f"{path.name} is cut short: expected {count} points. Get the file again.")
    columns, offset = {}, 0
    for name in layout.names or ():  # compressed files keep each field's values together
        kind = layout[name]
        columns[name] = np.frombuffer(out, dtype=kind, count=count, offset=offset)
        offset += count * kind.itemsize
    return columns


def _unique(names: list[str]) -> list[str]:
    return [name if names.count(name) == 1 else f"{name}_{k}" for k, name in enumerate(names)]
