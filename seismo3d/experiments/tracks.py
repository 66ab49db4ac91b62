"""Benchmark of layer time and tracks on synthetic cubes: ``python -m seismo3d.experiments.tracks``.

Faults are traced at default settings, as a user would, and the tracks follow from one seed each: the point of the true
horizon that is nearest to the cube's middle among those a few traces off its gaps.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.optimize import isotonic_regression

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import Seismo3dWarning
from seismo3d.experiments._command import run_command
from seismo3d.experiments.faults import reference_seconds
from seismo3d.synthetic import SyntheticCube, fault_cube

KINDS = ("clean", "folded", "crossing")
# error of the truth made increasing below which a trace grew before
_GROWING = 0.05


@dataclass(frozen=True, slots=True)
class TrackResult:
    """Scores of one cube.

    Attributes
    ----------
    kind, seed : str, int
        The cube.
    layer_rms : float
        Root mean square error of the layer time, in samples of depth, after one monotone fit for the whole cube: the
        median over the traces.
    layer_within : float
        Share of traces where it is 1 sample or less.
    floor : float
        The same median for the truth made increasing: what reverse faults, which lay old layers on young ones, cost.
    growing_rms : float
        The error's median over the traces that no reverse fault crosses: true layer time grows down them. NaN if none.
    within : tuple of float
        For each horizon, the share of its true area on which the track lies within 1 sample of it.
    traced : tuple of float
        Share of its true area that was traced.
    seconds, ratio : float
        Time of the layer time and all tracks, and the same over that of ``gaussian_filter(cube, 4)``.
    """

    kind: str
    seed: int
    layer_rms: float
    layer_within: float
    floor: float
    growing_rms: float
    within: tuple[float, ...]
    traced: tuple[float, ...]
    seconds: float
    ratio: float


def layer_errors(found: AnyArray, truth: AnyArray) -> Float64Array:
    """Root mean square error of each trace, in samples of depth, after one monotone fit for the whole cube.

    At every sample the depth at which the trace has the true layer time is compared with the sample's own; layer times
    that the trace does not reach are left out.
    """
    fitted = _fit_monotone(found, truth)
    samples = np.arange(found.shape[2])
    errors = np.full(found.shape[:2], np.nan)
    for i, j in np.ndindex(*errors.shape):
        row = np.maximum.accumulate(fitted[i, j]) + 1e-6 * samples
        inside = (truth[i, j] >= row[0]) & (truth[i, j] <= row[-1])
        if inside.any():
            depth = np.interp(truth[i, j][inside], row, samples)
            errors[i, j] = np.sqrt(np.mean((depth - samples[inside]) ** 2))
    return errors


def _fit_monotone(found: AnyArray, truth: AnyArray) -> Float64Array:
    """Carry found times to true ones by one growing function: the medians of bins, made increasing."""
    bins = np.array_split(np.argsort(found.ravel()), 300)
    x = np.array([np.median(found.ravel()[b]) for b in bins]) + 1e-6 * np.arange(len(bins))
    y = isotonic_regression([np.median(truth.ravel()[b]) for b in bins]).x
    slope = (y[-1] - y[0]) / (x[-1] - x[0])
    beyond = np.minimum(found - x[0], 0.0) + np.maximum(found - x[-1], 0.0)
    return np.asarray(np.interp(found, x, y) + slope * beyond)


def choose_seed(horizon: AnyArray) -> tuple[int, int, float] | None:
    """Point of a true horizon near the middle, off its gaps; None where the horizon is hardly there."""
    known = np.isfinite(horizon)
    if known.mean() < 0.2:
        return None
    inner = distance_transform_edt(np.pad(known, 1))[1:-1, 1:-1]
    places = np.argwhere(inner >= min(6.0, inner.max()))
    i, j = places[np.abs(places - np.array(known.shape) / 2).sum(axis=1).argmin()]
    return int(i), int(j), float(horizon[i, j])


def run_cube(kind: str, seed: int, *, shape: tuple[int, int, int] = (128, 128, 128)) -> TrackResult:
    """Make a cube, trace its faults, layer time and horizons, and score them.

    Parameters
    ----------
    kind : str
        Kind of the cube.
    seed : int
        Its seed.
    shape : tuple of int
        Its size.

    Returns
    -------
    TrackResult
    """
    import seismo3d
    from seismo3d.seismic._kernels_layers import make_increasing
    from seismo3d.seismic.layer_time import model_layers

    cube: SyntheticCube = fault_cube(kind, seed=seed, shape=shape)
    faults: Any = seismo3d.trace_faults(cube.seismic)
    reference = reference_seconds(cube.seismic)
    horizons = [(h, s) for h in cube.horizons if (s := choose_seed(h)) is not None]
    start = time.perf_counter()
    layers = model_layers(cube.seismic, faults=faults)
    with warnings.catch_warnings():
        # seeds that are held alone show in the scores
        warnings.simplefilter("ignore", Seismo3dWarning)
        tracks = seismo3d.trace_tracks(cube.seismic, [s for _, s in horizons], faults=faults, layers=layers)
    seconds = time.perf_counter() - start
    errors = layer_errors(layers.increasing(), cube.layer_time)
    increasing = cube.layer_time.copy()
    make_increasing(increasing, 1e-3)
    floors = layer_errors(increasing, cube.layer_time)
    growing = errors[floors < _GROWING]
    known = [np.isfinite(h) for h, _ in horizons]
    return TrackResult(
        kind,
        seed,
        float(np.nanmedian(errors)),
        float(np.mean(errors <= 1.0)),
        float(np.nanmedian(floors)),
        float(np.nanmedian(growing)) if growing.size else np.nan,
        tuple(float((np.abs(t.depth - h) <= 1.0)[k].mean()) for t, (h, _), k in zip(tracks, horizons, known)),
        tuple(float(np.isfinite(t.depth)[k].mean()) for t, k in zip(tracks, known)),
        seconds,
        seconds / reference,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cubes and print one line each.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line; the process's own if not given.
    """
    parser = argparse.ArgumentParser(prog="python -m seismo3d.experiments.tracks", description=__doc__.split("\n")[0])
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), metavar="KIND")
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102, 103], help="seeds of the cubes")
    parser.add_argument("--shape", type=int, default=128, help="samples along each side")
    options = parser.parse_args(arguments)
    run_cube("clean", 0, shape=(32, 32, 48))  # compiles, or loads what was compiled
    print(
        "kind seed | layer time: rms, traces within 1, floor, where it grows | tracks: area within 1, traced | s, ratio"
    )
    for kind in options.kinds:
        for seed in options.seeds:
            r = run_cube(kind, seed, shape=(options.shape,) * 3)
            within, traced = np.mean(r.within), np.mean(r.traced)
            each = ", ".join(f"{w:.2f}" for w in r.within)
            print(
                f"{kind:9s} {seed} | {r.layer_rms:.2f} {r.layer_within:.2f} {r.floor:.2f} {r.growing_rms:.2f} | "
                f"{within:.3f} ({each}) {traced:.3f} | {r.seconds:.1f} {r.ratio:.0f}",
                flush=True,
            )


if __name__ == "__main__":
    run_command(main)
