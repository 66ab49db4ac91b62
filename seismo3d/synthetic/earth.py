"""The Earth under a synthetic cube: drawn once, then every voxel is mapped back through its history."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from seismo3d._stages import as_progress
from seismo3d._typing import BoolArray, Float32Array, Float64Array, Int32Array, Progress
from seismo3d.synthetic import _kernels as kernels
from seismo3d.synthetic.bodies import Channel, channel_rows, erosion_rows, sample_channels, sample_layers
from seismo3d.synthetic.faulting import SyntheticFault, fault_rows
from seismo3d.synthetic.folding import Folding, flat_folding, sample_folding
from seismo3d.synthetic.recipes import CubeRecipe
from seismo3d.synthetic.wavelets import ricker_table

_STEPS = 32
"""Entries of the wavelet's table a sample."""


@dataclass(frozen=True, slots=True, eq=False)
class Earth:
    """Structure and layers.

    Attributes
    ----------
    faults, old_faults : ndarray of shape (n, 24), float64
        Faults younger and older than the unconformity, oldest first.
    folding, old_folding : Folding
        Folding of all layers, and of the old ones before they were eroded.
    erosion : ndarray of shape (0 or 1 + n, 7), float64
        The erosion surface.
    offset : float
        What is added to the layer time of the old layers so that they are older than the young ones.
    least_throw : float
        Smallest absolute throw of a fault voxel.
    times, impedance : ndarray, float64
        Layer boundaries and the impedance between them.
    channels : tuple of Channel
        The channels.
    horizon_times : ndarray of shape (k,), float64
        Layer times of the horizons.
    """

    faults: Float64Array
    old_faults: Float64Array
    folding: Folding
    old_folding: Folding
    erosion: Float64Array
    offset: float
    least_throw: float
    times: Float64Array
    impedance: Float64Array
    channels: tuple[Channel, ...]
    horizon_times: Float64Array

    def structure(self) -> tuple[Any, ...]:
        """Return what the compiled loops read of the structure, in their order."""
        new, old = self.folding, self.old_folding
        parts = (self.faults, new.bumps, new.terms, self.erosion, self.old_faults, old.bumps, old.terms)
        return (*parts, float(self.offset), float(self.least_throw))


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Arrays of a noise-free cube; see SyntheticCube."""

    signal: Float32Array
    labels: Int32Array
    throw: Float32Array
    slip: Float32Array
    layer_time: Float32Array
    horizons: Float32Array


def draw_earth(recipe: CubeRecipe, faults: tuple[SyntheticFault, ...], rng: np.random.Generator) -> Earth:
    """Draw folding, erosion, layers and channels under given faults."""
    shape, nothing = recipe.shape, np.zeros(0)
    folding = sample_folding(rng, shape, slope=rng.uniform(*recipe.fold_slope), tilt=rng.uniform(*recipe.tilt))
    old, erosion = flat_folding(), np.zeros((0, 7))
    if recipe.unconformity is not None:
        slope, tilt = rng.uniform(*recipe.old_slope), rng.uniform(*recipe.old_tilt)
        old = sample_folding(rng, shape, slope=slope, tilt=tilt, base=0.8)
        share = rng.uniform(*recipe.unconformity)
        erosion = erosion_rows(rng, shape, share=share, relief=0.03 * shape[2], tilt=0.02)
    buried = fault_rows([fault for fault in faults if fault.buried])
    rest = fault_rows([fault for fault in faults if not fault.buried])
    earth = Earth(rest, buried, folding, old, erosion, 0.0, recipe.least_throw, nothing, nothing, (), nothing)
    times, below = _coarse_layer_times(earth, shape)
    if below.any() and not below.all():
        # Old layers must be older than all young ones everywhere, those between the grid's nodes included.
        earth = replace(earth, offset=max(float(times[~below].max() - times[below].min()) + 0.2 * shape[2], 0.0))
        times, _ = _coarse_layer_times(earth, shape)
    margin = 4.0 * shape[2]
    layers = sample_layers(rng, times.min() - margin, times.max() + margin, spacing=recipe.layer_spacing)
    tops = np.quantile(times, np.linspace(0.1, 0.85, 64))
    channels = recipe.channels + sample_channels(rng, shape, recipe.n_channels, tops)
    wanted = _strong_layers(times, *layers, recipe.n_horizons)
    return replace(earth, times=layers[0], impedance=layers[1], channels=channels, horizon_times=wanted)


def _coarse_layer_times(earth: Earth, shape: tuple[int, int, int]) -> tuple[Float64Array, BoolArray]:
    """Layer time, and whether it lies below the erosion surface, on at most 16 x 16 traces of the cube."""
    run: Any = kernels.trace_structure
    lines = [np.unique(np.linspace(0, n - 1, min(n, 16)).round().astype(int)) for n in shape[:2]]
    n = shape[2]
    times, depths = np.empty((len(lines[0]), len(lines[1]), n)), np.empty((len(lines[0]), len(lines[1]), n))
    spare = (np.empty((n, 2)), np.empty(n, np.int32), np.empty(n), np.empty((n, 3)))
    for row, i in enumerate(lines[0]):
        for column, x in enumerate(lines[1]):
            out = (times[row, column], np.empty(n, np.int64), depths[row, column])
            run(int(i), int(x), 0, *earth.structure(), *out, *spare)
    return times, depths > 0.0


def _strong_layers(times: Float64Array, boundaries: Float64Array, impedance: Float64Array, n: int) -> Float64Array:
    """Layer times of strong boundaries, spread over those that the cube holds."""
    strengths = np.abs(np.diff(impedance))
    limits = np.quantile(times, np.linspace(0.1, 0.9, n + 1))
    wanted = []
    for low, high in pairwise(limits):
        inside = np.flatnonzero((boundaries >= low) & (boundaries < high))
        best = inside[np.argmax(strengths[inside])] if inside.size else np.argmin(np.abs(boundaries - low))
        wanted.append(boundaries[best])
    return np.array(wanted, dtype=np.float64)


def fill_cube(recipe: CubeRecipe, earth: Earth, wavelength: float, inlines: range, progress: Progress | None) -> Truth:
    """Make the arrays of some inlines, one inline a task; the result does not depend on the number of threads."""
    shape = (len(inlines), *recipe.shape[1:])
    signal, tau = np.empty(shape, np.float32), np.empty(shape, np.float32)
    labels, throw = np.empty(shape, np.int32), np.empty(shape, np.float32)
    horizons = np.empty((len(earth.horizon_times), *shape[:2]), np.float32)
    wavelet, channels = ricker_table(1.0 / wavelength, _STEPS), channel_rows(earth.channels)
    first = -int(np.ceil(1.3 * wavelength)) - 1
    run: Any = kernels.slab_structure
    report = as_progress(progress)

    def fill_inline(row: int) -> Float32Array:
        slip = np.empty((*shape[1:], 3))
        layers = (earth.times, earth.impedance, channels, wavelet, _STEPS, earth.horizon_times)
        out = (signal[row], tau[row], labels[row], throw[row], slip, horizons[:, row])
        run(inlines[row], first, shape[2], *earth.structure(), *layers, *out)
        return slip[labels[row] > 0].astype(np.float32)

    slips = []
    with ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1)) as pool:
        for row, slip in enumerate(pool.map(fill_inline, range(len(inlines)))):
            slips.append(slip)
            report("cube", (row + 1) / len(inlines))
    return Truth(signal, labels, throw, np.concatenate(slips), tau, horizons)
