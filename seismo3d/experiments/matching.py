"""Measure the matcher, line by line: ``python -m seismo3d.experiments.matching``.

With ``--oxford FOLDER`` (sequences with given homographies) and ``--cubes FILE ...`` (real cubes) it measures those
too.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.experiments import matching_pairs, matching_speed, matching_tables, matching_volumes
from seismo3d.experiments._command import run_command
from seismo3d.experiments.matching_scenes import load_photos, rotation, scaling, tilt

PARTS = ("tables", "oxford", "sections", "volumes", "speed", "unrelated")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure what is asked for, and print it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=PARTS, nargs="+", default=PARTS, help="parts to measure")
    parser.add_argument("--oxford", type=Path, help="folder of image sequences with homographies")
    parser.add_argument("--cubes", type=Path, nargs="*", default=[], help="real cubes: SEG-Y, Zarr, .npy, .npz")
    parser.add_argument("--trials", type=int, default=200, help="displacements of sub-volumes, of each cube")
    parser.add_argument("--images", type=int, default=None, help="use only so many images")
    given = parser.parse_args(arguments)
    cubes = {path.stem: _read_cube(path) for path in given.cubes}
    if "tables" in given.only:
        for table in matching_tables.TABLES.values():
            print(table(n_images=given.images), end="\n\n")
    if "oxford" in given.only and given.oxford is not None:
        print(report_oxford(given.oxford), end="\n\n")
    if "sections" in given.only:
        print(report_sections(cubes), end="\n\n")
    if "volumes" in given.only:
        print(report_volumes(cubes, given.trials), end="\n\n")
    if "speed" in given.only:
        print(report_speed(), end="\n\n")
    if "unrelated" in given.only:
        share = matching_pairs.largest_share_of_unrelated(load_photos(), step=4)
        print(f"unrelated photographs: at most {100 * share:.2f} % of the keypoints matched")


def _read_cube(path: Path) -> AnyArray:
    from seismo3d.io.grids import read_grid

    return np.nan_to_num(read_grid(path))


def report_oxford(folder: Path) -> str:
    """Pairs with given homographies: share within 3 pixels, correct matches, area under the curve of corner errors."""
    pairs = matching_pairs.load_oxford(folder)
    lines = [f"{len(pairs)} pairs with given homographies: % within 3 px, correct a pair, AUC at 1, 3, 5 px"]
    for name, matcher in matching_tables.all_matchers().items():
        score = matching_pairs.score_homographies(pairs, matcher)
        areas = " ".join(f"{a:5.1f}" for a in score.auc)
        lines.append(f"{name:<10} {score.cell.accuracy:5.1f} {score.cell.correct_per_image:6.0f}   {areas}")
    return "\n".join(lines)


def report_sections(cubes: dict[str, AnyArray]) -> str:
    """Inlines some way apart, under known warps."""
    from seismo3d.synthetic import fault_cube

    made = {kind: fault_cube(kind, seed=60, shape=(20, 256, 224)).seismic for kind in ("clean", "folded", "crossing")}
    every = {**made, **cubes}
    matchers = matching_tables.all_matchers()
    lines = [f"inlines of {len(every)} cubes, warped: % within 3 px / correct a pair"]
    warps = {"turned by 10 deg": rotation(10.0), "tilted by 20 deg": tilt(20.0), "scaled by 0.9": scaling(0.9)}
    for gap in (1, 4, 16):
        for label, warp in warps.items():
            cells = matching_pairs.match_sections(every, gap, warp, matchers)
            words = "  ".join(f"{n} {c.accuracy:.1f}/{c.correct_per_image:.0f}" for n, c in cells.items())
            lines.append(f"{gap:>2} apart, {label:<17} {words}")
    return "\n".join(lines)


def report_volumes(cubes: dict[str, AnyArray], n_trials: int) -> str:
    """Sub-volumes displaced by rigid motions of any size, noise at half the signal."""
    groups = {"synthetic": list(matching_volumes.synthetic_trials(n_trials))}
    for name, cube in cubes.items():
        groups[name] = list(matching_volumes.real_trials(name, cube, n_trials))
    lines = [
        "displaced sub-volumes: % of matches within 3 voxels; % of poses within 0.25 deg and 0.15 voxel, 1 deg and 0.5"
    ]
    for name, trials in groups.items():
        precision = 100.0 * sum(t.correct for t in trials) / max(1, sum(t.kept for t in trials))
        fine = 100.0 * matching_volumes.share_within(trials, angle_deg=0.25, shift=0.15)
        coarse = 100.0 * matching_volumes.share_within(trials, angle_deg=1.0, shift=0.5)
        lines.append(f"{name:<22} {len(trials):>4} trials {precision:6.1f} {fine:6.1f} {coarse:6.1f}")
    ratio, n_points = matching_volumes.describing_cost()
    lines.append(f"describing {n_points} points of a 128^3 cube: {ratio:.1f} times gaussian_filter(cube, 4)")
    return "\n".join(lines)


def report_speed() -> str:
    """Time against SIFT and against the windows' radius."""
    ours, sift = matching_speed.time_against_sift()
    lines = [f"640 x 480 pair, 500 points: {1e3 * ours:.0f} ms CPU, SIFT {1e3 * sift:.0f} ms: {ours / sift:.2f} of it"]
    by_radius = matching_speed.time_against_radius()
    words = ", ".join(f"radius {r:g}: {1e3 * s:.0f} ms" for r, s in by_radius.items())
    lines.append(f"16 planes of 640 x 480, sliding window: {words}")
    lines.append(f"peak memory so far: {matching_speed.peak_memory_mb():.0f} MB")
    return "\n".join(lines)


if __name__ == "__main__":
    run_command(main)
