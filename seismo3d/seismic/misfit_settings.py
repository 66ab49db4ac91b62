"""How the misfit of both sides is measured, and what windows and thresholds become in a cube's own noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._settings import Amount, Count, Positive, Share, Steps, Width
from seismo3d.seismic._kernels_filters import gaussian_taps

NOISES = (0.0, 0.057, 0.145)
"""Median misfit ratios of a cube without noise, of a good survey, and of one with nearly as much noise as signal."""

# median misfit ratio of mild noise
_MILD = 0.036
# widths along the trace, and what noise leaves in the median ratio over them, as a share of that over the second
_WIDTHS, _LEFT = (0.7, 1.5, 2.0), (0.81, 1.0, 1.06)


@dataclass(frozen=True, slots=True)
class MisfitSettings:
    """How the misfit is measured; lengths in samples and traces.

    Attributes
    ----------
    reach : tuple of (int, int) in [1, 100]
        Traces averaged on each side, in a cube without noise and in a cube of noise.
    vertical : tuple of (float, float) in (0, 1000]
        Width of the Gaussian that smooths the misfit along the trace, in a cube without noise and in a cube of noise.
        What it spreads along the trace lies off a gently dipping fault, by as many traces as samples and more.
    lateral : float in (0, 1000]
        Width of the Gaussian that smooths the evidence over neighbouring traces.
    footprint : float in [0, 1]
        Most that is taken out of the evidence for acquisition footprint; less in a cube with next to no noise.
    background : tuple of (float, float) in (0, 1000]
        Lateral and vertical width of the window of the local background.
    levelling : float in [0, 1]
        Share of the local background that is taken out: 0 none, 1 all.
    energy : tuple of (float, float) in (0, 1000]
        Lateral and vertical width of the window whose energy normalises the misfit.
    floor : float in [0, inf)
        What is added to that energy, as a share of the mean at the depth: between strong reflectors the noise alone
        differs from side to side, and in proportion to itself it differs much.
    step : int in [1, 100]
        Every how many samples the evidence is kept.
    softness : float in [0, inf)
        Misfit ratio below which differences count no more.
    most : float in (0, inf)
        Largest misfit ratio; two unrelated sides give 1 on average.
    slab : int in [1, 1000000]
        Inlines that are worked on at a time; bounds the memory.
    """

    reach: tuple[Steps, Steps] = (2, 10)
    vertical: tuple[Width, Width] = (0.7, 2.0)
    lateral: Width = 1.25
    footprint: Share = 0.5
    background: tuple[Width, Width] = (7.0, 9.0)
    levelling: Share = 1.0
    energy: tuple[Width, Width] = (2.0, 4.0)
    floor: Amount = 0.25
    step: Steps = 2
    softness: Amount = 0.02
    most: Positive = 1.5
    slab: Count = 64


def judge_noise(noise: float, settings: MisfitSettings) -> tuple[float, int]:
    """Return how noisy a cube is, 0 to 1, by its median misfit ratio, and how many traces to average for that."""
    least, most = settings.reach
    noisiness = float(np.clip((noise - 0.01) / 0.28, 0.0, 1.0))
    return noisiness, round(least + noisiness * (most - least))


def find_noise(median: float, reach: int, settings: MisfitSettings) -> float:
    """Return what a median ratio would be over the usual width along the trace: noise leaves less over a narrow one."""
    return median / float(np.interp(width_along_trace(reach, settings), _WIDTHS, _LEFT))


def width_along_trace(reach: int, settings: MisfitSettings) -> float:
    """Return the width of the window along the trace, given how many traces a side the cube's noise asks for."""
    least, most = settings.reach
    return float(np.interp(reach, settings.reach, settings.vertical)) if least < most else settings.vertical[0]


def find_softness(noise: float, settings: MisfitSettings) -> np.float32:
    """Return the misfit ratio below which differences count no more, given the cube's median one."""
    return np.float32(max(settings.softness, 0.8 * noise))


def share_of_noise(noise: float) -> float:
    """Return how much of what differs between lines is taken for noise, given the cube's median misfit ratio.

    All of it from mild noise on; in a cube with next to none it is the faults'.
    """
    return min(1.0, noise / _MILD)


def misfit_reach(reach: int, settings: MisfitSettings) -> int:
    """Return how many traces off the misfit depends on, besides the slopes there."""
    return reach + energy_reach(settings)


def energy_reach(settings: MisfitSettings) -> int:
    """Return over how many traces to either side the energy is averaged."""
    return len(gaussian_taps(settings.energy[0])) // 2
