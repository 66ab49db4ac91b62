"""Traced pieces made into whole lines: joined, fused, brought to the crest of their evidence, and carried on."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from seismo3d._typing import Float32Array
from seismo3d.terrain.evidence import SCALE
from seismo3d.terrain.extending import extend_line
from seismo3d.terrain.joining import fuse_lines, join_lines
from seismo3d.terrain.placing import snap_line
from seismo3d.terrain.tracing import TracedLine

if TYPE_CHECKING:
    from seismo3d.terrain.lineament_search import LineamentSettings


def assemble_lines(
    pieces: list[TracedLine],
    crest: Float32Array,
    *,
    score: Float32Array,
    judge: Callable[[TracedLine], float],
    goes_on: Callable[[TracedLine], bool],
    settings: LineamentSettings,
) -> list[TracedLine]:
    """Make lines of pieces, each as long as it stands out.

    Parameters
    ----------
    pieces : list of TracedLine
        Of all levels.
    crest : ndarray of shape (rows, columns), float32
        Of the finest level: where a line belongs.
    score : ndarray of that shape, float32
        Evidence that places get where a line is carried on.
    judge : callable
        How far a line stands out.
    goes_on : callable
        Whether a line is carried on at its ends.
    settings : LineamentSettings
    """
    gap = settings.gap * settings.length
    lines = fuse_lines(join_lines(pieces, gap=0.5 * gap), near=settings.near, judge=judge)
    lines = join_lines(lines, gap=gap, judge=judge)
    # on the crest, pieces of other levels and kinds that looked apart come together
    lines = [snap_line(line, crest, stiffness=SCALE, reach=settings.near) for line in lines]
    lines = [
        extend_line(line, crest, score, window=settings.length, reach=1.5 * settings.near, judge=judge)
        if goes_on(line)
        else line
        for line in lines
    ]
    return join_lines(fuse_lines(lines, near=settings.near, judge=judge), gap=gap, judge=judge)


def straight_over(line: TracedLine, settings: LineamentSettings) -> float:
    """Return over how many cells the line that is reported is straight: two windows, or an eighth of its length."""
    return max(2.0 * settings.length, line.length / 8.0)
