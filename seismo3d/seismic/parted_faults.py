"""Parts of a fault on either side of another: how well they go on in each other, as they lie and with that undone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import Float64Array
from seismo3d.seismic.fault_motion import FaultMotion, Frame
from seismo3d.seismic.sheet_distances import bounds_of, within_box
from seismo3d.seismic.term_fits import fit_terms

if TYPE_CHECKING:
    from seismo3d.seismic.fault_ages import HistorySettings

# a place's part of the roughness of a surface, in squared traces, is at most this
_ROUGHEST = 25.0
# share by which the places near a fault must lie more on its one side, of one of two parts that it has taken apart
_PARTED = 0.8
# places of a part near a fault that tell on which side of it that lies
_LEAST = 30


def roughness_of(frame: Frame, points: Float64Array) -> float:
    """Return the mean square, robust, that a quadratic surface leaves of points, in squared traces."""
    s, samples, w = frame.lay(points)
    a, b = ((at - at.mean()) / max(float(at.std()), 1.0) for at in (s, samples))
    _, left = fit_terms((np.ones_like(a), a, b, a * a, a * b, b * b), w - w.mean())
    return float(np.minimum(left * left, _ROUGHEST).mean())


def distances_along(
    frame: Frame, one: Float64Array, other: Float64Array, reach: float
) -> tuple[Float64Array, Float64Array]:
    """Return how far, along a fault, each place of two parts is from the other; infinite beyond reach."""
    here, there = (np.column_stack(frame.lay(part)[:2]) for part in (one, other))
    return _distances(here, there, reach), _distances(there, here, reach)


def roughness_together(
    frame: Frame, parts: tuple[Float64Array, Float64Array], away: tuple[Float64Array, Float64Array], around: float
) -> tuple[float, int]:
    """Return the roughness of two parts where they come near each other, as many places of each, and how many that are.

    How far their places are from the other part is given; those not so much farther off than the nearest count. The
    roughness is infinite where none do.
    """
    gap = min((float(far.min()) for far in away if len(far)), default=np.inf)
    near = [part[far < gap + around] for part, far in zip(parts, away, strict=True)]
    count = min(len(places) for places in near)
    if not (np.isfinite(gap) and count):
        return np.inf, 0
    both = [places[np.linspace(0, len(places) - 1, count).astype(np.int64)] for places in near]
    return roughness_of(frame, np.concatenate(both)), count


class SidesOfFaults:
    """On which sides of which faults places of others lie; each is worked out once.

    Parameters
    ----------
    motions, nodes, settings
        As for :func:`~seismo3d.seismic.fault_ages.order_faults`.
    """

    def __init__(self, motions: list[FaultMotion], nodes: list[Float64Array], settings: HistorySettings) -> None:
        self._motions, self._nodes, self._settings = motions, nodes, settings
        self._shares: dict[tuple[int, int], float] = {}

    def parted(self, fault: int, one: int, other: int) -> tuple[Float64Array, Float64Array] | None:
        """Return the places of two parts that another fault lies between, each on its side; None if it does not.

        A part may run on a little beyond the fault that cuts it.
        """
        shares = self._share(fault, one), self._share(fault, other)
        # false as well where either is not known
        if not abs(shares[0] - shares[1]) >= _PARTED:
            return None
        first, second = (
            self._nodes[part][(self._motions[fault].side(self._nodes[part]) > 0.0) == (share > 0.5)]
            for part, share in zip((one, other), shares, strict=True)
        )
        return first, second

    def _share(self, fault: int, part: int) -> float:
        """Return the share of a part's places near a fault that lie in its hanging wall; NaN where these are few."""
        if (fault, part) not in self._shares:
            of = self._settings
            _, side = self._motions[fault].find_near(self._nodes[part], clear=of.clear, reach=of.reach, edge=of.edge)
            self._shares[fault, part] = float((side > 0.0).mean()) if len(side) >= _LEAST else np.nan
        return self._shares[fault, part]


def _distances(places: Float64Array, others: Float64Array, reach: float) -> Float64Array:
    """Return how far each place is from the nearest of others; infinite where that is farther than the reach."""
    distances = np.full(len(places), np.inf)
    if not (len(places) and len(others)):
        return distances
    near = within_box(places, bounds_of(others), reach)
    if near.any():
        tree = cKDTree(others[within_box(others, bounds_of(places[near]), reach)])
        distances[near] = tree.query(places[near], distance_upper_bound=reach)[0]
    return distances
