"""Planar support: how well the evidence around each voxel lies on a plane, of the best strike and dip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import BoolArray, Float32Array, Progress
from seismo3d.seismic._kernels_filters import gaussian_taps
from seismo3d.seismic._kernels_scan import find_ridges, keep_best_dip, merge_best, sum_strike_lines
from seismo3d.seismic.misfit import Evidence


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """Sizes of the planes and their orientations; the first of a pair holds without noise, the second in noise.

    Attributes
    ----------
    along_strike, along_dip : tuple of (float, float)
        Widths of the Gaussian patch: in traces along strike, in samples down the dip.
    lowest_dip_deg : float
        Dip below which no fault is looked for, in index coordinates.
    n_strikes : int
        Strikes tried in each half of the compass.
    n_dips : tuple of (int, int)
        Dips tried at each strike.
    evenness : float
        0 takes a plane's mean; 1 that of its poorer half, above or below.
    prior_weight : float
        Weight of the background in every mean, against a patch's full weight of 1.
    """

    along_strike: tuple[float, float] = (6.0, 8.0)
    along_dip: tuple[float, float] = (10.0, 12.0)
    lowest_dip_deg: float = 27.0
    n_strikes: int = 8
    n_dips: tuple[int, int] = (21, 21)
    evenness: float = 0.5
    prior_weight: float = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class PlanarSupport:
    """The best plane through every voxel.

    Attributes
    ----------
    score : ndarray of the evidence's shape, float32
        Mean evidence on the best plane, in standard deviations of the cube's evidence above its mean.
    orientation : ndarray of the same shape, int16
        Row of `planes`.
    planes : ndarray of shape (m, 3), float32
        Unit horizontal normal (inline, crossline) and its move per sample down the plane: the cotangent of the dip.
    """

    score: Float32Array
    orientation: np.ndarray
    planes: Float32Array


@dataclass(frozen=True, slots=True, eq=False)
class RidgePoints:
    """Points of the thinned support, with sub-voxel positions.

    Attributes
    ----------
    voxels : ndarray of shape (n, 3), int32
        Where they lie in the evidence's grid.
    positions : ndarray of shape (n, 3), float32
        Fractional (inline, crossline, sample).
    planes : ndarray of shape (n, 3), float32
        Horizontal normal and cotangent of the dip of each.
    score : ndarray of shape (n,), float32
        Support, in standard deviations of the cube's evidence.
    """

    voxels: np.ndarray
    positions: Float32Array
    planes: Float32Array
    score: Float32Array

    def select(self, chosen: BoolArray) -> RidgePoints:
        """Return the chosen points, a boolean for each."""
        return RidgePoints(self.voxels[chosen], self.positions[chosen], self.planes[chosen], self.score[chosen])


def scan_planes(
    evidence: Evidence, *, settings: ScanSettings | None = None, progress: Progress | None = None
) -> PlanarSupport:
    """Sum the evidence over small planes of all orientations through every voxel, and keep the best.

    A plane near-parallel to the crossline axis is a shear of the inline coordinate: x = a y + b z. So its sum is a sum
    over lines in the time slice (one for each strike a) and then over lines down the dip (one for each b): two short
    sums in place of a disc, each along contiguous samples. Planes near-parallel to the inline axis are done alike.

    The score of a plane is how far its mean evidence stands above that of the whole cube, in standard deviations of the
    cube's evidence: it means the same whatever the cube's amplitudes, noise and sampling.

    Parameters
    ----------
    evidence : Evidence
        From :func:`~seismo3d.seismic.misfit.measure_misfit`.
    settings : ScanSettings, optional
        Sizes and orientations.
    progress : callable, optional
        Called with the stage and the share done.

    Returns
    -------
    PlanarSupport
    """
    settings = settings or ScanSettings()
    noisiness = evidence.noisiness
    # a section is one trace thick: nothing lies along its strike, and a patch's full weight is that of its one trace
    along_strike = 0.0 if 1 in evidence.known.shape[:2] else _between(settings.along_strike, noisiness)
    strike_taps = gaussian_taps(along_strike)
    dip_taps = gaussian_taps(_between(settings.along_dip, noisiness) / evidence.step)
    n_dips = round(_between((float(settings.n_dips[0]), float(settings.n_dips[1])), noisiness))
    cotangents = np.linspace(-1.0, 1.0, n_dips) / np.tan(np.radians(settings.lowest_dip_deg))
    first, second = evidence.along_inlines, evidence.along_crosslines
    prior = np.float32(0.5 * (np.median(first) + np.median(second)))
    families = _families(first.shape, settings.n_strikes)
    n_done, n_all = 0, sum(len(shears) for _, shears in families)
    planes: list[tuple[float, float, float]] = []
    kept: list[tuple[Float32Array, np.ndarray]] = []
    for across, shears in families:
        turn = (0, 1, 2) if across == 0 else (1, 0, 2)
        facing = np.ascontiguousarray((first if across == 0 else second).transpose(turn))
        sideways = np.ascontiguousarray((second if across == 0 else first).transpose(turn))
        pad = len(dip_taps) // 2
        lines = np.empty((*facing.shape[:2], facing.shape[2] + 2 * pad), np.float32)
        best = np.full(facing.shape, -1.0, np.float32)
        arg = np.zeros(facing.shape, np.int16)
        for shear in shears:
            length = float(np.hypot(1.0, shear))
            shares = (np.float32(1.0 / length**2), np.float32(shear**2 / length**2))
            sum_strike_lines(facing, sideways, *shares, shear, strike_taps, pad, lines)
            keep_best_dip(
                lines, cotangents * length * evidence.step, dip_taps, prior, np.float32(settings.prior_weight),
                np.float32(settings.evenness), len(planes), best, arg,
            )  # fmt: skip
            normal = (1.0 / length, -shear / length) if across == 0 else (-shear / length, 1.0 / length)
            planes += [(*normal, float(cot)) for cot in cotangents]
            n_done += 1
            if progress is not None:
                progress("scan", n_done / n_all)
        kept.append((best, arg))
    best, arg = _merge(families, kept)
    best -= np.float32(evidence.mean)
    best /= np.float32(evidence.spread)
    return PlanarSupport(best, arg, np.asarray(planes, np.float32))


def thin(support: PlanarSupport, evidence: Evidence, *, least: float) -> RidgePoints:
    """Keep the crests of the support, across each voxel's own best plane, where the score is at least `least`."""
    offset = np.zeros_like(support.score)
    keep = find_ridges(support.score, support.orientation, support.planes, np.float32(least), offset)
    keep &= evidence.known > 0.0
    voxels = np.argwhere(keep).astype(np.int32)
    at = tuple(voxels.T)
    planes = support.planes[support.orientation[at]]
    positions = voxels.astype(np.float32)
    positions[:, :2] += offset[at][:, None] * planes[:, :2]
    positions[:, 2] *= evidence.step
    return RidgePoints(voxels, positions, planes, support.score[at])


def _between(pair: tuple[float, float], share: float) -> float:
    return pair[0] + share * (pair[1] - pair[0])


def _families(shape: tuple[int, ...], n_strikes: int) -> list[tuple[int, list[float]]]:
    """Return, for planes across the inline axis and across the crossline axis, the shears of their strikes.

    A section is one trace thick: it has no strike, and one family.
    """
    if shape[0] == 1:
        return [(1, [0.0])]
    if shape[1] == 1:
        return [(0, [0.0])]
    shears = [float(a) for a in np.linspace(-1.0, 1.0, n_strikes + 1)]
    # the diagonals belong to both families: they are scanned once
    return [(0, shears), (1, shears[1:-1])]


def _merge(
    families: list[tuple[int, list[float]]], kept: list[tuple[Float32Array, np.ndarray]]
) -> tuple[Float32Array, np.ndarray]:
    if len(families) == 1:
        turn = (0, 1, 2) if families[0][0] == 0 else (1, 0, 2)
        return np.ascontiguousarray(kept[0][0].transpose(turn)), np.ascontiguousarray(kept[0][1].transpose(turn))
    merge_best(*kept[0], *kept[1])
    return kept[0]
