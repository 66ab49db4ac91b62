"""Planar support: how well the evidence around each voxel lies on a plane, of the best strike and dip."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from seismo3d._settings import Amount, Degrees, Share, Width
from seismo3d._typing import BoolArray, Float32Array, Float64Array, Progress
from seismo3d.seismic._kernels_filters import gaussian_taps
from seismo3d.seismic._kernels_scan import find_ridges, keep_best_dip, merge_best, sum_strike_lines
from seismo3d.seismic.misfit import Evidence
from seismo3d.seismic.misfit_settings import share_of_noise

BESIDE = 8
"""Traces off a crest where slopes are none that its own break looks like."""

# widths of its Gaussian at which a patch ends
_CUT = 2.0
# difference of both axes' medians half of which noise is taken to have made: faults make less
_AXES_APART = 0.12


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """Sizes of the planes and their orientations; the first of a pair holds without noise, the second in noise.

    Attributes
    ----------
    along_strike, along_dip : tuple of (float, float) in (0, 1000]
        Widths of the Gaussian patch: in traces along strike, in samples down the dip.
    lowest_dip_deg : float in [5, 85]
        Dip below which no fault is looked for, in index coordinates.
    layer_angles_deg : tuple of (float, float) in [0, 90]
        Angles to the layers at a crest, and to those `BESIDE` traces off it on either side, below which it is none of a
        fault: where steep layers are told a little too flat, they do not fit along themselves. Of cubes alone: the
        slopes of a section, which no neighbours steady, are none in noise.
    n_strikes : int in [2, 100]
        Strikes tried in each half of the compass.
    n_dips : tuple of (int, int) in [2, 100]
        Dips tried at each strike.
    evenness : float in [0, 1]
        0 takes a plane's mean; 1 that of its poorer half, above or below.
    prior_weight : float in [0, inf)
        Weight of the background in every mean, against a patch's full weight of 1.
    """

    along_strike: tuple[Width, Width] = (8.0, 15.0)
    along_dip: tuple[Width, Width] = (13.0, 19.0)
    lowest_dip_deg: Annotated[float, "[5, 85]"] = 27.0
    layer_angles_deg: tuple[Degrees, Degrees] = (15.0, 25.0)
    n_strikes: Annotated[int, "[2, 100]"] = 8
    n_dips: tuple[Annotated[int, "[2, 100]"], Annotated[int, "[2, 100]"]] = (21, 21)
    evenness: Share = 0.25
    prior_weight: Amount = 0.1


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
        From :func:`~seismo3d.seismic.fault_evidence.measure_evidence`.
    settings : ScanSettings, optional
        Sizes and orientations.
    progress : callable, optional
        Called with the stage and the share done.

    Returns
    -------
    PlanarSupport
    """
    shape = (evidence.known.shape[0], evidence.known.shape[1], evidence.known.shape[2])
    plan = plan_scan(shape, evidence.noisiness, evidence.step, settings=settings or ScanSettings())
    both, present = (evidence.along_inlines, evidence.along_crosslines), evidence.present
    medians = [float(np.median(values if present is None else values[present])) for values in both]
    prior, offsets = find_prior(medians, shape), find_offsets(medians, shape, evidence.noise)

    def take(across: int) -> ScanRegion:
        levelled = (values + offset for values, offset in zip(both, offsets, strict=True))
        return ScanRegion.turned(levelled, present, across, (0, 0), (shape[0], shape[1]))

    best, arg = scan_region(take, plan, prior, progress=progress)
    return PlanarSupport(in_spreads(best, evidence.mean, evidence.spread), arg, plan.planes)


@dataclass(frozen=True, slots=True, eq=False)
class ScanPlan:
    """Which planes are tried, and over how many neighbours each is summed.

    Attributes
    ----------
    strike_taps, dip_taps : ndarray, float32
        Weights along strike, by trace, and down the dip, by step of the evidence.
    cotangents : ndarray, float64
        Move per sample down the plane of each dip.
    families : list of (int, list of float)
        The axis that planes lie across, and the shears of their strikes.
    planes : ndarray of shape (m, 3), float32
        Unit horizontal normal and cotangent of every plane.
    step : int
        Samples a step of the evidence.
    settings : ScanSettings
    """

    strike_taps: Float32Array
    dip_taps: Float32Array
    cotangents: Float64Array
    families: list[tuple[int, list[float]]]
    planes: Float32Array
    step: int
    settings: ScanSettings

    @property
    def dip_reach(self) -> int:
        """Traces across a plane, at most, from a voxel to the ends of the plane down the dip."""
        return max(self.reach_across(shear) for _, shears in self.families for shear in shears)

    def reach_across(self, shear: float) -> int:
        """Return what :attr:`dip_reach` is for planes of one strike."""
        half, length = len(self.dip_taps) // 2, float(np.hypot(1.0, shear))
        return int(np.ceil(half * length * float(np.abs(self.cotangents).max()) * self.step)) + 1

    @property
    def reach(self) -> tuple[int, int]:
        """Traces, at most, from a voxel to what it depends on: across a plane, and along its strike."""
        half = len(self.strike_taps) // 2
        return self.dip_reach + half + 1, half


def plan_scan(shape: tuple[int, int, int], noisiness: float, step: int, *, settings: ScanSettings) -> ScanPlan:
    """Choose planes and patches for the evidence of a whole cube: its shape, its noisiness and its step."""
    # a section is one trace thick: nothing lies along its strike, and a patch's full weight is that of its one trace
    along_strike = 0.0 if 1 in shape[:2] else _between(settings.along_strike, noisiness)
    n_dips = round(_between((float(settings.n_dips[0]), float(settings.n_dips[1])), noisiness))
    cotangents = np.linspace(-1.0, 1.0, n_dips) / np.tan(np.radians(settings.lowest_dip_deg))
    families = _families(shape, settings.n_strikes)
    planes = []
    for across, shears in families:
        for shear in shears:
            length = float(np.hypot(1.0, shear))
            normal = (1.0 / length, -shear / length) if across == 0 else (-shear / length, 1.0 / length)
            planes += [(*normal, float(cot)) for cot in cotangents]
    return ScanPlan(
        gaussian_taps(along_strike, cut=_CUT), gaussian_taps(_between(settings.along_dip, noisiness) / step, cut=_CUT),
        cotangents, families, np.asarray(planes, np.float32), step, settings,
    )  # fmt: skip


def find_prior(medians: Sequence[float], shape: tuple[int, ...]) -> np.float32:
    """Return what counts where there is no cube: the mean of the medians of the evidence, both ways.

    A section has evidence along its own traces alone.
    """
    told = [median for median, n in zip(medians, shape, strict=False) if n > 1]
    return np.float32(sum(told) / len(told))


def find_offsets(medians: Sequence[float], shape: tuple[int, ...], noise: float) -> list[np.float32]:
    """Return what is to be added to the evidence, either way, to take off what noise makes their medians differ by.

    Where inlines differ from each other more than crosslines do, as footprints and gridding leave them, planes across
    the inlines would be found everywhere. A small difference is kept: faults of one strike make it, in little noise all
    of it. A section has evidence along its own traces alone.
    """
    apart, middle = medians[0] - medians[1], np.float32(0.5 * (medians[0] + medians[1]))
    share = 0.0 if 1 in shape[:2] else share_of_noise(noise) * apart**2 / (apart**2 + _AXES_APART**2)
    return [np.float32(share) * (middle - np.float32(median)) for median in medians]


def in_spreads(best: Float32Array, mean: float, spread: float) -> Float32Array:
    """Turn the means of planes, in place, into standard deviations above the mean of the cube's evidence."""
    best -= np.float32(mean)
    best /= np.float32(spread)
    return best


@dataclass(frozen=True, slots=True, eq=False)
class ScanRegion:
    """Evidence around the traces that are to be scanned, the axis across the planes first.

    Attributes
    ----------
    facing, sideways : ndarray of three axes, float32
        Evidence across that axis, and across the other one; 0 where there is none.
    shares : ndarray of the same shape, float32, or None
        1 where there is evidence and 0 elsewhere; None where there is everywhere.
    corner : tuple of (int, int)
        Where in them the traces begin.
    size : tuple of (int, int)
        How many there are.
    """

    facing: Float32Array
    sideways: Float32Array
    shares: Float32Array | None
    corner: tuple[int, int]
    size: tuple[int, int]

    @classmethod
    def turned(
        cls,
        both: Iterable[Float32Array],
        present: BoolArray | None,
        across: int,
        corner: tuple[int, int],
        size: tuple[int, int],
    ) -> ScanRegion:
        """Return the region with its axes as a family of planes needs them, from those of the cube.

        `both` is the evidence along inlines and along crosslines, which need not be held at once; `present` tells where
        there is any.
        """
        turn = (0, 1, 2) if across == 0 else (1, 0, 2)
        turned = [np.ascontiguousarray(values.transpose(turn)) for values in both]
        shares = None if present is None else np.ascontiguousarray(present.transpose(turn), np.float32)
        if shares is not None:
            for values in turned:
                values *= shares
        facing, sideways = turned[across], turned[1 - across]
        return cls(facing, sideways, shares, (corner[turn[0]], corner[turn[1]]), (size[turn[0]], size[turn[1]]))


def scan_region(
    take: Callable[[int], ScanRegion], plan: ScanPlan, prior: np.float32, *, progress: Progress | None = None
) -> tuple[Float32Array, np.ndarray]:
    """Return the best plane's mean evidence and number at every trace of a region, which may be all of a cube.

    `take` gives the region for planes across an axis: what lies beyond its ends, where they are nearer than the plan's
    reach, counts as outside the cube.
    """
    settings = plan.settings
    n_done, n_all = 0, sum(len(shears) for _, shears in plan.families)
    kept: list[tuple[Float32Array, np.ndarray]] = []
    for across, shears in plan.families:
        region = take(across)
        pad, n_samples = len(plan.dip_taps) // 2, region.facing.shape[2]
        row, column = region.corner
        room = np.empty((len(region.facing), region.size[1], n_samples + 2 * pad), np.float32)
        known_room = room[:0] if region.shares is None else np.empty_like(room)
        best = np.full((*region.size, n_samples), -1.0, np.float32)
        arg = np.zeros(best.shape, np.int16)
        for shear in shears:
            low = max(0, row - plan.reach_across(shear))
            high = min(len(region.facing), row + region.size[0] + plan.reach_across(shear))
            lines, length = room[: high - low], float(np.hypot(1.0, shear))
            weights = (np.float32(1.0 / length**2), np.float32(shear**2 / length**2))
            sum_strike_lines(
                region.facing, region.sideways, *weights, shear, plan.strike_taps, pad, (low, column), lines
            )
            known = known_room[: high - low]
            if region.shares is not None:
                sum_strike_lines(
                    region.shares, region.shares, *weights, shear, plan.strike_taps, pad, (low, column), known
                )
            keep_best_dip(
                lines, known, row - low, plan.cotangents * length * plan.step, plan.dip_taps, prior,
                np.float32(settings.prior_weight), np.float32(settings.evenness), n_done * len(plan.cotangents),
                best, arg,
            )  # fmt: skip
            n_done += 1
            if progress is not None:
                progress("scan", n_done / n_all)
        kept.append((best, arg))
        del region, room, lines, known_room, known
    return _merge(plan.families, kept)


def thin(support: PlanarSupport, evidence: Evidence, *, least: float) -> RidgePoints:
    """Keep the crests of the support, across each voxel's own best plane, where the score is at least `least`."""
    return thin_region(support, evidence.known, evidence.step, least=least)


def thin_region(
    support: PlanarSupport, known: Float32Array, step: int, *, least: float, corner: tuple[int, int] = (0, 0)
) -> RidgePoints:
    """Keep the crests of the support of a region, whose first inline and crossline are the corner's."""
    offset = np.zeros_like(support.score)
    keep = find_ridges(support.score, support.orientation, support.planes, np.float32(least), offset)
    keep &= known > 0.0
    voxels = np.argwhere(keep).astype(np.int32)
    at = tuple(voxels.T)
    planes, off, score = support.planes[support.orientation[at]], offset[at], support.score[at]
    voxels[:, :2] += np.asarray(corner, np.int32)
    positions = voxels.astype(np.float32)
    positions[:, :2] += off[:, None] * planes[:, :2]
    positions[:, 2] *= step
    return RidgePoints(voxels, positions, planes, score)


def leave_layers(
    ridges: RidgePoints,
    slopes: tuple[Float32Array, Float32Array],
    settings: ScanSettings,
    *,
    corner: tuple[int, int] = (0, 0),
) -> RidgePoints:
    """Leave out the crests that run along the layers at them and on both sides of them.

    Parameters
    ----------
    ridges : RidgePoints
        From :func:`thin`.
    slopes : tuple of ndarray of shape (inline, crossline, sample), float32
        Reflector slopes along inlines and crosslines, of a block that begins at a corner and holds what lies
        :data:`BESIDE` traces off all ridges, but for what lies beyond the cube.
    settings : ScanSettings
        The angles that are needed.
    corner : tuple of (int, int)
        First inline and crossline of the block.

    Returns
    -------
    RidgePoints
        The others, in their order.
    """
    across, cotangent = ridges.planes[:, :2], ridges.planes[:, 2]
    sample = ridges.positions[:, 2].astype(np.int64)  # a crest lies on one
    along = np.ones(len(sample), bool)
    at_crest, beside = np.cos(np.radians(settings.layer_angles_deg)).astype(np.float32)
    for off, nearest in ((0, at_crest), (-BESIDE, beside), (BESIDE, beside)):
        traces = np.rint(ridges.positions[:, :2] + np.float32(off) * across).astype(np.int64) - np.asarray(corner)
        i, j = np.clip(traces, 0, np.array(slopes[0].shape[:2]) - 1).T
        p, q = (slope[i, j, sample] for slope in slopes)
        lengths = np.sqrt((1 + cotangent * cotangent) * (1 + p * p + q * q))
        along &= np.abs(across[:, 0] * p + across[:, 1] * q + cotangent) > nearest * lengths
    return ridges.select(~along)


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
