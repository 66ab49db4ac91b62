"""Orientation statistics of faults: poles, mean planes, concentration, sets, and density on the sphere.

Poles are unit vectors (east, north, up) that point up out of a plane; without a map, east is the crossline axis and
north the inline axis. A pole and its opposite are one plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array, IntArray
from seismo3d._validate import as_number, freeze
from seismo3d.geometry.bearings import bearing_deg, wrap_deg
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.index_frame import IndexFrame


@dataclass(frozen=True, slots=True, eq=False)
class Poles:
    """Poles of fault surfaces at their vertices.

    Attributes
    ----------
    directions : ndarray of shape (n, 3), float64
        Unit vectors (east, north, up).
    weights : ndarray of shape (n,), float64
        Area that each stands for.
    labels : ndarray of shape (n,), int64
        Label of the fault.
    """

    directions: Float64Array
    weights: Float64Array
    labels: IntArray


@dataclass(frozen=True, slots=True)
class OrientationSet:
    """Planes of about one orientation.

    Attributes
    ----------
    surfaces : tuple of int
        Labels of the faults.
    share : float
        Share of the whole fault area.
    strike_deg, dip_deg : float
        Of the mean plane: the principal axis of the poles, weighted by area.
    kappa : float
        Fisher's concentration of the poles about it; large where they agree.
    spread_deg : float
        Angle about the mean pole that holds 68 % of a Fisher distribution of this concentration.
    """

    surfaces: tuple[int, ...]
    share: float
    strike_deg: float
    dip_deg: float
    kappa: float
    spread_deg: float


def find_poles(faults: FaultSet, frame: IndexFrame) -> Poles:
    """Gather the poles of all faults of a cube, weighted by area.

    Parameters
    ----------
    faults : FaultSet
    frame : IndexFrame
        Of the same cube: dips are true ones where it is in metres, else in bins and samples.

    Returns
    -------
    Poles
    """
    directions, weights, labels = [], [], []
    for label, surface in enumerate(faults.surfaces, start=1):
        normals = frame.normals(surface.normals)
        dip = np.arccos(np.clip(np.abs(normals[:, 2]), 0.0, 1.0))
        azimuth = np.radians(np.nan_to_num(surface.strike_deg.astype(np.float64)) + 90.0)
        directions.append(np.column_stack([np.sin(azimuth) * np.sin(dip), np.cos(azimuth) * np.sin(dip), np.cos(dip)]))
        parts = np.repeat(frame.areas(surface.vertices, surface.cells) / 3.0, 3)
        weights.append(np.bincount(surface.cells.ravel(), weights=parts, minlength=len(dip)))
        labels.append(np.full(len(dip), label))
    if not directions:
        return Poles(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))
    stacked = np.concatenate(directions), np.concatenate(weights), np.concatenate(labels)
    return Poles(*(freeze(array) for array in stacked))


def mean_pole(directions: AnyArray, weights: AnyArray) -> Float64Array:
    """Principal axis of weighted poles, pointing up: the mean of planes, whichever way their poles point.

    Examples
    --------
    >>> import numpy as np
    >>> mean_pole(np.array([[0.48, 0.36, 0.8], [-0.48, -0.36, -0.8]]), np.ones(2)).round(6).tolist()
    [0.48, 0.36, 0.8]
    """
    d = np.asarray(directions, dtype=np.float64)
    tensor = (d * np.asarray(weights)[:, None]).T @ d
    axis = np.linalg.eigh(tensor)[1][:, -1]
    return np.asarray(-axis if axis[2] < 0 else axis)


def fisher_kappa(directions: AnyArray, weights: AnyArray, mean: AnyArray) -> float:
    r"""Concentration of weighted poles about their mean, by :math:`\coth\kappa - 1/\kappa = \bar R` [1]_.

    The mean resultant is that of all poles turned to the hemisphere of the mean; infinite where all agree.

    References
    ----------
    .. [1] R. Fisher, Proc. R. Soc. A 217(1130), 295-305, 1953. :doi:`10.1098/rspa.1953.0064`
    """
    from scipy.optimize import brentq

    cosine = np.abs(np.asarray(directions) @ np.asarray(mean))
    resultant = float(np.average(cosine, weights=weights))
    if resultant >= 1.0 - 1e-9:
        return float("inf")
    if resultant <= 0.5:  # poles turned to one hemisphere are never less than uniform on it, which has one half
        return 0.0
    high = 2.0 / (1.0 - resultant)
    return float(brentq(lambda k: 1.0 / np.tanh(k) - 1.0 / k - resultant, 1e-6, high))


def find_sets(poles: Poles, *, angle_deg: float = 30.0) -> tuple[OrientationSet, ...]:
    """Group faults by orientation: average linkage of their mean poles, cut at an angle.

    Parameters
    ----------
    poles : Poles
    angle_deg : float
        Mean angle between the faults of two groups below which they are one.

    Returns
    -------
    tuple of OrientationSet
        Largest share first.
    """
    from scipy.cluster.hierarchy import fcluster, linkage
    from scipy.spatial.distance import squareform

    limit = as_number(angle_deg, "angle_deg", low=0.0, high=90.0)
    labels = np.unique(poles.labels)
    if not len(labels):
        return ()
    means = np.array([mean_pole(*_of(poles, poles.labels == label)) for label in labels])
    group: IntArray = np.ones(len(labels), np.int64)
    if len(labels) > 1:
        angles = np.degrees(np.arccos(np.clip(np.abs(means @ means.T), 0.0, 1.0)))
        np.fill_diagonal(angles, 0.0)
        group = fcluster(linkage(squareform(angles, checks=False), "average"), limit, criterion="distance")
    sets = [_describe(poles, labels[group == number]) for number in np.unique(group)]
    return tuple(sorted(sets, key=lambda entry: -entry.share))


def kamb_density(directions: AnyArray, weights: AnyArray, at: AnyArray, *, count: float, sigma: float = 3.0) -> Any:
    r"""Density of poles at directions, in standard deviations above that of poles spread evenly.

    Kamb's method with the exponential kernel :math:`\exp(f(|\cos\theta| - 1))` of [1]_, :math:`f = 2(1 + n/\sigma^2)`.
    Over a hemisphere its mean is :math:`1/f` and its variance :math:`1/(2f) - 1/f^2`.

    Parameters
    ----------
    directions : ndarray of shape (n, 3)
        Poles.
    weights : ndarray of shape (n,)
        Weights of any size.
    at : ndarray of shape (..., 3)
        Unit vectors where the density is wanted.
    count : float
        Number of independent poles that they amount to: faults, not vertices.
    sigma : float
        Expected count over its standard deviation: larger is smoother.

    Returns
    -------
    ndarray of shape (...,), float64

    References
    ----------
    .. [1] F. W. Vollmer, Computers & Geosciences 21(1), 31-49, 1995. :doi:`10.1016/0098-3004(94)00058-3`
    """
    total = float(np.sum(weights))
    places = np.asarray(at, dtype=np.float64).reshape(-1, 3)
    if not len(directions) or total <= 0.0:
        return np.zeros(np.shape(at)[:-1])
    f = 2.0 * (1.0 + count / sigma**2)
    found = np.zeros(len(places))
    for start in range(0, len(directions), 4096):
        part = slice(start, start + 4096)
        kernel = np.exp(f * (np.abs(places @ np.asarray(directions)[part].T) - 1.0))
        found += kernel @ (np.asarray(weights)[part] * (count / total))
    spread = np.sqrt(count * (0.5 / f - 1.0 / f**2))
    return ((found - count / f) / spread).reshape(np.shape(at)[:-1])


def to_strike_dip(pole: AnyArray) -> tuple[float, float]:
    """Strike (right-hand rule) and dip in degrees of the plane with a pole.

    Examples
    --------
    >>> to_strike_dip([0.0, 0.0, 1.0])[1]
    0.0
    >>> [round(v, 6) for v in to_strike_dip([1.0, 0.0, 0.0])]
    [0.0, 90.0]
    """
    east, north, up = np.asarray(pole, dtype=np.float64) * (1.0 if pole[2] >= 0 else -1.0)
    strike = float(wrap_deg(bearing_deg(east, north) - 90.0))
    return strike, float(np.degrees(np.arccos(min(up, 1.0))))


def _of(poles: Poles, chosen: AnyArray) -> tuple[Float64Array, Float64Array]:
    return poles.directions[chosen], poles.weights[chosen]


def _describe(poles: Poles, labels: IntArray) -> OrientationSet:
    directions, weights = _of(poles, np.isin(poles.labels, labels))
    mean = mean_pole(directions, weights)
    kappa = fisher_kappa(directions, weights, mean)
    strike, dip = to_strike_dip(mean)
    # P(angle <= a) = (1 - exp(k (cos a - 1))) / (1 - exp(-2 k))
    spread = 0.0
    if np.isfinite(kappa):
        cosine = 1.0 + np.log1p(-0.68 * -np.expm1(-2.0 * kappa)) / kappa if kappa > 0 else 1.0 - 2.0 * 0.68
        spread = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    share = float(weights.sum() / poles.weights.sum())
    return OrientationSet(tuple(int(n) for n in labels), share, strike, dip, kappa, spread)
