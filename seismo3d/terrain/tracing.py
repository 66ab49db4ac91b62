"""Crests of line support linked into lines, by the tracer that links a cube's faults, and lines joined across gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._typing import Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_scan import find_ridges
from seismo3d.seismic.linking import LinkSettings, Sheet, link_sheets
from seismo3d.seismic.scan import RidgePoints
from seismo3d.terrain.support import LineSupport

_LINK = LinkSettings(fragment=8, contacts=4, closing=6, gap=6, smoothing=3.0, off_plane=1.6)

_NODE, _GRAIN = 16, 0.25
"""Cells from node to node of a line that is brought to its crest, and the grain of the moves aside, in cells."""
_TURNS = 4
"""Grains that a line moves aside from node to node at most: some 4 degrees against its smoothed way."""
_BEND_PRICE = 0.5
"""Nodes on a typical crest that a bend by one grain costs: faults are straighter than their worn scarps."""
_END = 36
"""Places at a line's end that its direction there is taken from."""


@dataclass(frozen=True, slots=True, eq=False)
class TracedLine:
    """A line on the map's grid.

    Attributes
    ----------
    places : ndarray of shape (n, 2), float64
        (row, column) on the finest level, about one cell of the line's own level apart.
    score : ndarray of shape (n,), float64
    kind : {"step", "trough", "both"}
    factor : int
        Cells of the map in a cell of the line's level.
    """

    places: Float64Array
    score: Float64Array
    kind: str
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
    return TracedLine(fine, sheet.score[rows, 0].astype(np.float64), support.kind, support.factor)


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
    part = line.places[-_END:] if last else line.places[:_END][::-1]
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
    return TracedLine(whole[keep], score[keep], longest.kind, longest.factor)


def fuse_lines(
    lines: list[TracedLine], *, near: float, share: float = 0.25, turn_deg: float = 20.0
) -> list[TracedLine]:
    """Fuse lines that run beside each other, of other kinds and levels, into one; most significant first.

    Slope, hollow and their scales see one fault at places a little apart and over parts of its length. The most
    significant line takes up those that lie beside it, and goes on as far as they do.

    Parameters
    ----------
    lines : list of TracedLine
    near : float
        Distance, in cells of the coarser line's level, within which two lines run beside each other.
    share : float
        Share of a line that must.
    turn_deg : float
        Largest angle between them.
    """
    rest = sorted(lines, key=lambda one: -one.strength)
    out = []
    cosine = np.cos(np.radians(turn_deg))
    while rest:
        group, fused = [rest[0]], rest[0]
        rest = rest[1:]
        while True:
            tree = cKDTree(fused.places)
            taken = [_is_beside(line, fused, tree, near, share, cosine) for line in rest]
            if not any(taken):
                break
            group += [line for line, is_taken in zip(rest, taken, strict=True) if is_taken]
            rest = [line for line, is_taken in zip(rest, taken, strict=True) if not is_taken]
            fused = _fused(group)
        out.append(fused)
    return out


def _is_beside(line: TracedLine, other: TracedLine, tree: cKDTree, near: float, share: float, cosine: float) -> bool:
    reach = near * max(line.factor, other.factor)
    if not _boxes_meet(line.places, other.places, reach) or abs(_way(line) @ _way(other)) <= cosine:
        return False
    distance, _ = tree.query(line.places, distance_upper_bound=reach)
    return bool(np.isfinite(distance).mean() >= share)


def _fused(group: list[TracedLine]) -> TracedLine:
    """Return the mean of lines along the way of the first, weighed by score and by resolution."""
    first = group[0]
    along = _way(max(group, key=lambda line: line.length))
    across = np.array([-along[1], along[0]])
    origin = first.places[0]
    places = np.concatenate([line.places for line in group]) - origin
    score = np.concatenate([line.score for line in group])
    factor = np.concatenate([np.full(len(line.places), float(line.factor)) for line in group])
    s, w = places @ along, places @ across
    bins = np.floor((s - s.min()) / first.factor).astype(np.int64)
    weight = (score / factor) ** 2 * factor
    total = np.bincount(bins, weight)
    mean = np.bincount(bins, weight * w)
    best = np.zeros(len(total))
    np.maximum.at(best, bins, score)
    filled = np.flatnonzero(total > 0.0)
    at = np.arange(len(total))
    offset = np.interp(at, filled, mean[filled] / total[filled])
    strong = np.interp(at, filled, total[filled])
    # one member ends and another goes on a little aside: the way over takes a dozen cells
    smooth = ndimage.gaussian_filter1d(offset * strong, 6.0, mode="nearest")
    offset = smooth / np.maximum(ndimage.gaussian_filter1d(strong, 6.0, mode="nearest"), 1e-12)
    line = origin + (s.min() + (at + 0.5) * first.factor)[:, None] * along + offset[:, None] * across
    return TracedLine(line, np.interp(at, filled, best[filled]), first.kind, first.factor)


def drop_echoes(
    lines: list[TracedLine], *, near: float, share: float = 0.6, turn_deg: float = 20.0
) -> list[TracedLine]:
    """Drop lines beside a stronger one that are nearer than the regional surface can follow: their own side lobes.

    Parameters
    ----------
    lines : list of TracedLine
    near : float
        Distance in cells of the coarser line's level.
    share : float
        Share of a line that lies beside a stronger one.
    turn_deg : float
        Largest angle between them.
    """
    cosine = np.cos(np.radians(turn_deg))
    kept: list[TracedLine] = []
    for line in sorted(lines, key=lambda one: -one.strength):
        if not any(_is_beside(line, one, cKDTree(one.places), near, share, cosine) for one in kept):
            kept.append(line)
    return kept


def snap_line(line: TracedLine, score: Float32Array, *, stiffness: float, reach: float) -> TracedLine:
    """Move a line to the crest of the finest level's score beside it that can be followed with the fewest bends.

    Parameters
    ----------
    line : TracedLine
    score : ndarray of shape (rows, columns), float32
        Of the finest level.
    stiffness : float
        Width, in cells, of the Gaussian that the line is smoothed by first.
    reach : float
        Farthest move, in cells.
    """
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line.places, axis=0), axis=1))])
    at = np.arange(0.0, arc[-1], 1.0)
    if len(at) < 8:
        return line
    places = np.column_stack([_stiff(np.interp(at, arc, line.places[:, k]), stiffness) for k in (0, 1)])
    normals = _normals(places)
    moves = np.arange(-round(reach / _GRAIN), round(reach / _GRAIN) + 1) * _GRAIN
    grid = places[:, None, :] + moves[None, :, None] * normals[:, None, :]
    gain = ndimage.map_coordinates(score, grid.reshape(-1, 2).T, order=1, mode="nearest").reshape(grid.shape[:2])
    first = np.arange(0, len(at), _NODE)
    size = np.diff(np.append(first, len(at)))
    path = _straightest_path(np.add.reduceat(gain.astype(np.float64), first, axis=0) / size[:, None])
    aside = ndimage.gaussian_filter1d(np.interp(at, first + 0.5 * (size - 1), moves[path]), 8.0, mode="nearest")
    return TracedLine(places + aside[:, None] * normals, np.interp(at, arc, line.score), line.kind, line.factor)


def _normals(places: Float64Array) -> Float64Array:
    way = np.gradient(places, axis=0)
    normal = np.column_stack([-way[:, 1], way[:, 0]])
    return np.asarray(normal / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9))


def _stiff(values: Float64Array, width: float) -> Float64Array:
    """Smooth a coordinate along a line; its ends go on as they come."""
    pad = min(len(values) - 1, int(3.0 * width))
    wide = np.pad(values, pad, mode="reflect", reflect_type="odd")
    return np.asarray(ndimage.gaussian_filter1d(wide, width, mode="nearest")[pad : len(wide) - pad])


def _straightest_path(gain: Float64Array) -> IntArray:
    """Return the columns, one a row, whose sum of gains less the price of the bends is the largest of all paths.

    Gains count relative to the best of their row and to that of a typical row, so that no bright patch pulls the line
    to itself. The state is the column and the step that led to it.
    """
    crest = gain.max(axis=1)
    gain = 2.0 * gain / np.maximum(crest + np.median(crest), 1e-12)[:, None]
    steps = np.arange(-_TURNS, _TURNS + 1)
    price = _BEND_PRICE * np.abs(steps[:, None] - steps[None, :])
    columns = np.arange(gain.shape[1])
    came_from = columns[:, None] - steps[None, :]
    inside = (came_from >= 0) & (came_from < len(columns))
    came_from = np.clip(came_from, 0, len(columns) - 1)
    best = np.repeat(gain[0][:, None], len(steps), axis=1)
    before = np.zeros((*gain.shape, len(steps)), np.int64)
    for n in range(1, len(gain)):
        choices = best[:, :, None] - price[None, :, :]
        cheapest = choices.argmax(axis=1)
        worth = np.take_along_axis(choices, cheapest[:, None, :], axis=1)[:, 0]
        which = np.arange(len(steps))
        best = np.where(inside, worth[came_from, which], -np.inf) + gain[n][:, None]
        before[n] = cheapest[came_from, which]
    path = np.empty(len(gain), np.int64)
    column, step = np.unravel_index(int(best.argmax()), best.shape)
    for n in range(len(gain) - 1, -1, -1):
        path[n] = column
        column, step = column - steps[step], before[n, column, step]
    return path


def _boxes_meet(first: Float64Array, second: Float64Array, reach: float) -> bool:
    return bool(
        (first.min(axis=0) - reach <= second.max(axis=0)).all()
        and (second.min(axis=0) - reach <= first.max(axis=0)).all()
    )


def _way(line: TracedLine) -> Float64Array:
    way = line.places[-1] - line.places[0]
    return np.asarray(way / max(float(np.hypot(*way)), 1e-9))
