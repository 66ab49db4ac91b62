"""The choice among traced lines: fused, joined, placed, and kept where they stand out and water or terraces did not."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.terrain.assembling import assemble_lines, straight_over
from seismo3d.terrain.contours import follows_contour
from seismo3d.terrain.evidence import REGION, SCALE, TerrainEvidence
from seismo3d.terrain.joining import drop_echoes, part_from, runs_beside
from seismo3d.terrain.offsets import parts_even_ground
from seismo3d.terrain.placing import snap_line
from seismo3d.terrain.prominence import judge_by
from seismo3d.terrain.support import LineSupport
from seismo3d.terrain.tracing import TracedLine
from seismo3d.terrain.valleys import is_valley

if TYPE_CHECKING:
    from seismo3d.terrain.lineament_search import LineamentSettings

_OWN_LOBES = REGION * SCALE + SCALE
"""Cells aside within which the regional surface answers to a line with two of the other sign."""


def choose_lines(
    pieces: list[TracedLine],
    valleys: list[TracedLine],
    supports: list[LineSupport],
    filled: Float64Array,
    levels: list[TerrainEvidence],
    settings: LineamentSettings,
) -> list[tuple[TracedLine, float]]:
    """Fuse and join pieces, bring them to the crest, and keep long, significant lines with their prominence.

    Parameters
    ----------
    pieces : list of TracedLine
        Of all levels and kinds, that do not run along the slope.
    valleys : list of TracedLine
        From :func:`seismo3d.terrain.valleys.find_valleys`.
    supports : list of LineSupport
        Of the finest level.
    filled : ndarray of shape (rows, columns), float64
        Elevation without holes, in cells.
    levels : list of TerrainEvidence
    settings : LineamentSettings

    Returns
    -------
    list of (TracedLine, float)
        Most significant first.
    """
    judge = _judge_by_kind(levels, settings)
    lines = assemble_lines(
        pieces, _crest(supports), score=np.maximum.reduce([support.score for support in supports]), judge=judge,
        goes_on=lambda line: line.length >= 2.0 * settings.length and _stands_out(line, judge(line), settings),
        settings=settings,
    )  # fmt: skip
    lines = _placed(lines, supports, settings, judge)
    lines = drop_echoes(lines, near=_OWN_LOBES, judge=judge)
    is_good = _make_test(filled, settings, judge)
    lines = list(filter(is_good, lines))
    # a valley is a part of a line that goes on beyond it
    valleys = [
        one for one in valleys if not runs_beside(one, [o for o in lines if o.length > one.length], near=_OWN_LOBES)
    ]
    kept: list[TracedLine] = []
    for line in sorted(lines + valleys, key=lambda one: -judge(one) * np.sqrt(one.length)):
        # a weaker line that leaves a stronger one must stand out where it is alone
        rest = part_from(line, kept, near=_OWN_LOBES)
        if is_good(rest) and not runs_beside(rest, kept, near=_OWN_LOBES):
            kept.append(rest)
    return sorted(((line, judge(line)) for line in kept), key=lambda pair: -pair[0].strength)


def _judge_by_kind(levels: list[TerrainEvidence], settings: LineamentSettings) -> Callable[[TracedLine], float]:
    """Return what tells how far a line stands out, on the levels that lines of its kind are looked for."""
    of_valleys, of_others = judge_by(levels[: settings.n_valley_levels]), judge_by(levels[: settings.n_levels])
    return lambda line: of_valleys(line) if line.kind == "valley" else of_others(line)


def _make_test(
    filled: Float64Array, settings: LineamentSettings, judge: Callable[[TracedLine], float]
) -> Callable[[TracedLine], bool]:
    """Return the test of whether a line is long, stands out, and is neither water's nor the edge of a terrace."""
    slope = regional_slope(filled, 0.5 * settings.length)
    ground = ndimage.gaussian_filter(filled, SCALE)

    def is_good(line: TracedLine) -> bool:
        if line.kind == "valley":
            return is_valley(line, judge(line), filled, settings)
        return (
            line.length >= settings.least_length * settings.length
            and line.strength >= settings.least_strength
            and _stands_out(line, judge(line), settings)
            and is_not_drained(line, filled, slope, settings)
            and not follows_contour(ground, line.places)
        )

    return is_good


def _stands_out(line: TracedLine, prominence: float, settings: LineamentSettings) -> bool:
    shortest = settings.least_length * settings.length
    return prominence * float(np.sqrt(line.length / shortest)) >= settings.least_prominence


def _placed(
    lines: list[TracedLine],
    supports: list[LineSupport],
    settings: LineamentSettings,
    judge: Callable[[TracedLine], float],
) -> list[TracedLine]:
    """Return lines brought to the scarp's middle, or to the hollow at its foot where only there they stand out."""
    middle, foot = (_crest(supports, trough=weight) for weight in (0.5, 1.0))
    out = []
    for line in lines:
        stiffness, reach = straight_over(line, settings), 3.0 * settings.near
        made = snap_line(line, middle, stiffness=stiffness, reach=reach)
        if not _stands_out(made, judge(made), settings):
            other = snap_line(line, foot, stiffness=stiffness, reach=reach)
            made = other if judge(other) > judge(made) else made
        out.append(made)
    return out


def _crest(supports: list[LineSupport], *, trough: float | None = None) -> Float32Array:
    """Return where a line belongs: by score, or by contrast as well with a weight for troughs beside steps."""
    step, hollow = (next(one for one in supports if one.kind == kind) for kind in ("step", "trough"))
    if trough is None:
        parts, blur = [step.score, hollow.score], 2.0 * SCALE
    else:
        # a certain line's score is flat across it: there the contrast tells where it is; a scarp wears about its
        # middle, which stays on the fault, and the hollow at its foot lies aside
        parts, blur = [step.score * step.contrast, trough * hollow.score * hollow.contrast], SCALE
    return np.asarray(sum(ndimage.gaussian_filter(part, blur) for part in parts), np.float32)


def regional_slope(filled: Float64Array, width: float) -> tuple[Float64Array, Float64Array]:
    """Return the slope along rows and columns of the map smoothed by a Gaussian of a width in cells."""
    smooth = ndimage.gaussian_filter(filled, width, mode="nearest")
    along_rows, along_columns = np.gradient(smooth)
    return np.asarray(along_rows), np.asarray(along_columns)


def is_not_drained(
    line: TracedLine, filled: Float64Array, slope: tuple[Float64Array, Float64Array], settings: LineamentSettings
) -> bool:
    """Return whether a line does not run along the slope around it, or is a step that water does not make."""
    if share_along(line.places, slope) < settings.drainage:
        return True
    return line.kind != "trough" and parts_even_ground(filled, line.places)


def share_along(places: Float64Array, slope: tuple[Float64Array, Float64Array]) -> float:
    """Return which share of the slope at a line's places (row, column) runs along it, 0 to 1."""
    way = np.gradient(places, axis=0)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    g = np.stack([ndimage.map_coordinates(part, places.T, order=1, mode="nearest") for part in slope], axis=1)
    return float(np.abs((g * way).sum(axis=1)).sum() / max(np.linalg.norm(g, axis=1).sum(), 1e-12))
