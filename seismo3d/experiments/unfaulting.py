"""Benchmark of unfaulting on synthetic cubes: ``python -m seismo3d.experiments.unfaulting``.

Faults are traced at default settings, as a user would, and taken out. Around every place of a fault, amplitudes are
read along the fault on both sides, four traces off it, and correlated; the same is done on the same surface moved off
all faults. Where the slip is gone, both agree. Nearer to a fault they cannot: the wavelet, which sees the faulted
layers, mixes both sides over half its length above and below it. How far that goes even four traces off is told by the
exact inverse of the motions that made the cube, measured beside it in the same way on the same surfaces.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.experiments._command import run_command
from seismo3d.synthetic import SyntheticCube, exact_displacement, fault_cube, places_before

KINDS = ("clean", "folded", "noise", "small_throws", "crossing", "low_dips")
# samples of a correlated window above and below its place, and traces off the fault where it is taken
_HALF = 10
_CLEAR = 4.0
# how far off a surface, on the side of the hanging wall, it is told where it lay
_ASIDE = 1.5


@dataclass(frozen=True, slots=True)
class UnfaultResult:
    """Correlations of one cube.

    Attributes
    ----------
    kind, seed : str, int
        The cube.
    before, after : float
        Mean correlation of the two sides of the faults, in the cube and in the unfaulted one.
    off : float
        The same off the faults, in the unfaulted cube.
    exact, exact_off : float
        Across the faults and off them where the cube is unfaulted by the exact inverse of what made it.
    missing : float
        Root mean square of what is missing of the slip, in samples.
    seconds : float
        Time of unfaulting, without tracing.
    """

    kind: str
    seed: int
    before: float
    after: float
    off: float
    exact: float
    exact_off: float
    missing: float
    seconds: float


def correlate_sides(volume: AnyArray, points: Float64Array, normals: Float64Array) -> Float64Array:
    """Correlate the two sides of a surface around each of its points.

    Parameters
    ----------
    volume : ndarray of shape (inline, crossline, sample)
        Amplitudes; 0 where there are none.
    points, normals : ndarray of shape (n, 3)
        Points of the surface and its unit normals.

    Returns
    -------
    ndarray of shape (n,), float64
        Correlation coefficients over 21 samples down the surface; NaN where a side leaves the cube or has no data.
    """
    flat = normals[:, :2]
    down = np.column_stack([flat * (-normals[:, 2:] / np.maximum((flat**2).sum(axis=1, keepdims=True), 1e-3)),
                            np.ones(len(flat))])  # fmt: skip
    across = np.column_stack([flat / np.linalg.norm(flat, axis=1, keepdims=True), np.zeros(len(flat))])
    lines = points[:, None] + np.arange(-_HALF, _HALF + 1.0)[None, :, None] * down[:, None]
    sides = []
    for sign in (-_CLEAR, _CLEAR):
        at = (lines + sign * across[:, None]).transpose(2, 0, 1)
        far = np.array(volume.shape)[:, None, None] - 1
        known = ((at >= 0) & (at <= far)).all(axis=0)
        values = ndimage.map_coordinates(volume, at, order=1, mode="nearest")
        sides.append(np.where(known & (values != 0.0), values, np.nan))
    a, b = (side - side.mean(axis=1, keepdims=True) for side in sides)
    return np.asarray((a * b).sum(axis=1) / np.sqrt((a**2).sum(axis=1) * (b**2).sum(axis=1)))


def measure(volume: AnyArray, points: Sequence[Float64Array], normals: Sequence[Float64Array]) -> tuple[float, float]:
    """Mean correlation across surfaces, and across the same surfaces moved aside to where no fault is near."""
    tree = cKDTree(np.concatenate(list(points)))
    on, off = [], []
    for place, normal in zip(points, normals, strict=True):
        on.append(correlate_sides(volume, place, normal))
        across = np.column_stack([normal[:, :2], np.zeros(len(normal))])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        for move in (-24.0, -18.0, -12.0, 12.0, 18.0, 24.0):
            moved = place + move * across
            far = np.asarray(tree.query(moved)[0]) > 9.0
            off.append(correlate_sides(volume, moved[far], normal[far]))
    return float(np.nanmean(np.concatenate(on))), float(np.nanmean(np.concatenate(off)))


def run_cube(
    kind: str, seed: int, *, shape: tuple[int, int, int] = (128, 128, 128), faults: Any = None
) -> UnfaultResult:
    """Make a cube, trace its faults (unless they are given), take them out, and correlate.

    Parameters
    ----------
    kind : str
        Kind of the cube.
    seed : int
        Its seed.
    shape : tuple of int
        Its size.
    faults : FaultSet, optional
        Its faults.

    Returns
    -------
    UnfaultResult
    """
    import seismo3d
    from seismo3d.seismic.displacements import carry_amplitudes
    from seismo3d.seismic.unfaulting import UnfaultSettings, find_slip_field, is_taken_out

    cube = fault_cube(kind, seed=seed, shape=shape)
    found: Any = seismo3d.trace_faults(cube.seismic) if faults is None else faults
    start = time.perf_counter()
    field = find_slip_field(found)
    unfaulted = carry_amplitudes(cube.seismic, field.displacement)
    seconds = time.perf_counter() - start
    moved = [n for n, surface in enumerate(found.surfaces) if is_taken_out(surface, UnfaultSettings())]
    normals = [found.surfaces[n].normals.astype(np.float64) for n in moved]
    places = [field.surfaces[n] for n in moved]
    today = [(found.surfaces[n].vertices.astype(np.float64), normal) for n, normal in zip(moved, normals, strict=True)]
    before = measure(cube.seismic, *zip(*today, strict=True))[0]
    after, off = measure(unfaulted, places, normals)
    return UnfaultResult(kind, seed, before, after, off, *_measure_exact(cube, today), field.missing, seconds)


def _measure_exact(cube: SyntheticCube, today: Sequence[tuple[Float64Array, Float64Array]]) -> tuple[float, float]:
    """Mean correlations across surfaces as they lie today, and off them, where the cube is unfaulted exactly."""
    from seismo3d.seismic.displacements import carry_amplitudes

    displacement = exact_displacement(cube)
    exact = carry_amplitudes(cube.seismic, np.nan_to_num(displacement)).copy()
    exact[np.isnan(displacement).any(axis=0)] = 0.0
    # a place on a fault itself lay in two
    places = [places_before(cube, points + _ASIDE * normals) - _ASIDE * normals for points, normals in today]
    return measure(exact, places, [normals for _, normals in today])


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row a cube."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[101, 102, 103])
    parser.add_argument("--size", type=int, default=128)
    given = parser.parse_args(arguments)
    print("kind           seed  before  after    off   exact    off  missing  seconds")
    for kind in given.kinds:
        for seed in given.seeds:
            r = run_cube(kind, seed, shape=(given.size,) * 3)
            row = f"{r.before:6.3f} {r.after:6.3f} {r.off:6.3f}  {r.exact:6.3f} {r.exact_off:6.3f}"
            row += f"  {r.missing:7.3f} {r.seconds:8.1f}"
            print(f"{kind:<14} {seed:4d}  {row}", flush=True)


if __name__ == "__main__":
    run_command(main)
