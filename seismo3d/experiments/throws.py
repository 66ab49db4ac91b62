"""Benchmark of throws and slip on synthetic cubes: ``python -m seismo3d.experiments.throws``.

Faults are traced at default settings; at every voxel found, within two voxels of a true one, throw and slip are
compared with those of the fault when it moved, and with what lies apart today.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import Float64Array, IntArray
from seismo3d.errors import ParameterError
from seismo3d.experiments._command import run_command
from seismo3d.experiments.faults import SUITE_KINDS, SUITE_SEEDS
from seismo3d.synthetic import SyntheticCube, fault_cube
from seismo3d.synthetic.cutoffs import present_slip

KINDS = tuple(kind for kind in SUITE_KINDS if kind not in ("fault_free", "channels"))
# voxels from the truth, and samples and degrees off it, within which voxel, throw and slip are right
_NEAR, _THROW, _ANGLE_DEG = 2.0, 1.5, 15.0


@dataclass(frozen=True, slots=True)
class SlipScore:
    """Scores of one cube.

    Attributes
    ----------
    kind, seed : str, int
        The cube.
    n : int
        Voxels compared.
    throw, throw_today : float
        Share of them with a throw within 1.5 samples of that of the fault when it moved, and of what lies apart today.
    direction : float
        Share of them with a slip within 15 degrees of the true one, in index units.
    reverse : float
        The same of those on reverse faults; NaN where there are none.
    sense : float
        Share of them whose throw has the true sign.
    straight : float
        What ``direction`` would be, had every fault slipped straight down its dip.
    """

    kind: str
    seed: int
    n: int
    throw: float
    throw_today: float
    direction: float
    reverse: float
    sense: float
    straight: float


def angle_deg(found: Float64Array, true: Float64Array) -> Float64Array:
    """Angles between the rows of two arrays of vectors, in degrees.

    Examples
    --------
    >>> import numpy as np
    >>> float(angle_deg(np.array([[1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 1.0]]))[0].round(6))
    45.0
    """
    lengths = np.linalg.norm(found, axis=1) * np.linalg.norm(true, axis=1)
    cosine = (found * true).sum(axis=1) / np.maximum(lengths, 1e-12)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def score_slip(cube: SyntheticCube, faults: Any) -> SlipScore:
    """Compare the slip of traced faults with a cube's own.

    Parameters
    ----------
    cube : SyntheticCube
        A cube and its truth.
    faults : FaultSet
        Faults traced in it.

    Returns
    -------
    SlipScore
        With the cube's seed and no kind.
    """
    labels, throw = np.asarray(faults.labels), np.asarray(faults.throw)
    true = np.argwhere(cube.faults > 0)
    called = np.argwhere((labels > 0) & np.isfinite(throw))
    if not (len(true) and len(called)):
        raise ParameterError("there is no fault in the cube, or none was found. Give a cube with faults.")
    distance, nearest = (np.asarray(a) for a in cKDTree(true).query(called, distance_upper_bound=_NEAR + 1e-6))
    near = np.isfinite(distance)
    called, index = called[near], nearest[near]
    at, there = tuple(called.T), tuple(true[index].T)
    slip = cube.slip[index].astype(np.float64)
    found, straight = _slip_at(faults, called, labels[at])
    sign = np.sign(throw[at])[:, None]
    right = angle_deg(found * sign, slip) <= _ANGLE_DEG
    reverse = slip[:, 2] < 0
    today = present_slip(cube)[there][:, 2]
    known = np.isfinite(today)
    return SlipScore(
        "",
        cube.seed,
        len(called),
        float((np.abs(throw[at] - slip[:, 2]) <= _THROW).mean()),
        float((np.abs(throw[at] - today)[known] <= _THROW).mean()) if known.any() else np.nan,
        float(right.mean()),
        float(right[reverse].mean()) if reverse.any() else np.nan,
        float((throw[at] * slip[:, 2] > 0).mean()),
        float((angle_deg(straight * sign, slip) <= _ANGLE_DEG).mean()),
    )


def _slip_at(faults: Any, voxels: Any, labels: Any) -> tuple[Float64Array, Float64Array]:
    """Slip for a throw of one at voxels of surfaces, from each surface's nearest vertex: as found, and down the dip."""
    found, straight = np.zeros((len(voxels), 3)), np.zeros((len(voxels), 3))
    for number in np.unique(labels):
        surface, mine = faults.surfaces[number - 1], labels == number
        near: IntArray = np.asarray(cKDTree(surface.vertices).query(voxels[mine])[1])
        normals = surface.normals[near].astype(np.float64)
        run = np.maximum((normals[:, :2] ** 2).sum(axis=1), 1e-3)
        down = normals[:, :2] * (-normals[:, 2] / run)[:, None]
        along = np.column_stack([normals[:, 1], -normals[:, 0]]) / np.sqrt(run)[:, None]
        ones = np.ones((len(normals), 1))
        straight[mine] = np.hstack([down, ones])
        found[mine] = np.hstack([down + surface.strike_share * along, ones])
    return found, straight


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cubes and print one line each, and one a kind.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line; the process's own if not given.
    """
    import seismo3d

    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.throws", description=__doc__.split("\n")[0])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS, metavar="KIND")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SUITE_SEEDS), help="seeds of the cubes")
    parser.add_argument("--shape", type=int, default=128, help="samples along each side")
    options = parser.parse_args(arguments)
    print(
        "kind seed | voxels | throw within 1.5, of today's | slip within 15 deg, reverse, sign | straight down the dip"
    )
    for kind in options.kinds:
        scores = []
        for seed in options.seeds:
            cube = fault_cube(kind, seed=seed, shape=(options.shape,) * 3)
            scores.append(score_slip(cube, seismo3d.trace_faults(cube.seismic)))
            print(_line(f"{kind:12s} {seed:4d}", [scores[-1]]), flush=True)
        print(_line(f"{kind:12s} mean", scores), flush=True)


def _line(name: str, scores: Sequence[SlipScore]) -> str:
    def mean(attribute: str) -> str:
        values = np.array([getattr(score, attribute) for score in scores], float)
        return f"{np.nanmean(values):.3f}" if np.isfinite(values).any() else "-"

    n = sum(score.n for score in scores)
    throw, slip = ("throw", "throw_today"), ("direction", "reverse", "sense")
    parts = (" ".join(mean(a) for a in group) for group in (throw, slip, ("straight",)))
    return f"{name} | {n:6d} | " + " | ".join(parts)


if __name__ == "__main__":
    run_command(main)
