"""Tables 2, 3 and 4 of the paper: accuracy of matching under rotation, tilt and scale, and numbers of matches.

Noise of two grey levels is added to both images; a match within three pixels of the truth is correct. The paper states
no more than accuracies; a method that keeps three matches may well have a hundred percent, so that the correct ones
are counted beside them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, Float64Array, Progress
from seismo3d.errors import MissingDependencyError
from seismo3d.experiments.matching_depth import DepthScene, distance_to_truth, load_depth_scenes, turn
from seismo3d.experiments.matching_peers import MatchFunction, opencv_matcher, surf_matcher
from seismo3d.experiments.matching_scenes import (
    Warp,
    add_noise,
    load_photos,
    load_sections,
    project,
    rotation,
    scaling,
    tilt,
    warp_image,
)

N_POINTS = 500
NOISE = 2.0
CORRECT = 3.0

_ROTATIONS = (45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 11.25, 30.0, 56.25, 101.0)
_TILTS = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 45.0, 60.0)
_SCALES = (0.8, 0.9, 1.0, 1.1, 1.2, 0.5, 0.7, 1.5, 2.0)

PAPER: dict[str, dict[str, tuple[int, ...]]] = {
    "table2": {
        "SIFT": (100, 98, 99, 98, 97, 95),
        "SURF": (74, 69, 74, 69, 74, 69),
        "ORB": (87, 85, 83, 86, 85, 87),
        "proposed": (100, 98, 96, 98, 97, 95),
    },
    "table3": {
        "SIFT": (98, 91, 78, 64, 58, 47),
        "SURF": (82, 77, 64, 55, 38, 29),
        "ORB": (96, 84, 77, 61, 58, 54),
        "proposed": (83, 78, 74, 72, 76, 72),
    },
    "table4": {
        "SIFT": (92, 95, 100, 98, 91),
        "SURF": (79, 90, 99, 97, 92),
        "ORB": (78, 79, 90, 83, 89),
        "proposed": (84, 94, 100, 99, 91),
    },
}
"""Accuracies that the paper prints, in percent, for its own columns: the first of each table here."""


@dataclass(frozen=True, slots=True)
class Cell:
    """Matches kept and correct ones, summed over images."""

    n_images: int
    kept: int
    correct: int

    @property
    def accuracy(self) -> float:
        """Share of correct ones among those kept, percent; NaN where none were."""
        return 100.0 * self.correct / self.kept if self.kept else float("nan")

    def __add__(self, other: Cell) -> Cell:
        return Cell(self.n_images + other.n_images, self.kept + other.kept, self.correct + other.correct)

    @property
    def correct_per_image(self) -> float:
        """Mean number of correct matches."""
        return self.correct / self.n_images


Table = dict[str, dict[str, Cell]]
"""Cells by method, then by column."""


def all_matchers(n_points: int = N_POINTS) -> dict[str, MatchFunction]:
    """Return this package's matcher and its peers by name; SURF only where mahotas is installed."""
    from seismo3d.features.matching import match

    def ours(target: AnyArray, source: AnyArray) -> tuple[Float64Array, Float64Array]:
        found = match(target, source, n_points=n_points)
        return found.points_target, found.points_source

    matchers: dict[str, MatchFunction] = {"seismo3d": ours}
    matchers.update({name: opencv_matcher(name, n_points) for name in ("SIFT", "ORB", "AKAZE")})
    with contextlib.suppress(MissingDependencyError):  # the table says so
        matchers["SURF"] = surf_matcher(n_points)
    return matchers


def measure_planar(
    images: Mapping[str, AnyArray],
    columns: Mapping[str, Warp],
    matchers: Mapping[str, MatchFunction],
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Table:
    """Match every image with its warped self, for every column and method."""
    table: Table = {name: {} for name in matchers}
    for k, (label, warp) in enumerate(columns.items()):
        rng = np.random.default_rng([seed, k])
        pairs = []
        for image in images.values():
            H = warp((image.shape[0], image.shape[1]))
            pairs.append((add_noise(image, NOISE, rng), add_noise(warp_image(image, H), NOISE, rng), H))
        for name, matcher in matchers.items():
            errors = []
            for target, source, H in pairs:
                p, q = matcher(target, source)
                errors.append(np.linalg.norm(project(H, p) - q, axis=1))
            table[name][label] = _cell(errors)
            if progress is not None:
                progress(f"{label}: {name}", 1.0)
    return table


def measure_depth(
    scenes: Sequence[DepthScene],
    angles: Sequence[float],
    matchers: Mapping[str, MatchFunction],
    *,
    seed: int = 0,
    progress: Progress | None = None,
) -> Table:
    """Match every scene with its view from the side, for every angle and method."""
    table: Table = {name: {} for name in matchers}
    for k, angle in enumerate(angles):
        rng = np.random.default_rng([seed, k])
        views = [turn(scene, angle) for scene in scenes]
        pairs = [(add_noise(s.image, NOISE, rng), add_noise(v.image, NOISE, rng)) for s, v in zip(scenes, views)]
        for name, matcher in matchers.items():
            errors = [distance_to_truth(view, *matcher(*pair)) for view, pair in zip(views, pairs)]
            table[name][f"{angle:g}"] = _cell(errors)
            if progress is not None:
                progress(f"{angle:g} degrees in depth: {name}", 1.0)
    return table


def _cell(errors: Sequence[Float64Array]) -> Cell:
    return Cell(len(errors), sum(e.size for e in errors), sum(int((e < CORRECT).sum()) for e in errors))


def format_table(
    title: str, table: Table, paper: Mapping[str, Sequence[int]] | None = None, *, peers: bool = True
) -> str:
    """Write a table as text: accuracy in percent and correct matches an image; say which of all peers is missing."""
    labels = list(next(iter(table.values())))
    lines = [title, f"{'':<16}" + "".join(f"{label:>12}" for label in labels)]
    for name, values in (paper or {}).items():
        lines.append(f"{'paper: ' + name:<16}" + "".join(f"{value:>12d}" for value in values))
    for name, row in table.items():
        cells = (f"{c.accuracy:.1f}/{c.correct_per_image:.0f}" for c in row.values())
        lines.append(f"{name:<16}" + "".join(f"{cell:>12}" for cell in cells))
    if peers and "SURF" not in table:
        lines.append("SURF was not measured: mahotas is not installed (extra: experiments).")
    return "\n".join(lines)


def _planar_report(
    table: str, what: str, columns: dict[str, Warp], n_images: int | None, progress: Progress | None
) -> list[str]:
    matchers = all_matchers()
    parts = []
    for kind, images in (("photographs", load_photos()), ("seismic sections", load_sections())):
        some = dict(list(images.items())[:n_images])
        measured = measure_planar(some, columns, matchers, progress=progress)
        title = f"{what}, {len(some)} {kind}: accuracy in percent / correct matches an image"
        parts.append(format_table(title, measured, PAPER[table]))
    return parts


def table2(*, n_images: int | None = None, progress: Progress | None = None) -> str:
    """Measure table 2, rotation in the plane, with angles that are no multiples of 45 degrees added."""
    columns = {f"{angle:g}": rotation(angle) for angle in _ROTATIONS}
    return "\n\n".join(_planar_report("table2", "Table 2, rotation in degrees", columns, n_images, progress))


def table3(*, n_images: int | None = None, progress: Progress | None = None) -> str:
    """Measure table 3, rotation off the plane: of planes, and of scenes in depth with occlusion."""
    columns = {f"{angle:g}": tilt(angle) for angle in _TILTS}
    parts = _planar_report("table3", "Table 3, tilt of a plane in degrees", columns, n_images, progress)
    matchers, scenes = all_matchers(), load_depth_scenes()[:n_images]
    apart = {scene.name: measure_depth([scene], _TILTS[:6], matchers, progress=progress) for scene in scenes}
    title = f"Table 3, {len(scenes)} scenes in depth turned by degrees: accuracy in percent / correct matches a scene"
    parts.append(format_table(title, pool_tables(list(apart.values())), PAPER["table3"]))
    for name, measured in apart.items():
        both = {method: measured[method] for method in ("seismo3d", "SIFT")}
        parts.append(format_table(f"Table 3, the scene {name} alone", both, peers=False))
    return "\n\n".join(parts)


def pool_tables(tables: Sequence[Table]) -> Table:
    """Add up the cells of tables with the same methods and columns."""
    pooled: Table = {}
    for table in tables:
        for name, row in table.items():
            for label, cell in row.items():
                own = pooled.setdefault(name, {})
                own[label] = own[label] + cell if label in own else cell
    return pooled


def table4(*, n_images: int | None = None, progress: Progress | None = None) -> str:
    """Measure table 4, change of scale, extended to half and double size."""
    columns = {f"{factor:g}": scaling(factor) for factor in _SCALES}
    return "\n\n".join(_planar_report("table4", "Table 4, scale", columns, n_images, progress))


TABLES: dict[str, Callable[..., str]] = {"table2": table2, "table3": table3, "table4": table4}
