"""All measurements of the registration core, for anyone to run: ``python -m seismo3d.experiments.registration``.

Parts: ``solves`` (random problems of the exact solvers), ``covariance`` (honesty of the covariance), ``degenerate``
(planes, corridors and layers with features), and with data, ``speed`` and ``pairs`` (``--registration FOLDER``) and
``fusion`` (``--rgbd SEQUENCE``).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from seismo3d.experiments import (
    registration_covariance,
    registration_degenerate,
    registration_fusion,
    registration_pairs,
    registration_solves,
    registration_speed,
)
from seismo3d.experiments._command import run_command

PARTS = ("solves", "covariance", "degenerate", "speed", "pairs", "fusion")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts that are asked for and print their figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "parts", nargs="*", choices=[*PARTS, []], help="parts to run; all that have their data by default"
    )
    parser.add_argument("--registration", type=Path, help="folder with pairs of scans")
    parser.add_argument("--rgbd", type=Path, help="RGB-D sequence in the TUM layout with camera.json")
    parser.add_argument("--n", type=int, default=1000, help="random problems a class, repeats")
    parser.add_argument("--n-scale", type=int, help="random problems a class with free scale; a fiftieth by default")
    parser.add_argument("--trials", type=int, default=200, help="perturbed starts a pair")
    parser.add_argument("--frames", type=int, default=20, help="frame pairs a gap")
    given = parser.parse_args(arguments)
    parts = given.parts or PARTS
    if "solves" in parts:
        registration_solves.report(n_problems=given.n, n_scale_problems=given.n_scale or max(given.n // 50, 3))
    if "covariance" in parts:
        registration_covariance.report(n_repeats=given.n)
    if "degenerate" in parts:
        registration_degenerate.report(n_repeats=max(given.n // 20, 5))
    if given.registration is not None and "speed" in parts:
        registration_speed.report(given.registration)
    if given.registration is not None and "pairs" in parts:
        registration_pairs.report(given.registration, n_trials=given.trials)
    if given.rgbd is not None and "fusion" in parts:
        registration_fusion.report(given.rgbd, n_pairs=given.frames)


if __name__ == "__main__":
    run_command(main)
