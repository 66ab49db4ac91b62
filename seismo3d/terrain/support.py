"""Support of straight lines: how steadily the evidence keeps its sign and size along the best strike of each cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.terrain._kernels_lines import keep_best_line
from seismo3d.terrain.evidence import SCALE, TerrainEvidence

KINDS = ("step", "trough", "both")
CERTAIN = 20.0
"""Score that no line exceeds: beyond it, all are certain, and a perfect one must not outweigh its neighbours."""
STRIDE = 2
"""Cells between the values that a line's mean is taken of: the evidence is smooth over them."""


@dataclass(frozen=True, slots=True, eq=False)
class LineSupport:
    """The best line through every cell, for one kind of evidence at one level.

    Attributes
    ----------
    kind : {"step", "trough", "both"}
    factor : int
        Cells of the map in a cell of the level.
    score : ndarray of shape (rows, columns), float32
        Mean along the line over its standard error; 0 where nothing is known.
    contrast : ndarray of that shape, float32
        Size of that mean over the steepness around.
    orientation : ndarray of that shape, int16
        Row of `normals`.
    normals : ndarray of shape (m, 2), float64
        Unit normals (row, column) of the strikes.
    """

    kind: str
    factor: int
    score: Float32Array
    contrast: Float32Array
    orientation: np.ndarray
    normals: Float64Array


def scan_lines(evidence: TerrainEvidence, *, length: float, n_strikes: int, floor: float) -> list[LineSupport]:
    """Scan lines of all strikes for steps, for troughs, and for both together, that keep their sign and size.

    Parameters
    ----------
    evidence : TerrainEvidence
    length : float
        Width of the Gaussian along a line, in cells of the level.
    n_strikes : int
        Strikes in a quarter of the compass.
    floor : float
        Standard error that every mean has at least, as a share of the steepness around: terrain is never exact.
    """
    shape = evidence.known.shape
    taps = _taps(length)
    # values closer than about two widths of the derivatives' window are alike
    n_free = np.float32(length / SCALE)
    least = (floor * evidence.steepness + 1e-6).astype(np.float32)
    strikes = _strikes(n_strikes)
    best, mean = np.zeros((3, *shape), np.float32), np.zeros((3, *shape), np.float32)
    arg = np.zeros((3, *shape), np.int16)
    for code, (across, shear, normal) in enumerate(strikes):
        given: tuple[Any, ...] = (*_directed(evidence, normal), evidence.known, least)
        kept: tuple[Any, ...] = (best, mean, arg)
        if across == 1:
            given = tuple(np.ascontiguousarray(a.T) for a in given)
            kept = tuple(a.transpose(0, 2, 1) for a in kept)
        step, trough, known, low = given
        keep_best_line(step, trough, known, shear, taps, STRIDE, n_free, low, np.int16(code), *kept)
    contrast = np.abs(mean) / np.maximum(evidence.steepness, 1e-6)
    score = (CERTAIN * np.tanh(np.sqrt(best) / CERTAIN)).astype(np.float32)
    normals = np.array([normal for _, _, normal in strikes])
    return [LineSupport(kind, evidence.factor, score[k], contrast[k], arg[k], normals) for k, kind in enumerate(KINDS)]


def _directed(evidence: TerrainEvidence, normal: Float64Array) -> tuple[Float32Array, Float32Array]:
    """Return the slope up the normal, and the curvature across the strike."""
    ny, nx = normal.astype(np.float32)
    hyy, hxy, hxx = evidence.curvature
    step = ny * evidence.slope[0] + nx * evidence.slope[1]
    return step, ny * ny * hyy + np.float32(2.0) * ny * nx * hxy + nx * nx * hxx


def _strikes(n: int) -> list[tuple[int, float, Float64Array]]:
    """Return (axis across, shear, unit normal) of all strikes; the diagonals once."""
    out = []
    for across in (0, 1):
        shears = np.tan(np.linspace(-0.25 * np.pi, 0.25 * np.pi, n + 1))
        for shear in shears if across == 0 else shears[1:-1]:
            normal = np.array([1.0, -shear]) / np.hypot(1.0, shear)
            out.append((across, float(shear), normal if across == 0 else normal[::-1].copy()))
    return out


def _taps(length: float) -> Float32Array:
    half = int(np.ceil(2.5 * length / STRIDE))
    return np.exp(-0.5 * (np.arange(-half, half + 1) * STRIDE / length) ** 2).astype(np.float32)
