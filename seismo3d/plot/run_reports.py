"""Reports of tracks and network runs: one HTML file each that holds everything it shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d.geometry.bearings import whole_deg
from seismo3d.io._files import written_aside
from seismo3d.plot.pages import fill_template, in_words
from seismo3d.plot.picture_set import PictureFile
from seismo3d.plot.report_facts import survey_facts
from seismo3d.plot.reports import embed_pictures

# rows of the longest tables: the largest zones and the longest lines
_MOST_ZONES, _MOST_LINES = 30, 60


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table of a report: title, headings, and rows of text."""

    title: str
    headings: tuple[str, ...]
    rows: list[list[str]]


@dataclass(frozen=True, slots=True)
class ReportPage:
    """What a report shows, from top to foot.

    Attributes
    ----------
    title, subtitle : str
        Heading.
    numbers : list of (str, str)
        Value and meaning of the key numbers.
    pictures : sequence of PictureFile
    tables : list of ReportTable
    meanings : list of (str, str)
        Words and what they mean.
    facts : list of (str, list of (str, str))
        Headings, each with names and values.
    notes : list of str
        What the reader must know first.
    """

    title: str
    subtitle: str
    numbers: list[tuple[str, str]]
    pictures: Sequence[PictureFile] = ()
    tables: list[ReportTable] = field(default_factory=list)
    meanings: list[tuple[str, str]] = field(default_factory=list)
    facts: list[tuple[str, list[tuple[str, str]]]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


_LOOP = (
    "A reflector followed over {0} traces along the inlines and {0} along the crosslines, and the other way round, "
    "must come out at the same sample. How far it misses says how well neighbouring traces were registered, without "
    "knowing the truth; loops that cross a fault or a dead trace are left out."
)
_STRIKE = "Strike follows the right-hand rule: looking along it, the fault dips to the right."
_DIP_IN_BINS = (
    "Dips, angles between faults and the spread of a set are those of the surfaces in bins and samples: true ones need "
    "a map and, in a time cube, velocities."
)


def write_page(path: str | Path, page: ReportPage) -> Path:
    """Write a report as one self-contained HTML file: no links to other files or hosts.

    Parameters
    ----------
    path : str or Path
        The file; replaced in one step where it is there already.
    page : ReportPage
        What it shows.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    text = fill_template(
        "run.html.jinja", title=page.title, subtitle=page.subtitle, numbers=page.numbers, notes=page.notes,
        pictures=embed_pictures(page.pictures), tables=page.tables, meanings=page.meanings, facts=page.facts,
    )  # fmt: skip
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write(text.encode())
    return Path(path)


def tracks_page(
    tracks: Sequence[Any],
    cube: Any,
    *,
    title: str,
    pictures: Sequence[PictureFile],
    run: Mapping[str, Any],
    closure: Any = None,
) -> ReportPage:
    """Lay out the report of tracks.

    Parameters
    ----------
    tracks : sequence of Track
        Tracks of ``cube``.
    cube : DataArray or ndarray
        The cube or section.
    title : str
        Heading of the page.
    pictures : sequence of PictureFile
        What to show.
    run : mapping
        What else to record, as in ``run.json``.
    closure : LoopClosure, optional
        How well the cube's shifts agree round closed loops.

    Returns
    -------
    ReportPage
    """
    numbers = [(str(len(tracks)), "horizon" if len(tracks) == 1 else "horizons")]
    if tracks:
        shares = [track.share for track in tracks]
        numbers.append((f"{100 * float(np.mean(shares)):.0f} %", "of the traces, on average"))
        numbers.append((f"{np.mean([_confidence(track) for track in tracks]):.2f}", "mean correlation with the seed"))
    unit = tracks[0].sample_unit if tracks else "samples"
    headings = ("Track", "Traced", "Correlation", f"Shallowest ({unit})", f"Deepest ({unit})", "Seeds")
    table = ReportTable("Tracks", headings, [_track_row(n, track) for n, track in enumerate(tracks, start=1)])
    meanings = [
        ("Track", "One reflector followed from its seeds. Places where it is not known are left empty, not guessed."),
        ("Correlation", "How well the waveform there matches that at the seeds, 0 to 1, averaged over the track."),
    ]
    if closure is not None and closure.n_loops:
        numbers.append((f"{closure.median:.2f}", "samples missed by closed loops, in the median"))
        numbers.append((f"{100 * closure.over_one:.1f} %", "of the loops miss by more than one sample"))
        meanings.append(("Closed loop", _LOOP.format(closure.length)))
    notes = [] if tracks else ["No horizon was found: nothing in the data is continuous enough."]
    subtitle = f"Horizons followed by seismo3d through a {'section' if np.ndim(cube) == 2 else 'cube'}"
    return ReportPage(title, subtitle, numbers, pictures, [table], meanings, _facts(cube, run), notes)


def network_page(
    network: Any, path: Any, cube: Any, *, title: str, pictures: Sequence[PictureFile], run: Mapping[str, Any]
) -> ReportPage:
    """Lay out the report of a fracture network.

    Parameters
    ----------
    network : FractureNetwork
        The network.
    path : FlowPath or None
        A flow path through it.
    cube : DataArray or ndarray
        The cube, or a volume of its faults, for the coordinates.
    title, pictures, run
        As for tracks.

    Returns
    -------
    ReportPage
    """
    n, lines = network.graph.number_of_nodes(), network.intersections
    numbers = [
        (str(n), "fault" if n == 1 else "faults"),
        (str(len(lines)), "intersection" if len(lines) == 1 else "intersections"),
        (str(len(network.zones)), "connected zone" if len(network.zones) == 1 else "connected zones"),
        (f"{network.intensity:.3g}", f"fault area over volume (1/{network.unit})"),
    ]
    if path is not None:
        numbers.append((f"{path.straight:.1f} times", "easier along the flow path than straight through rock"))
    meanings = [
        ("Intersection", "A line in which two faults meet: they cross, one ends at the other, or both end."),
        ("Zone", "Faults that are connected, directly or through others."),
        ("Set", "Faults of about one orientation. The spread is the angle about the mean pole that holds 68 %."),
        ("Fault area over volume", "P32: it does not depend on the direction in which the faults are sampled."),
        ("Strike and dip", _STRIKE + (f" {_DIP_IN_BINS}" if network.unit == "bin" else "")),
    ]
    tables = [_sets_table(network), _zones_table(network), _lines_table(network)]
    subtitle = "Network of the faults traced by seismo3d"
    notes = [] if n else ["There is no fault in this run, and so no network."]
    return ReportPage(title, subtitle, numbers, pictures, tables, meanings, _facts(cube, run), notes)


def _sets_table(network: Any) -> ReportTable:
    rows = [
        [str(k), str(len(entry.surfaces)), f"{100 * entry.share:.0f} %", f"{whole_deg(entry.strike_deg):.0f}",
         f"{entry.dip_deg:.0f}", f"{entry.spread_deg:.0f}"]
        for k, entry in enumerate(network.sets, start=1)
    ]  # fmt: skip
    return ReportTable("Sets", ("Set", "Faults", "Share of the area", "Strike (°)", "Dip (°)", "Spread (°)"), rows)


def _zones_table(network: Any) -> ReportTable:
    rows = [
        [str(k), " ".join(map(str, zone.surfaces)), f"{zone.area:,.0f}", str(zone.n_intersections),
         f"{zone.intensity:.3g}"]
        for k, zone in enumerate(network.zones[:_MOST_ZONES], start=1)
    ]  # fmt: skip
    unit = network.unit
    headings = ("Zone", "Faults", f"Area ({unit}²)", "Intersections", f"Area over its box (1/{unit})")
    return ReportTable("Connected zones", headings, rows)


def _lines_table(network: Any) -> ReportTable:
    words = {"cross": "cross", "abut": "{} ends at the other", "corner": "both end"}
    rows = [
        [str(line.first), str(line.second), words[line.kind].format(line.abutting), f"{line.length:,.0f}",
         f"{line.angle_deg:.0f}"]
        for line in sorted(network.intersections, key=lambda line: -line.length)[:_MOST_LINES]
    ]  # fmt: skip
    return ReportTable("Intersections", ("Fault", "Fault", "They", f"Length ({network.unit})", "Angle (°)"), rows)


def _track_row(number: int, track: Any) -> list[str]:
    known = np.isfinite(track.depth)
    ends = (float(track.depth[known].min()), float(track.depth[known].max())) if known.any() else (math.nan, math.nan)
    seeds = "; ".join(" ".join(f"{value:.8g}" for value in seed) for seed in track.seeds[:3])
    more = f" and {len(track.seeds) - 3} more" if len(track.seeds) > 3 else ""
    shown = [f"{value:,.1f}" if math.isfinite(value) else "–" for value in ends]
    return [str(number), f"{100 * track.share:.0f} %", f"{_confidence(track):.2f}", *shown, seeds + more]


def _confidence(track: Any) -> float:
    known = np.isfinite(track.confidence)
    return float(track.confidence[known].mean()) if known.any() else 0.0


def _facts(cube: Any, run: Mapping[str, Any]) -> list[tuple[str, list[tuple[str, str]]]]:
    entries = []
    for name, value in run.items():
        if isinstance(value, Mapping):
            entries += [(f"{name} {key}", in_words(item)) for key, item in value.items()]
        else:
            entries.append((str(name), in_words(value)))
    return [("Survey", survey_facts(cube)), ("Run", entries)]
