"""Images, sections and cubes from files, as bare arrays."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.io._files import as_readable_file
from seismo3d.io.numpy_files import check_declared, list_npz, read_npy, read_npz

_NOT_UNDERSTOOD = (OSError, ValueError, SyntaxError, KeyError, TypeError, IndexError, ArithmeticError, struct.error)
_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")


def read_grid(path: str | Path, *, variable: str | None = None, **reading: Any) -> AnyArray:
    """Read an image, a section or a cube as an array, by the file's ending.

    Parameters
    ----------
    path : str or Path
        Picture (PNG, JPEG, TIFF, BMP, WebP, PNM), ``.npy``, ``.npz``, or what ``open_cube`` opens.
    variable : str, optional
        The array to take from an ``.npz`` file or a Zarr group with several.
    **reading
        Given to ``open_cube``; those of a SEG-Y file or a Zarr group alone.

    Returns
    -------
    ndarray
        A picture is grey, (rows, columns), in its own depth. A cube is (inline, crossline, sample), a
        2D line (trace, sample), with NaN where traces are missing.

    Raises
    ------
    FileAccessError
        If there is no such file.
    FormatError
        If it cannot be read as what its ending says.
    ParameterError
        If an option does not serve files of this kind.
    """
    path = Path(path)
    if not path.exists():
        raise FileAccessError(f"{path} does not exist. Give an image, .npy, .npz, SEG-Y file or Zarr folder.")
    from seismo3d.io.cubes import open_cube, refuse_unused

    ending = path.suffix.lower()
    if ending in _PICTURES or ending in (".npy", ".npz"):
        refuse_unused(reading, path, "SEG-Y files and Zarr groups")
    if ending in _PICTURES or ending == ".npy":
        refuse_unused({"variable": variable}, path, "Zarr groups and NPZ files")
        return read_npy(path) if ending == ".npy" else _read_picture(path)
    if ending == ".npz":
        return _read_archive(path, variable)
    return np.asarray(open_cube(path, variable=variable, **reading).values)


def _read_picture(path: Path) -> AnyArray:
    import cv2

    data = np.fromfile(as_readable_file(path), dtype=np.uint8)
    image = None
    if data.size:
        _check_picture(path, data.size)
        with suppress(cv2.error):
            image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if image is None:
        raise FormatError(f"{path} cannot be read as a picture; expected what its ending says. It may be cut short.")
    return np.asarray(image)


def _check_picture(path: Path, size: int) -> None:
    """Refuse a picture that declares far more pixels than its file can hold; what is not understood is let through."""
    from PIL import Image

    try:
        declared = _declared_size(path)
    except Image.DecompressionBombError:
        # raised by readers that have a limit of their own, at twice this many
        least = 2 * (Image.MAX_IMAGE_PIXELS or 0)
        check_declared(8 * least, size, f"{path}, of more than {least} pixels,")
        return
    if declared is not None:
        columns, rows = declared
        check_declared(8 * rows * columns, size, f"{path}, of {rows} x {columns} pixels,")


def _declared_size(path: Path) -> tuple[int, int] | None:
    """Return columns and rows as a picture's header says; None where no reader understands it."""
    from PIL import Image

    # Image.open refuses by a limit that the whole process shares
    Image.init()
    with path.open("rb") as stream:
        head = stream.read(16)
        for name in Image.ID:
            make, accepts = Image.OPEN[name]
            if accepts is None or accepts(head) is not True:
                continue
            stream.seek(0)
            with suppress(*_NOT_UNDERSTOOD):
                return make(stream, str(path)).size
    return None


def _read_archive(path: Path, variable: str | None) -> AnyArray:
    names = list(list_npz(path))
    held = ", ".join(names) or "none"
    if variable is not None:
        if variable not in names:
            raise ParameterError(f"variable is {variable!r}; expected one of the arrays of {path}: {held}.")
        return read_npz(path, [variable])[variable]
    if len(names) != 1:
        raise FormatError(f"{path} holds the arrays {held}; expected one. Name the one that is meant with variable.")
    return read_npz(path)[names[0]]
