"""Images, sections and cubes from files, as bare arrays."""

from __future__ import annotations

from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.errors import FileAccessError, FormatError

_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")


def read_grid(path: str | Path) -> AnyArray:
    """Read an image, a section or a cube as an array, by the file's ending.

    Parameters
    ----------
    path : str or Path
        Picture (PNG, JPEG, TIFF, BMP, WebP, PNM), ``.npy``, ``.npz`` with one array, or what ``open_cube`` opens.

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
    """
    path = Path(path)
    if not path.exists():
        raise FileAccessError(f"{path} does not exist. Give an image, .npy, .npz, SEG-Y file or Zarr folder.")
    if path.suffix.lower() in _PICTURES:
        return _read_picture(path)
    if path.suffix.lower() in (".npy", ".npz"):
        return _read_array(path)
    from seismo3d.io.cubes import open_cube

    return np.asarray(open_cube(path).values)


def _read_picture(path: Path) -> AnyArray:
    import cv2

    image = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if image is None:
        raise FormatError(f"{path} cannot be read as a picture; expected what its ending says. It may be cut short.")
    return np.asarray(image)


def _read_array(path: Path) -> AnyArray:
    try:
        with path.open("rb") as file:
            read = np.load(file, allow_pickle=False)
            if isinstance(read, np.ndarray):
                return read
            names = list(read.files)
            if len(names) == 1:
                return np.asarray(read[names[0]])
    except (ValueError, EOFError, OSError, BadZipFile) as error:
        raise FormatError(f"{path} is no NumPy file of numbers, or is cut short: {error}.") from error
    held = ", ".join(names) or "none"
    raise FormatError(f"{path} holds the arrays {held}; expected one. Save the one that is meant as .npy.")
