"""A session's folder: what is opened, what is saved, and how labels follow edited surfaces."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d._validate import freeze
from seismo3d.errors import FileAccessError, FormatError, ShapeError
from seismo3d.io._files import refuse_os_errors
from seismo3d.io.archive import read_archive, write_archive
from seismo3d.io.numpy_files import refuse_damage
from seismo3d.seismic.exports import write_faults
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.track_exports import write_tracks
from seismo3d.seismic.tracks import Track
from seismo3d.viewer.interpretation import Interpretation
from seismo3d.viewer.relabelling import as_faults

FAULTS, TRACKS = "faultset.npz", "tracks.npz"
# what write_tracks writes
_EXPORT = re.compile(r"track_\d{2,}\.(xyz|charisma\.txt|irap\.txt)|tracks\.csv")


@dataclass(frozen=True, slots=True, eq=False)
class Opened:
    """What a session starts from.

    Attributes
    ----------
    cube : DataArray
        The cube, lazy when large.
    faults : FaultSet or None
        Its faults.
    tracks : list of Track
        Its horizons.
    """

    cube: Any
    faults: FaultSet | None
    tracks: list[Track]


def open_session(path: str | Path, *, cube: str | Path | None = None, **options: Any) -> Opened:
    """Open a cube, or the folder of a faults run or of an earlier session.

    Parameters
    ----------
    path : str or Path
        A cube file, or a folder with ``faultset.npz``.
    cube : str or Path, optional
        The cube that a folder's faults were traced in; by default the file that the folder names.
    **options
        Given to :func:`seismo3d.open_cube`.

    Returns
    -------
    Opened

    Raises
    ------
    FileAccessError
        If there is nothing to open, or the cube is no longer where it was.
    ShapeError
        If the faults are of another cube.
    """
    from seismo3d.io.cubes import is_zarr_store, open_cube

    folder = Path(path)
    if not (folder / FAULTS).is_file():
        if cube is not None:
            raise FileAccessError(f"{folder} holds no {FAULTS}; expected the folder of a faults run beside --cube.")
        if folder.is_dir() and not is_zarr_store(folder):
            raise FileAccessError(
                f"{folder} holds no {FAULTS}; expected a cube (SEG-Y, Zarr, .npy, .npz), or the folder of a faults run "
                "or of an earlier view. Open the report.html of other runs in a browser."
            )
        return Opened(open_cube(folder, **options), None, [])
    faults = FaultSet.load(folder)
    opened = open_cube(_find_cube(folder, faults, cube), **options)
    if np.shape(faults.labels) != opened.shape:
        raise ShapeError(
            f"faults in {folder} are of a cube of shape {np.shape(faults.labels)}; the cube has shape {opened.shape}. "
            "Give the cube that they were traced in."
        )
    return Opened(opened, faults, read_tracks(folder) if (folder / TRACKS).is_file() else [])


def _find_cube(folder: Path, faults: FaultSet, cube: str | Path | None) -> Path:
    if cube is not None:
        return Path(cube)
    named = getattr(faults.labels, "attrs", {}).get("path")
    if named:
        # a name without its folder was meant from where the run was started: look beside the run's folder too
        for place in (Path(named), folder.resolve().parent / Path(named).name):
            if place.exists():
                return place
    raise FileAccessError(f"the cube of {folder}, {named or 'not named there'}, is not found. Name it by --cube.")


def choose_folder(path: str | Path, out: str | Path | None, *, overwrite: bool = False) -> Path:
    """Choose the folder that a session is saved to: that of an earlier session itself, else a new one.

    Parameters
    ----------
    path : str or Path
        What is opened.
    out : str or Path or None
        The folder asked for.
    overwrite : bool
        Whether files of an earlier session in it may be replaced.

    Returns
    -------
    Path

    Raises
    ------
    FileAccessError
        If the folder has something in it that would be replaced, or the one asked for cannot be written.
    """
    opened = Path(path)
    if out is None and (opened / TRACKS).is_file():
        return opened
    folder = Path(f"{opened.resolve().stem if opened.is_file() else opened.resolve().name}-edited")
    folder = folder if out is None else Path(out)
    check_folder(folder)
    # who only looks needs no folder to write to
    if out is not None and not os.access(_nearest_place(folder), os.W_OK | os.X_OK):
        raise FileAccessError(f"{folder} cannot be written: permission denied. Choose another (--out).")
    same = folder.exists() and opened.exists() and folder.resolve() == opened.resolve()
    if (folder / TRACKS).is_file() and not same and not overwrite:
        raise FileAccessError(
            f"{folder} holds an earlier session. Open it by 'seismo3d view {folder}', choose another folder by "
            "--out, or replace it with --overwrite."
        )
    return folder


def check_folder(folder: Path) -> None:
    """Refuse a folder that a session must not be saved to: one with something in it that no session saved.

    Raises
    ------
    FileAccessError
        If it is a file or would lie in one, or is neither empty nor an earlier session's.
    """
    place = _nearest_place(folder)
    if not place.is_dir():
        raise FileAccessError(f"{place} is a file; expected a folder to save to. Choose another name (--out).")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / TRACKS).is_file():
        raise FileAccessError(
            f"{folder} holds what the viewer did not save; expected a new folder, an empty one, or an earlier "
            "session's. Choose another (--out)."
        )


def last_save(folder: Path) -> tuple[int, int] | None:
    """Tell saves of a folder apart: which file its tracks are now, and since when; None where nothing was saved."""
    try:
        found = (folder / TRACKS).stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


def _nearest_place(folder: Path) -> Path:
    """Return a folder, or the nearest place above it that is there."""
    return next(place for place in (folder, *folder.absolute().parents) if place.exists())


def save_session(folder: str | Path, cube: Any, state: Interpretation, *, opened: FaultSet | None) -> Path:
    """Save faults and horizons, in the package's own files and in the exchange formats.

    ``faultset.npz`` (:meth:`FaultSet.load` reads it) and ``tracks.npz`` are each written aside and renamed. Of earlier
    exports those that ``tracks.npz`` lists go.

    Parameters
    ----------
    folder : str or Path
        Where; made where it is absent.
    cube : DataArray or ndarray
        The cube.
    state : Interpretation
        What to save.
    opened : FaultSet or None
        The faults that the session started from, whose volumes are carried on.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    FileAccessError
        If it cannot be written, or holds something that no session saved.
    ParameterError
        If no volumes were opened, and the cube is too large to make them.
    """
    folder = Path(folder)
    check_folder(folder)
    faults = as_faults(cube, state, opened=opened)
    earlier = _listed_exports(folder)
    if not (folder / TRACKS).is_file():
        # tells that the folder is the viewer's, should what follows fail
        with refuse_os_errors(folder, "write"):
            folder.mkdir(parents=True, exist_ok=True)
        write_archive_of_tracks(folder / TRACKS, [])
    faults.save(folder)
    write_faults(faults, cube, directory=folder)
    tracks = [horizon.track for horizon in state.horizons]
    written = [file.name for file in write_tracks(tracks, cube, directory=folder)] if tracks else []
    write_archive_of_tracks(folder / TRACKS, tracks, exports=written)
    for name in set(earlier) - set(written):
        (folder / name).unlink(missing_ok=True)
    return folder


def _listed_exports(folder: Path) -> list[str]:
    """Return the names of the tracks' files that an earlier session lists as its own."""
    if not (folder / TRACKS).is_file():
        return []
    try:
        listed = read_archive(folder / TRACKS, prefix="none")[1].get("exports")
    except FormatError:
        return []
    names = listed if isinstance(listed, list) else []
    return [name for name in names if isinstance(name, str) and _EXPORT.fullmatch(name)]


def write_archive_of_tracks(path: Path, tracks: list[Track], *, exports: Sequence[str] = ()) -> None:
    """Write tracks to one file, with the names of the files that they were exported to."""
    arrays: dict[str, AnyArray] = {}
    for number, track in enumerate(tracks):
        for name in ("depth", "confidence", "seeds"):
            arrays[f"{number}.{name}"] = getattr(track, name)
    units = [track.sample_unit for track in tracks]
    meta = {"format": "seismo3d tracks", "version": 1, "units": units, "exports": list(exports)}
    write_archive(path, arrays, meta=meta)


def read_tracks(folder: str | Path) -> list[Track]:
    """Read the tracks of a session's folder.

    Raises
    ------
    FileAccessError, FormatError
        If the file cannot be read, or is something else.
    """
    path = Path(folder) / TRACKS
    arrays, meta = read_archive(path)
    if meta.get("format") != "seismo3d tracks" or meta.get("version") != 1:
        raise FormatError(f"{path} holds {meta.get('format')!r}; expected 'seismo3d tracks', version 1. Remove it.")
    with refuse_damage(path, "file of tracks"):
        return [
            Track(freeze(arrays[f"{n}.depth"]), freeze(arrays[f"{n}.confidence"]), freeze(arrays[f"{n}.seeds"]), unit)
            for n, unit in enumerate(meta["units"])
        ]
