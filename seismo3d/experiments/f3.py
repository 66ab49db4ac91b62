"""The test on a block of field data that the paper planned: faults, throws, horizons and network of one SEG-Y file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import Progress
from seismo3d.errors import ShapeError
from seismo3d.plot.picture_set import PictureFile

_N_HORIZONS = 5


def run_block(
    cube: Any, folder: str | Path, *, name: str, record: Mapping[str, Any], progress: Progress | None = None
) -> dict[str, Any]:
    """Trace faults with throws, horizons and network of a cube, and write all of it with one report.

    Parameters
    ----------
    cube : DataArray
        A cube, as ``open_cube`` gives it.
    folder : str or Path
        A folder that is there: it gets what the commands ``faults``, ``tracks`` and ``network`` write, without volumes,
        and one ``report.html`` over all of it.
    name : str
        What the report calls the cube.
    record : mapping
        What the report says of the run.
    progress : callable, optional
        Called with the stage's name and the share of it that is done.

    Returns
    -------
    dict
        Numbers of faults, horizons and intersections; mean share and correlation of the horizons; share of the fault
        area whose throw is known, and the median of its size.

    Raises
    ------
    ShapeError
        If the cube is a 2D line.
    """
    from seismo3d.plot.picture_set import save_pictures
    from seismo3d.plot.run_reports import write_page
    from seismo3d.seismic.exports import write_faults
    from seismo3d.seismic.faults import trace_faults
    from seismo3d.seismic.horizon_search import find_horizons
    from seismo3d.seismic.network import fracture_network
    from seismo3d.seismic.network_exports import write_network
    from seismo3d.seismic.track_exports import write_tracks

    if np.ndim(cube) != 3:
        raise ShapeError(f"cube has shape {np.shape(cube)}; expected a cube, not a 2D line.")
    folder = Path(folder)
    faults = trace_faults(cube, progress=progress)
    faults.save(folder)
    write_faults(faults, cube, directory=folder)
    pictures = save_pictures(folder, cube, faults=faults, progress=progress)
    pictures += _unfaulted_pictures(folder, cube, faults, progress)
    tracks = find_horizons(cube, _N_HORIZONS, faults=faults, progress=progress)
    write_tracks(tracks, cube, directory=folder)
    network = fracture_network(faults, cube=cube, progress=progress)
    write_network(network, cube, directory=folder)
    pictures += _more_pictures(folder, cube, faults, tracks, network)
    found = _sum_up(faults, tracks, network)
    write_page(folder / "report.html", _page(cube, faults, tracks, network, pictures, name=name, run=record))
    return found


def _unfaulted_pictures(folder: Path, cube: Any, faults: Any, progress: Progress | None) -> list[PictureFile]:
    """Draw the most faulted inline and crossline with their slip taken out; nothing where there are no faults."""
    from matplotlib.figure import Figure

    from seismo3d.plot.sections import most_faulted_lines
    from seismo3d.plot.unfaulted_sections import unfaulted_section
    from seismo3d.seismic.unfaulting import unfault

    if not faults.surfaces:
        return []
    unfaulted = unfault(cube, faults, progress=progress)
    files = []
    for axis, line in list(most_faulted_lines(faults, cube).items())[:2]:
        figure = Figure(figsize=(14.0, 5.6), layout="constrained")
        unfaulted_section(cube, unfaulted, faults=faults, axes=figure.subplots(1, 2), **{axis: line})
        path = folder / f"unfaulted_{axis}_{line:g}.png"
        figure.savefig(path, dpi=110)
        files.append(
            PictureFile(path, f"{axis.capitalize()} {line:g} today, and with the slip of its faults taken out.")
        )
    return files


def _more_pictures(folder: Path, cube: Any, faults: Any, tracks: list[Any], network: Any) -> list[PictureFile]:
    from seismo3d.plot.network_pictures import save_network_pictures
    from seismo3d.plot.track_pictures import save_track_pictures

    files = save_track_pictures(folder, cube, tracks, faults=faults)
    return files + save_network_pictures(folder, network, faults) if faults.surfaces else files


def _sum_up(faults: Any, tracks: list[Any], network: Any) -> dict[str, Any]:
    from seismo3d.geometry.triangles import weigh_vertices

    throw = np.concatenate([s.throw for s in faults.surfaces]) if faults.surfaces else np.zeros(0)
    weights = [weigh_vertices(s.vertices, s.cells) for s in faults.surfaces]
    area = np.concatenate(weights) if weights else np.zeros(0)
    matched = np.concatenate([s.is_matched for s in faults.surfaces]) if faults.surfaces else np.zeros(0, bool)
    known = np.isfinite(throw)
    return {
        "faults": len(faults.surfaces),
        "throw_matched_share": float(area[matched].sum() / area.sum()) if area.sum() > 0 else None,
        "throw_median_samples": float(np.median(np.abs(throw[known]))) if known.any() else None,
        "horizons": len(tracks),
        "horizon_share_mean": float(np.mean([track.share for track in tracks])) if tracks else None,
        "horizon_correlation_mean": float(np.mean([np.nanmean(t.confidence) for t in tracks])) if tracks else None,
        "intersections": len(network.intersections),
    }


def _page(
    cube: Any, faults: Any, tracks: list[Any], network: Any, pictures: list[PictureFile], *, name: str,
    run: Mapping[str, Any],
) -> Any:  # fmt: skip
    from dataclasses import replace

    from seismo3d.plot.report_facts import key_numbers, table_cell, table_columns
    from seismo3d.plot.run_reports import ReportTable, network_page, tracks_page
    from seismo3d.seismic.fault_table import tabulate_faults

    rows = tabulate_faults(faults, cube)
    columns = table_columns(rows)
    cells = [[table_cell(key, row[key])[0] for key, _ in columns] for row in rows]
    title = f"Faults, throws, horizons and network of {name}"
    page = tracks_page(tracks, cube, title=title, pictures=pictures, run=run)
    other = network_page(network, None, cube, title=title, pictures=[], run=run)
    notes = [] if rows else ["No fault was found: nothing in the data stands out from what chance would give."]
    return replace(
        page,
        subtitle="Everything that seismo3d traces in a cube, at default settings",
        numbers=key_numbers(faults, cube, rows) + page.numbers + (other.numbers[1:] if rows else []),
        tables=[ReportTable("Faults", tuple(heading for _, heading in columns), cells), *page.tables,
                *(other.tables if rows else [])],
        meanings=page.meanings + other.meanings,
        notes=notes + page.notes,
    )  # fmt: skip
