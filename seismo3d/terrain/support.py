"""Support of straight lines: how steadily the evidence keeps its sign and size along the best strike of each cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d.terrain._kernels_lines import keep_best_line
from seismo3d.terrain.evidence import SCALE, TerrainEvidence

STRIDE = 2
"""Cells between the values that a line's mean is taken of: the evidence is smooth over them."""


@dataclass(frozen=True, slots=True, eq=False)
class LineSupport:
    """The best line through every cell, at one level.

    Attributes
    ----------
    factor : int
        Cells of the map in a cell of the level.
    score : ndarray of shape (rows, columns), float32
        Means of step and trough along the line over their standard errors, joined; 0 where nothing is known.
    step, trough : ndarray of that shape, float32
        The means over the steepness around; a step is positive up the normal of the strike, a trough where hollow.
    orientation : ndarray of that shape, int16
        Row of `normals`.
    normals : ndarray of shape (m, 2), float64
        Unit normals (row, column) of the strikes.
    """

    factor: int
    score: Float32Array
    step: Float32Array
    trough: Float32Array
    orientation: np.ndarray
    normals: Float64Array

    @property
    def contrast(self) -> Float32Array:
        """The larger of step, in size, and trough."""
        return np.maximum(np.abs(self.step), self.trough)


def scan_lines(evidence: TerrainEvidence, *, length: float, n_strikes: int, floor: float) -> LineSupport:
    """Scan lines of all strikes for steps and troughs that keep their sign and size along them.

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
    best, step, trough = (np.zeros(shape, np.float32) for _ in range(3))
    arg = np.zeros(shape, np.int16)
    for code, (across, shear, normal) in enumerate(strikes):
        given = (*_directed(evidence, normal), evidence.known, least)
        kept = (best, step, trough, arg)
        if across == 1:
            given, kept = tuple(np.ascontiguousarray(a.T) for a in given), tuple(a.T for a in kept)
        one, two, known, low = given
        keep_best_line(one, two, known, shear, taps, STRIDE, n_free, low, np.int16(code), *kept)
    around = np.maximum(evidence.steepness, 1e-6)
    normals = np.array([normal for _, _, normal in strikes])
    return LineSupport(evidence.factor, np.sqrt(best), step / around, trough / around, arg, normals)


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
