"""Pairs of real images with known homographies, neighbouring sections, and pairs that have nothing in common."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import FileAccessError
from seismo3d.experiments.matching_peers import MatchFunction
from seismo3d.experiments.matching_scenes import Warp, add_noise, as_grey_levels, project, warp_image
from seismo3d.experiments.matching_tables import CORRECT, NOISE, Cell
from seismo3d.io.grids import read_grid


@dataclass(frozen=True, slots=True, eq=False)
class HomographyPair:
    """Two grey images and the homography from the first to the second, in pixels."""

    name: str
    target: AnyArray
    source: AnyArray
    H: Float64Array


def load_oxford(folder: str | Path, *, longest: int = 640) -> list[HomographyPair]:
    """Read sequences ``NAME/img1.png`` to ``img6.png`` with ``NAME/H1to2p`` and so on, scaled to a longest side."""
    import cv2

    pairs = []
    for first in sorted(Path(folder).glob("*/img1.png")):
        images = [read_grid(first.with_name(f"img{k}.png")) for k in range(1, 7)]
        ratio = longest / max(images[0].shape)
        to_small = np.array([[ratio, 0.0, 0.5 * ratio - 0.5], [0.0, ratio, 0.5 * ratio - 0.5], [0.0, 0.0, 1.0]])
        small = [cv2.resize(i, None, fx=ratio, fy=ratio, interpolation=cv2.INTER_AREA) for i in images]
        for k in range(2, 7):
            H = to_small @ np.loadtxt(first.with_name(f"H1to{k}p")) @ np.linalg.inv(to_small)
            pairs.append(HomographyPair(f"{first.parent.name} 1-{k}", small[0], small[k - 1], H))
    if not pairs:
        raise FileAccessError(f"{folder} holds no NAME/img1.png. Give the folder that holds the sequences.")
    return pairs


@dataclass(frozen=True, slots=True)
class HomographyScore:
    """Matches and the area under the curve of corner errors up to 1, 3 and 5 pixels, percent."""

    cell: Cell
    auc: tuple[float, float, float]


def score_homographies(pairs: Sequence[HomographyPair], matcher: MatchFunction) -> HomographyScore:
    """Match pairs, count what is within three pixels, and fit homographies by RANSAC at three pixels."""
    errors, corners = [], []
    for pair in pairs:
        p, q = matcher(pair.target, pair.source)
        errors.append(np.linalg.norm(project(pair.H, p) - q, axis=1) if len(p) else np.empty(0))
        corners.append(_corner_error(pair, p, q))
    cell = Cell(len(pairs), sum(e.size for e in errors), sum(int((e < CORRECT).sum()) for e in errors))
    return HomographyScore(cell, (_area(corners, 1.0), _area(corners, 3.0), _area(corners, 5.0)))


def _corner_error(pair: HomographyPair, p: Float64Array, q: Float64Array) -> float:
    import cv2

    if len(p) < 4:
        return float("inf")
    H, _ = cv2.findHomography(p, q, cv2.RANSAC, 3.0, maxIters=5000, confidence=0.9999)
    if H is None:
        return float("inf")
    rows, columns = pair.target.shape
    corners = np.array([[0, 0], [columns, 0], [0, rows], [columns, rows]], dtype=float)
    return float(
        np.linalg.norm(project(np.asarray(H, dtype=np.float64), corners) - project(pair.H, corners), axis=1).mean()
    )


def _area(errors: Iterable[float], limit: float) -> float:
    """Area under the share of pairs by error, up to a limit, in percent of the best there can be."""
    values = np.sort(np.asarray(list(errors), dtype=float))
    share = np.arange(1, len(values) + 1) / len(values)
    inside = int(np.searchsorted(values, limit))
    x = np.concatenate([[0.0], values[:inside], [limit]])
    y = np.concatenate([[0.0], share[:inside], [share[inside - 1] if inside else 0.0]])
    return float(100.0 * np.trapezoid(y, x) / limit)


def match_sections(
    cubes: Mapping[str, AnyArray], gap: int, warp: Warp, matchers: Mapping[str, MatchFunction], *, first: int = 1
) -> dict[str, Cell]:
    """Match an inline of each cube with the one ``gap`` further on, warped, both with noise."""
    rng = np.random.default_rng(gap)
    pairs = []
    for cube in cubes.values():
        levels = as_grey_levels(np.asarray(cube[first : first + gap + 1], dtype=np.float32))
        H = warp(levels[0].T.shape)
        pairs.append((add_noise(levels[0].T, NOISE, rng), add_noise(warp_image(levels[-1].T, H), NOISE, rng), H))
    cells = {}
    for name, matcher in matchers.items():
        errors = []
        for target, source, H in pairs:
            p, q = matcher(target, source)
            errors.append(np.linalg.norm(project(H, p) - q, axis=1))
        kept, correct = sum(e.size for e in errors), sum(int((e < CORRECT).sum()) for e in errors)
        cells[name] = Cell(len(pairs), kept, correct)
    return cells


def largest_share_of_unrelated(images: Mapping[str, AnyArray], *, step: int = 1) -> float:
    """Largest share of keypoints matched between images of different things, every ``step``-th pair."""
    from seismo3d.features.matching import match

    shares = [0.0]
    for one, other in list(itertools.combinations(images, 2))[::step]:
        found = match(images[one], images[other])
        shares.append(len(found) / max(1, min(found.n_points)))
    return max(shares)
