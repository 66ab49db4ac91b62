"""Crests of line support linked into lines, by the tracer that links a cube's faults, and lines joined across gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import BoolArray, Float64Array
from seismo3d.seismic._kernels_scan import find_ridges
from seismo3d.seismic.linking import LinkSettings, Sheet, link_sheets
from seismo3d.seismic.scan import RidgePoints
from seismo3d.terrain.support import LineSupport

_LINK = LinkSettings(fragment=8, contacts=4, closing=6, gap=6, smoothing=3.0, off_plane=1.6)


@dataclass(frozen=True, slots=True, eq=False)
class TracedLine:
    """A line on the map's grid.

    Attributes
    ----------
    places : ndarray of shape (n, 2), float64
        (row, column) on the finest level, about one cell of the line's own level apart.
    score : ndarray of shape (n,), float64
    step : float
        Share of the steps in the contrast of steps and troughs along it, 0 to 1.
    factor : int
        Cells of the map in a cell of the line's level.
    """

    places: Float64Array
    score: Float64Array
    step: float
    factor: int

    @property
    def length(self) -> float:
        """Length in cells of the finest level."""
        return float(np.linalg.norm(np.diff(self.places, axis=0), axis=1).sum())

    @property
    def strength(self) -> float:
        """Mean score times the root of the length in cells of its own level: how significant the whole line is."""
        return float(self.score.mean() * np.sqrt(self.length / self.factor))


def trace_lines(support: LineSupport, *, least: float, least_contrast: float, least_length: float) -> list[TracedLine]:
    """Thin the support and link its crests into lines, longest first.

    Parameters
    ----------
    support : LineSupport
    least : float
        Score that a crest needs.
    least_contrast : float
        Contrast that it needs.
    least_length : float
        Shortest line, in cells of the level.
    """
    score = support.score.copy()
    score[support.contrast < least_contrast] = 0.0
    flat = score[:, :, None]
    offset = np.zeros_like(flat)
    planes = np.column_stack([support.normals, np.zeros(len(support.normals))]).astype(np.float32)
    keep = find_ridges(flat, support.orientation[:, :, None], planes, np.float32(least), offset)
    voxels = np.argwhere(keep).astype(np.int32)
    at = tuple(voxels.T)
    chosen = planes[support.orientation[at[:2]]]
    positions = voxels.astype(np.float32)
    positions[:, :2] += offset[at][:, None] * chosen[:, :2]
    ridges = RidgePoints(voxels, positions, chosen, flat[at])
    shape = (flat.shape[0], flat.shape[1], 1)
    sheets = link_sheets(ridges, shape, step=1, least_points=max(4, int(0.5 * least_length)), settings=_LINK)
    lines = [line for sheet in sheets if (line := _as_line(sheet, support)) is not None]
    return [line for line in lines if line.length >= least_length * support.factor]


def _as_line(sheet: Sheet, support: LineSupport) -> TracedLine | None:
    rows = np.flatnonzero(sheet.inside[:, 0])
    if len(rows) < 2:
        return None
    w = sheet.w[rows, 0].astype(np.float64)
    places = sheet.points(rows.astype(np.float64), np.zeros(len(rows)), w)[:, :2]
    # a cell of a level covers `factor` cells: its centre lies between theirs
    fine = support.factor * (places + 0.5) - 0.5
    at = tuple(np.clip(np.rint(places).astype(np.int64), 0, np.array(support.score.shape) - 1).T)
    steps, troughs = np.abs(support.step[at]).sum(), np.maximum(support.trough[at], 0.0).sum()
    share = float(steps / max(steps + troughs, 1e-9))
    return TracedLine(fine, sheet.score[rows, 0].astype(np.float64), share, support.factor)


def join_lines(lines: list[TracedLine], *, gap: float, turn_deg: float = 20.0, aside: float = 3.0) -> list[TracedLine]:
    """Join lines that continue each other: ends that face each other across a gap, the smallest gap first.

    Parameters
    ----------
    lines : list of TracedLine
    gap : float
        Widest gap, in cells of the coarser line's level.
    turn_deg : float
        Largest angle between the two lines where they meet.
    aside : float
        Farthest that each line's continuation may miss the other's end, in cells of that level, beyond a tenth of the
        gap.

    Returns
    -------
    list of TracedLine
        Longest first; a joined line is of the kind and level of its longest part.
    """
    if len(lines) < 2:
        return list(lines)
    partner = _facing_ends(lines, gap, turn_deg, aside)
    free = set(range(len(lines)))
    out = []
    starts = [a for a in range(2 * len(lines)) if a not in partner] + list(range(2 * len(lines)))
    for start in starts:
        if start // 2 not in free:
            continue
        chain = []
        end = start
        while end // 2 in free:
            free.discard(end // 2)
            # entered at one end, left at the other
            chain.append((end // 2, end % 2 == 1))
            if (end ^ 1) not in partner:
                break
            end = partner[end ^ 1]
        out.append(_chained([(lines[number], backwards) for number, backwards in chain]))
    return sorted(out, key=lambda line: -line.length)


def _facing_ends(lines: list[TracedLine], gap: float, turn_deg: float, aside: float) -> dict[int, int]:
    """Return the partner of every end that has one; ends 2 n and 2 n + 1 are the first and the last of line n."""
    ends = [_end(line, last) for line in lines for last in (False, True)]
    place = np.array([p for p, _ in ends])
    way = np.array([d for _, d in ends])
    scale = np.repeat([float(line.factor) for line in lines], 2)
    a, b = np.triu_indices(len(ends), 1)
    apart = a // 2 != b // 2
    a, b = a[apart], b[apart]
    unit = np.maximum(scale[a], scale[b])
    across = (place[b] - place[a]) / unit[:, None]
    wide = np.hypot(across[:, 0], across[:, 1])
    miss = np.maximum(*(np.abs(way[e][:, 0] * across[:, 1] - way[e][:, 1] * across[:, 0]) for e in (a, b)))
    # ends may overlap by a little, where one crest steps over to the next
    ahead = (way[a] * across).sum(axis=1)
    fits = (wide <= gap) & ((way[a] * way[b]).sum(axis=1) <= -np.cos(np.radians(turn_deg)))
    fits &= (miss <= aside + 0.1 * wide) & (ahead > -aside)
    partner: dict[int, int] = {}
    for row in np.flatnonzero(fits)[np.argsort(wide[fits], kind="stable")]:
        first, second = int(a[row]), int(b[row])
        if first not in partner and second not in partner:
            partner[first], partner[second] = second, first
    return partner


def _end(line: TracedLine, last: bool) -> tuple[Float64Array, Float64Array]:
    """Return an end's place and the direction in which the line would go on from it."""
    part = line.places[-24:] if last else line.places[:24][::-1]
    way = part[-1] - part[0]
    return part[-1], way / max(float(np.hypot(*way)), 1e-9)


def _chained(parts: list[tuple[TracedLine, bool]]) -> TracedLine:
    """Return parts laid end to end, some of them turned round, with straight ways across the gaps."""
    longest = max((line for line, _ in parts), key=lambda line: line.length)
    places: list[Float64Array] = []
    scores: list[Float64Array] = []
    for line, backwards in parts:
        turn = slice(None, None, -1) if backwards else slice(None)
        p, score = line.places[turn], line.score[turn]
        if places:
            n = max(int(np.linalg.norm(p[0] - places[-1][-1]) / longest.factor), 1)
            share = np.linspace(0.0, 1.0, n + 1)[1:-1, None]
            # nothing was seen across the gap: it weighs half as much as the poorer end
            scores.append(np.full(len(share), 0.5 * min(float(score[0]), float(scores[-1][-1]))))
            places.append((1.0 - share) * places[-1][-1] + share * p[0])
        places.append(p)
        scores.append(score)
    whole, score = np.concatenate(places), np.concatenate(scores)
    keep = np.concatenate([[True], np.linalg.norm(np.diff(whole, axis=0), axis=1) > 1e-6])
    return TracedLine(whole[keep], score[keep], longest.step, longest.factor)


def drop_doubles(lines: list[TracedLine], *, near: float, least_length: float, turn_deg: float = 30.0) -> list[TracedLine]:
    """Keep, where lines run beside each other, the most significant, and of the others what goes beyond it.

    Parameters
    ----------
    lines : list of TracedLine
        Of any levels.
    near : float
        Distance, in cells of the coarser line's level, within which two lines are one.
    least_length : float
        Shortest rest, in cells of the line's own level, that is kept.
    turn_deg : float
        Lines that cross at a larger angle are never one.
    """
    kept: list[TracedLine] = []
    trees: list[cKDTree] = []
    cosine = np.cos(np.radians(turn_deg))
    for line in sorted(lines, key=lambda one: -one.strength):
        beside = np.zeros(len(line.places), bool)
        for better, tree in zip(kept, trees, strict=True):
            reach = near * max(line.factor, better.factor)
            if not _boxes_meet(line.places, better.places, reach) or abs(_way(line) @ _way(better)) <= cosine:
                continue
            distance, _ = tree.query(line.places, distance_upper_bound=reach)
            beside |= np.isfinite(distance)
        rest = _longest_run(~beside)
        cut = TracedLine(line.places[rest], line.score[rest], line.step, line.factor)
        if cut.length >= least_length * line.factor:
            kept.append(cut)
            trees.append(cKDTree(cut.places))
    return kept


def _longest_run(chosen: BoolArray) -> slice:
    """Return where the longest run of True lies."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]])))
    if len(edges) == 0:
        return slice(0, 0)
    starts, stops = edges[::2], edges[1::2]
    best = int(np.argmax(stops - starts))
    return slice(int(starts[best]), int(stops[best]))


def _boxes_meet(first: Float64Array, second: Float64Array, reach: float) -> bool:
    return bool(
        (first.min(axis=0) - reach <= second.max(axis=0)).all()
        and (second.min(axis=0) - reach <= first.max(axis=0)).all()
    )


def _way(line: TracedLine) -> Float64Array:
    way = line.places[-1] - line.places[0]
    return np.asarray(way / max(float(np.hypot(*way)), 1e-9))
