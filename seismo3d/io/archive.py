"""One file that holds named arrays and a description, without pickle: a ``.npz`` with a ``meta.json`` inside.

The file is written beside its place and renamed into it, so that a reader finds the old file, the new one, or none,
and never a half. ``numpy.load`` opens the arrays as well; ``unzip -p FILE meta.json`` shows the description.
"""

from __future__ import annotations

import base64
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.io._files import written_aside
from seismo3d.io.numpy_files import read_member, refuse_damage

_META = "meta.json"
# longest description that is read: a damaged file may promise any length
_META_BYTES = 256 * 2**20


def write_archive(path: str | Path, arrays: Mapping[str, AnyArray], *, meta: Mapping[str, Any]) -> None:
    """Write arrays and a description to one file.

    Parameters
    ----------
    path : str or Path
        The file; one that is there already is replaced in one step.
    arrays : mapping of str to ndarray
        Any numeric, boolean, date or text arrays.
    meta : mapping
        Nested dicts, lists, tuples, text, numbers, None, bytes and (small) arrays, all kept with their types.

    Raises
    ------
    ParameterError
        If a value has a type that cannot be kept.
    FileAccessError
        If the folder cannot be written to.
    """
    text = json.dumps(_encode(dict(meta), "meta"), indent=1)
    for name, array in arrays.items():
        if np.asarray(array).dtype.hasobject:
            raise ParameterError(
                f"array {name!r} holds Python objects; expected numbers, booleans or text. Convert it first."
            )
    with written_aside(path) as aside, zipfile.ZipFile(aside, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
        archive.writestr(_META, text)
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def read_archive(path: str | Path, *, prefix: str = "") -> tuple[dict[str, AnyArray], dict[str, Any]]:
    """Read what :func:`write_archive` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    prefix : str
        Read only the arrays whose names begin like this.

    Returns
    -------
    arrays : dict of str to ndarray
        The arrays by name.
    meta : dict
        The description.

    Raises
    ------
    FileAccessError
        If the file is not there or cannot be read.
    FormatError
        If it is not such an archive, or is damaged.
    """
    path = Path(path)
    if not path.is_file():
        raise FileAccessError(f"{path} cannot be read: it is no file. Check the name and the permissions.")
    with refuse_damage(path, "seismo3d archive"), zipfile.ZipFile(path) as archive:
        if archive.getinfo(_META).file_size > _META_BYTES:
            raise FormatError(f"{path} has a description of more than {_META_BYTES} bytes. It is damaged.")
        meta = _decode(json.loads(archive.read(_META)))
        if not isinstance(meta, dict):
            raise FormatError(f"{path} has a description that is no mapping. Write it again.")
        names = [name for name in archive.namelist() if name.endswith(".npy") and name.startswith(prefix)]
        return {name.removesuffix(".npy"): read_member(archive, name, path) for name in names}, meta


def list_archive(path: str | Path) -> list[str]:
    """Return the names of the arrays in a file that :func:`write_archive` wrote; errors as :func:`read_archive`."""
    path = Path(path)
    if not path.is_file():
        raise FileAccessError(f"{path} cannot be read: it is no file. Check the name and the permissions.")
    with refuse_damage(path, "seismo3d archive"), zipfile.ZipFile(path) as archive:
        return [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]


def _encode(value: Any, place: str) -> Any:
    if value is None or (isinstance(value, bool | int | float | str) and not isinstance(value, np.generic)):
        return value
    if isinstance(value, Mapping):
        return {"dict": [[_encode(k, place), _encode(v, f"{place}[{k!r}]")] for k, v in value.items()]}
    if isinstance(value, list):
        return [_encode(item, place) for item in value]
    if isinstance(value, tuple):
        return {"tuple": [_encode(item, place) for item in value]}
    if isinstance(value, bytes):
        return {"bytes": base64.b64encode(value).decode()}
    if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        kind = "array" if isinstance(value, np.ndarray) else "scalar"
        array = np.ascontiguousarray(value)
        return {
            kind: base64.b64encode(array.tobytes()).decode(),
            "dtype": array.dtype.str,
            "shape": list(np.shape(value)),
        }
    if isinstance(value, Path):
        return {"path": str(value)}
    raise ParameterError(
        f"{place} is a {type(value).__name__}; expected numbers, text, arrays, and dicts, lists and tuples of them."
    )


def _decode_array(value: dict[str, Any], kind: str) -> AnyArray:
    flat = np.frombuffer(base64.b64decode(value[kind]), dtype=np.dtype(value["dtype"]))
    return flat.reshape(value["shape"]).copy()


_DECODERS: dict[str, Callable[[dict[str, Any]], Any]] = {
    "dict": lambda v: {_decode(k): _decode(item) for k, item in v["dict"]},
    "tuple": lambda v: tuple(_decode(item) for item in v["tuple"]),
    "bytes": lambda v: base64.b64decode(v["bytes"]),
    "array": lambda v: _decode_array(v, "array"),
    "scalar": lambda v: _decode_array(v, "scalar")[()],
    "path": lambda v: Path(v["path"]),
}


def _decode(value: Any) -> Any:
    if isinstance(value, list):
        return [_decode(item) for item in value]
    if isinstance(value, dict):
        decoder = next((decoder for kind, decoder in _DECODERS.items() if kind in value), None)
        if decoder is None:
            # for refuse_damage to sort
            raise ValueError(f"its description has an entry {', '.join(value)[:80]!r} of no known kind")
        return decoder(value)
    return value
