"""A session's folder: what is opened, what is saved, and how labels follow edited surfaces."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import AnyArray, Float32Array, Int32Array
from seismo3d._validate import freeze
from seismo3d.errors import FileAccessError, FormatError, ParameterError, ShapeError
from seismo3d.io.archive import read_archive, write_archive
from seismo3d.seismic.exports import write_faults
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.track_exports import write_tracks
from seismo3d.seismic.tracks import Track
from seismo3d.viewer.interpretation import Fault, Interpretation

FAULTS, TRACKS = "faultset.npz", "tracks.npz"
_LARGEST = 2**31
"""Samples of a cube above which volumes of labels are not made in memory."""


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
    from seismo3d.io.cubes import open_cube

    folder = Path(path)
    if not (folder / FAULTS).is_file():
        if cube is not None:
            raise FileAccessError(f"{folder} holds no {FAULTS}; expected the folder of a faults run beside --cube.")
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
    if not named or not Path(named).exists():
        raise FileAccessError(f"the cube of {folder}, {named or 'not named there'}, is not found. Name it by --cube.")
    return Path(named)


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
        If the folder has something in it that would be replaced.
    """
    opened = Path(path)
    if out is None and (opened / TRACKS).is_file():
        return opened
    folder = Path(f"{opened.resolve().stem if opened.is_file() else opened.resolve().name}-edited")
    folder = folder if out is None else Path(out)
    if folder.exists() and not folder.is_dir():
        raise FileAccessError(f"{folder} is a file; expected a folder to save to. Choose another name by --out.")
    same = folder.exists() and opened.exists() and folder.resolve() == opened.resolve()
    if folder.is_dir() and any(folder.iterdir()) and not same:
        if not (folder / TRACKS).is_file():
            raise FileAccessError(f"{folder} is no folder of the viewer's, and not empty. Choose another by --out.")
        if not overwrite:
            raise FileAccessError(
                f"{folder} holds an earlier session. Open it by 'seismo3d view {folder}', choose another folder by "
                "--out, or replace it with --overwrite."
            )
    return folder


def save_session(folder: str | Path, cube: Any, state: Interpretation, *, opened: FaultSet | None) -> Path:
    """Save faults and horizons, in the package's own files and in the exchange formats.

    ``faultset.npz`` (:meth:`FaultSet.load` reads it) and ``tracks.npz`` are each written aside and renamed.

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
        If it cannot be written.
    ParameterError
        If no volumes were opened, and the cube is too large to make them.
    """
    folder = Path(folder)
    faults = as_faults(cube, state, opened=opened)
    faults.save(folder)
    tracks = [horizon.track for horizon in state.horizons]
    write_archive_of_tracks(folder / TRACKS, tracks)
    write_faults(faults, cube, directory=folder)
    if tracks:
        write_tracks(tracks, cube, directory=folder)
    return folder


def write_archive_of_tracks(path: Path, tracks: list[Track]) -> None:
    """Write tracks to one file."""
    arrays: dict[str, AnyArray] = {}
    for number, track in enumerate(tracks):
        for name in ("depth", "confidence", "seeds"):
            arrays[f"{number}.{name}"] = getattr(track, name)
    units = [track.sample_unit for track in tracks]
    write_archive(path, arrays, meta={"format": "seismo3d tracks", "version": 1, "units": units})


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
    try:
        return [
            Track(freeze(arrays[f"{n}.depth"]), freeze(arrays[f"{n}.confidence"]), freeze(arrays[f"{n}.seeds"]), unit)
            for n, unit in enumerate(meta["units"])
        ]
    except KeyError as error:
        raise FormatError(f"{path} lacks {error}: it is damaged. Remove it.") from error


def as_faults(cube: Any, state: Interpretation, *, opened: FaultSet | None) -> FaultSet:
    """Make a fault set of an interpretation: surfaces largest first, labels and throws drawn anew where edited.

    A voxel keeps the fault it had; where that one was split, it goes to the part with the nearest vertex; where it was
    deleted, it is cleared. Faults traced in this session are drawn where there is none, or one less likely.

    Parameters
    ----------
    cube : DataArray or ndarray
        The cube.
    state : Interpretation
        Its faults.
    opened : FaultSet or None
        Gives the volumes to start from.

    Returns
    -------
    FaultSet
    """
    faults = sorted(state.faults, key=lambda fault: -fault.surface.area)
    shape = tuple(int(n) for n in cube.shape)
    if opened is None and int(np.prod(shape)) > _LARGEST:
        raise ParameterError(
            f"the cube has shape {shape}; expected at most {_LARGEST} samples for new label volumes. "
            "Trace it by 'seismo3d faults' first, or open a part of it."
        )
    labels, throw, likelihood = _start_volumes(shape, opened)
    _relabel(labels, throw, faults)
    for number, fault in enumerate(faults, start=1):
        if fault.is_new:
            _draw_new(fault, number, faults, labels, throw, likelihood)
    return FaultSet(
        surfaces=tuple(fault.surface for fault in faults),
        likelihood=_like(cube, likelihood, "likelihood"),
        labels=_like(cube, labels, "labels"),
        throw=_like(cube, throw, "throw"),
        settings=dict(opened.settings) if opened is not None else {},
    )


def _start_volumes(shape: tuple[int, ...], opened: FaultSet | None) -> tuple[Int32Array, Float32Array, Float32Array]:
    if opened is None:
        return np.zeros(shape, np.int32), np.full(shape, np.nan, np.float32), np.zeros(shape, np.float32)
    names = ("labels", "throw", "likelihood")
    labels, throw, likelihood = (np.array(getattr(opened, name)) for name in names)
    return labels, throw, likelihood


def _relabel(labels: Int32Array, throw: Float32Array, faults: list[Fault]) -> None:
    """Give every labelled voxel the number of the fault that it belongs to now, in place."""
    owners: dict[int, list[int]] = {}
    for number, fault in enumerate(faults, start=1):
        for source in fault.sources:
            owners.setdefault(source, []).append(number)
    at = np.nonzero(labels)
    old = labels[at]
    new = np.zeros_like(old)
    for source in np.unique(old):
        chosen = old == source
        numbers = owners.get(int(source), [])
        if len(numbers) == 1:
            new[chosen] = numbers[0]
        elif numbers:
            places = np.stack([axis[chosen] for axis in at], axis=1)
            vertices = [faults[number - 1].surface.vertices for number in numbers]
            _, nearest = cKDTree(np.concatenate(vertices)).query(places)
            new[chosen] = np.repeat(numbers, [len(v) for v in vertices])[nearest]
    labels[at] = new
    throw[tuple(axis[new == 0] for axis in at)] = np.nan


def _draw_new(
    fault: Fault, number: int, faults: list[Fault], labels: Int32Array, throw: Float32Array, likelihood: Float32Array
) -> None:
    """Draw a fault that is in no volume yet, in place, where there is none or one less likely."""
    voxels, vertex = _surface_voxels(fault.surface, labels.shape)
    at = tuple(voxels.T)
    confidence = np.array([0.0, *(f.surface.confidence for f in faults)])
    wins = confidence[labels[at]] < np.maximum(fault.surface.confidence, 1e-6)
    at, vertex = tuple(voxels[wins].T), vertex[wins]
    labels[at] = number
    throw[at] = fault.surface.throw[vertex]
    likelihood[at] = np.maximum(likelihood[at], fault.surface.likelihood[vertex])


def _surface_voxels(surface: FaultSurface, shape: tuple[int, ...]) -> tuple[Int32Array, AnyArray]:
    """Voxels that a surface passes through, and the vertex nearest to each."""
    corners = surface.vertices[surface.cells].astype(np.float64)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(initial=1.0)
    n = int(np.ceil(longest / 0.5))
    first, second = (part.ravel() / n for part in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    inside = first + second <= 1.0 + 1e-9
    weights = np.stack([first, second, 1.0 - first - second], axis=1)[inside]
    points = np.einsum("wk,tkd->twd", weights, corners).reshape(-1, 3)
    voxels = np.unique(np.rint(points).astype(np.int32), axis=0)
    voxels = voxels[((voxels >= 0) & (voxels < np.array(shape))).all(axis=1)]
    _, vertex = cKDTree(surface.vertices).query(voxels)
    return voxels, np.asarray(vertex)


def _like(cube: Any, values: AnyArray, name: str) -> Any:
    if not hasattr(cube, "dims"):
        return freeze(values)
    kept = cube.drop_vars([key for key, entry in cube.coords.items() if not isinstance(entry.data, np.ndarray)])
    return kept.copy(data=freeze(values)).rename(name)
