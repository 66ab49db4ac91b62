"""Lines joined across gaps, lines of different evidence fused into one, and the side lobes of strong lines dropped."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._typing import Float64Array
from seismo3d.terrain.tracing import TracedLine

_END = 36
"""Places at a line's end that its direction there is taken from."""
_GOES_ON = 12.0
"""Cells of a part's level by which it must lengthen a line before it is asked whether the line still stands out."""
_STILL_OUT = 0.7
"""Share of its parts' prominence that a longer line keeps at least."""
_LEAST_COSINE = float(np.cos(np.radians(20.0)))
"""Of the angle between two lines that are parts of one, or run beside each other."""
_ASIDE = 3.0
"""Farthest that a line's continuation may miss another's end, in cells of the level, beyond a tenth of the gap."""
_BESIDE_TO_FUSE = 0.25
"""Share of a line that runs beside another where both are one."""


def join_lines(
    lines: list[TracedLine],
    *,
    gap: float,
    judge: Callable[[TracedLine], float] | None = None,
) -> list[TracedLine]:
    """Join lines that continue each other: ends that face each other across a gap, the smallest gap first.

    With a judge, the pair that stands out most as one line first, and none that stands out much less than its parts.

    Parameters
    ----------
    lines : list of TracedLine
    gap : float
        Widest gap, in cells of the coarser line's level.
    judge : callable, optional
        How far a line stands out.

    Returns
    -------
    list of TracedLine
        Longest first; a joined line is of the kind and level of its longest part.
    """
    if len(lines) < 2:
        return list(lines)
    partner = _facing_ends(lines, gap, judge)
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


def _facing_ends(lines: list[TracedLine], gap: float, judge: Callable[[TracedLine], float] | None) -> dict[int, int]:
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
    fits = (wide <= gap) & ((way[a] * way[b]).sum(axis=1) <= -_LEAST_COSINE)
    fits &= (miss <= _ASIDE + 0.1 * wide) & (ahead > -_ASIDE)
    rows = np.flatnonzero(fits)
    pairs = [(int(a[row]), int(b[row])) for row in rows[np.argsort(wide[rows], kind="stable")]]
    if judge is not None:
        pairs = _judged(pairs, lines, judge)
    partner: dict[int, int] = {}
    for first, second in pairs:
        if first not in partner and second not in partner:
            partner[first], partner[second] = second, first
    return partner


def _judged(
    pairs: list[tuple[int, int]], lines: list[TracedLine], judge: Callable[[TracedLine], float]
) -> list[tuple[int, int]]:
    """Return the pairs of ends that still stand out once joined, those that stand out most first."""
    kept = []
    for first, second in pairs:
        one, other = lines[first // 2], lines[second // 2]
        made = judge(_chained([(one, first % 2 == 0), (other, second % 2 == 1)]))
        if made >= _STILL_OUT * max(judge(one), judge(other)):
            kept.append((made, (first, second)))
    return [pair for _, pair in sorted(kept, key=lambda one: -one[0])]


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
    lines: list[TracedLine],
    *,
    near: float,
    judge: Callable[[TracedLine], float] | None = None,
) -> list[TracedLine]:
    """Fuse lines that run beside each other, of other kinds and levels, into one; most significant first.

    Slope, hollow and their scales see one fault at places a little apart and over parts of its length. The most
    significant line takes up those that lie beside it, and goes on as far as they do, unless it then stands out much
    less than its parts: it would leave a fault for a slope that meets it.

    Parameters
    ----------
    lines : list of TracedLine
    near : float
        Distance, in cells of the coarser line's level, within which two lines run beside each other.
    judge : callable, optional
        How far a line stands out; without it all that lie beside each other are one.
    """
    rest = sorted(lines, key=lambda one: -(one.strength if judge is None else judge(one)))
    out = []
    while rest:
        group, fused = [rest[0]], rest[0]
        rest = rest[1:]
        refused: set[int] = set()
        while True:
            tree = cKDTree(fused.places)
            taken = [
                line
                for line in rest
                if id(line) not in refused and _is_beside(line, fused, tree, near, _BESIDE_TO_FUSE)
            ]
            if not taken:
                break
            for line in taken:
                made = _fused([*group, line])
                if judge is not None and _is_worse(made, fused, line, judge):
                    refused.add(id(line))
                else:
                    group, fused = [*group, line], made
            gone = {id(line) for line in group}
            rest = [line for line in rest if id(line) not in gone]
        out.append(fused)
    return out


def _is_worse(made: TracedLine, fused: TracedLine, line: TracedLine, judge: Callable[[TracedLine], float]) -> bool:
    """Return whether a fused line that goes on by much stands out much less than one of its two parts."""
    if made.length < fused.length + _GOES_ON * line.factor:
        return False
    return judge(made) < _STILL_OUT * max(judge(fused), judge(line))


def _is_beside(line: TracedLine, other: TracedLine, tree: cKDTree, near: float, share: float) -> bool:
    reach = near * max(line.factor, other.factor)
    if not _may_run_alike(line, other, reach):
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
    lines: list[TracedLine],
    *,
    near: float,
    judge: Callable[[TracedLine], float] | None = None,
) -> list[TracedLine]:
    """Drop lines beside a stronger one that are nearer than the regional surface can follow: their own side lobes.

    Parameters
    ----------
    lines : list of TracedLine
    near : float
        Distance in cells of the coarser line's level.
    judge : callable, optional
        How far a line stands out, which then is what makes it stronger.
    """
    kept: list[TracedLine] = []
    for line in sorted(lines, key=lambda one: -(one.strength if judge is None else judge(one))):
        if not runs_beside(line, kept, near=near):
            kept.append(line)
    return kept


def runs_beside(line: TracedLine, others: list[TracedLine], *, near: float, share: float = 0.6) -> bool:
    """Return whether a share of a line runs beside one of the others, nearer than `near` cells of the coarser level."""
    return any(_is_beside(line, one, cKDTree(one.places), near, share) for one in others)


def part_from(line: TracedLine, others: list[TracedLine], *, near: float) -> TracedLine:
    """Return the longest part of a line that does not run beside others: what it shares with them is theirs.

    Parameters
    ----------
    line : TracedLine
    others : list of TracedLine
    near : float
        Distance in cells of the coarser line's level.
    """
    for other in others:
        line = _apart(line, other, near)
    return line


def _apart(line: TracedLine, other: TracedLine, near: float) -> TracedLine:
    """Return the longest part of a line that does not run beside another, where they run alike."""
    reach = near * max(line.factor, other.factor)
    if not _may_run_alike(line, other, reach):
        return line
    distance, _ = cKDTree(other.places).query(line.places, distance_upper_bound=reach)
    free = np.flatnonzero(np.isinf(distance))
    if len(free) in (0, len(line.places)):
        return line
    runs = np.split(free, np.flatnonzero(np.diff(free) > 1) + 1)
    longest = max(runs, key=len)
    return TracedLine(line.places[longest], line.score[longest], line.kind, line.factor)


def _may_run_alike(line: TracedLine, other: TracedLine, reach: float) -> bool:
    """Return whether two lines have about one direction, and the boxes around them come within reach of each other."""
    return _boxes_meet(line.places, other.places, reach) and bool(abs(_way(line) @ _way(other)) > _LEAST_COSINE)


def _boxes_meet(first: Float64Array, second: Float64Array, reach: float) -> bool:
    return bool(
        (first.min(axis=0) - reach <= second.max(axis=0)).all()
        and (second.min(axis=0) - reach <= first.max(axis=0)).all()
    )


def _way(line: TracedLine) -> Float64Array:
    way = line.places[-1] - line.places[0]
    return np.asarray(way / max(float(np.hypot(*way)), 1e-9))
