"""Fingerprints of input files: enough to tell whether a result was made from this very file."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from seismo3d.io._files import refuse_os_errors

_BLOCK = 64 * 1024
_N_BLOCKS = 256
_METHOD = (
    f"SHA-256 over the size in bytes and {_N_BLOCKS} blocks of {_BLOCK} bytes, evenly spread from first to last; "
    "the whole of smaller files"
)


def fingerprint(path: str | Path) -> dict[str, Any]:
    """Fingerprint a file, or a folder such as a Zarr store.

    Names and times are left out, so that a copy has the same fingerprint. At most 16 MiB of a file are read.

    Parameters
    ----------
    path : str or Path
        The file or folder.

    Returns
    -------
    dict
        ``file`` (its name), ``size_bytes``, ``sha256``, and ``sha256_of``, which says what was hashed.

    Raises
    ------
    FileAccessError
        If it cannot be read.
    """
    path = Path(path)
    with refuse_os_errors(path, "read"):
        if path.is_dir():
            size, digest, method = _hash_folder(path)
        else:
            size, digest, method = path.stat().st_size, _hash_file(path).hexdigest(), _METHOD
    return {"file": path.name, "size_bytes": size, "sha256": digest, "sha256_of": method}


def _hash_file(path: Path) -> Any:
    size = path.stat().st_size
    digest = hashlib.sha256(str(size).encode())
    with path.open("rb") as file:
        if size <= _N_BLOCKS * _BLOCK:
            while block := file.read(_BLOCK):
                digest.update(block)
            return digest
        for number in range(_N_BLOCKS):
            file.seek(number * (size - _BLOCK) // (_N_BLOCKS - 1))
            digest.update(file.read(_BLOCK))
    return digest


def _hash_folder(folder: Path) -> tuple[int, str, str]:
    digest, size = hashlib.sha256(), 0
    for file in sorted(entry for entry in folder.rglob("*") if entry.is_file()):
        size += file.stat().st_size
        digest.update(file.relative_to(folder).as_posix().encode())
        digest.update(_hash_file(file).digest())
    return size, digest.hexdigest(), f"each file's path and fingerprint; of a file: {_METHOD}"
