"""Tracks to files: horizons for exchange, and a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d.errors import ShapeError
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry
from seismo3d.io._files import as_path
from seismo3d.io.horizons import (
    HorizonGrid,
    why_no_irap,
    write_charisma_horizon,
    write_irap_classic,
    write_xyz_horizon,
)
from seismo3d.io.tables import write_csv
from seismo3d.seismic.tracks import Track

_COLUMNS = ("track", "share_traced", "confidence_mean", "shallowest", "deepest", "unit", "seeds")


def write_tracks(tracks: Sequence[Track], cube: Any, *, directory: str | Path) -> list[Path]:
    """Write tracks as horizons in every exchange format, and a table.

    ``track_01.xyz``, ``track_01.charisma.txt`` and ``track_01.irap.txt`` (IRAP classic) for the first, and so on, and
    ``tracks.csv``; of a section the first and the last alone, and no IRAP where :func:`irap_note` says why. Coordinates
    are metres, or the map's feet, where the cube knows them, else line numbers; z is time or depth, positive downwards.

    Parameters
    ----------
    tracks : sequence of Track
        Tracks of ``cube``.
    cube : DataArray or ndarray
        Gives the coordinates.
    directory : str or Path
        A folder that is there; files in it are replaced one by one.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    ShapeError
        If a track is not of this cube.
    FileAccessError
        If the folder cannot be written to.
    """
    directory = as_path(directory, "directory")
    files = []
    forms, traces = [("xyz", write_xyz_horizon)], _lay_out(cube)
    if np.ndim(cube) == 3:
        forms.append(("charisma.txt", write_charisma_horizon))
        if why_no_irap(traces.x, traces.y) is None:
            forms.append(("irap.txt", write_irap_classic))
    for number, track in enumerate(tracks, start=1):
        horizon = _on_traces(track, traces)
        for ending, write in forms:
            files.append(directory / f"track_{number:02d}.{ending}")
            write(files[-1], horizon)
    write_csv(directory / "tracks.csv", tabulate_tracks(tracks), columns=_COLUMNS)
    return [*files, directory / "tracks.csv"]


def irap_note(cube: Any) -> str | None:
    """Say why tracks of a cube are written without IRAP grids; None where they are written, and of a section.

    IRAP classic holds rectangular grids alone; a survey may be sheared, or one line wide.
    """
    if np.ndim(cube) != 3:
        return None
    traces = _lay_out(cube)
    reason = why_no_irap(traces.x, traces.y)
    return None if reason is None else f"tracks are written without IRAP grids: the survey has {reason}"


def tabulate_tracks(tracks: Sequence[Track]) -> list[dict[str, Any]]:
    """Return a row a track: share traced, unit, seeds, mean confidence, shallowest and deepest place."""
    return [_row(number, track) for number, track in enumerate(tracks, start=1)]


def _lay_out(cube: Any) -> HorizonGrid:
    """Return the traces of a cube or section as a horizon that is nowhere known."""
    shape = tuple(np.shape(cube)[:-1])
    nowhere = np.full(shape, np.nan)
    if len(shape) == 1:
        line = SectionGeometry.from_cube(cube)
        x, y = line.index_to_map(np.column_stack([np.arange(shape[0]), np.zeros(shape[0])]))[:, :2].T
        return HorizonGrid(x, y, nowhere, np.zeros(1), np.arange(float(shape[0])))
    survey = SurveyGeometry.from_cube(cube)
    rows, columns = np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij")
    places = survey.index_to_map(np.stack([rows.ravel(), columns.ravel(), np.zeros(rows.size)], axis=1))
    x, y = places[:, 0].reshape(shape), places[:, 1].reshape(shape)
    return HorizonGrid(x, y, nowhere, survey.inline.coordinates(), survey.crossline.coordinates())


def _on_traces(track: Track, traces: HorizonGrid) -> HorizonGrid:
    shape = traces.z.shape
    if track.depth.shape != shape:
        raise ShapeError(f"track has shape {track.depth.shape}; expected {shape}. Give the cube that it was traced in.")
    return replace(traces, z=track.depth.astype(np.float64))


def _row(number: int, track: Track) -> dict[str, Any]:
    known = np.isfinite(track.depth)
    seeds = "; ".join(" ".join(f"{value:.8g}" for value in seed) for seed in track.seeds)
    row: dict[str, Any] = {"track": number, "share_traced": track.share, "unit": track.sample_unit, "seeds": seeds}
    if known.any():
        row["confidence_mean"] = float(np.mean(track.confidence[known]))
        row["shallowest"], row["deepest"] = float(track.depth[known].min()), float(track.depth[known].max())
    return row
