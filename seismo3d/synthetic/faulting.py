"""Faults of synthetic cubes: their geometry and slip, given or drawn at random."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, TypeAlias

import numpy as np

from seismo3d._settings import Amount, Many, Positive, Share, check_fields
from seismo3d._typing import Float64Array
from seismo3d._validate import (
    as_cube_shape,
    as_kind,
    as_number,
    as_numbers,
    check_generator,
    is_among,
    told,
)
from seismo3d.errors import ParameterError
from seismo3d.synthetic import _kernels as kernels

N_COLUMNS = 24
_PROFILES = {"uniform": kernels.UNIFORM, "gaussian": kernels.GAUSSIAN, "elliptic": kernels.ELLIPTIC}


@dataclass(frozen=True, slots=True)
class SyntheticFault:
    """One fault: a surface and the slip along it.

    The surface passes through ``centre``. Lengths are in index units, throws in samples.

    Attributes
    ----------
    centre : tuple of float
        (inline, crossline, sample) of the point where throw is ``throw``.
    strike_deg : float
        Direction of strike at the centre, from growing inlines towards growing crosslines; the fault dips to its right.
    dip_deg : float
        Dip at the centre, 5 to 89.
    throw : float
        Vertical displacement at the centre; positive where the hanging wall goes down, negative for a reverse fault.
    profile : {"uniform", "gaussian", "elliptic"}
        How throw changes over the surface: linearly (``trend``); as a Gaussian of standard deviations ``semi_axes``;
        or as Walsh and Watterson's profile [1]_ inside an elliptic tip line with ``semi_axes``, zero outside.
    semi_axes : tuple of float
        Along strike and vertically.
    trend : tuple of float
        Relative change of a uniform throw a unit along strike and a sample down; it stays between 0 and twice
        ``throw``.
    bend : tuple of float
        Curvature of the surface along strike and down dip, in 1 / index units.
    ripple : tuple of float
        Amplitude, wavelength and phase of corrugations along strike.
    listric : tuple of float or None
        Dip in degrees towards which the surface flattens below its centre, and the horizontal distance over which it
        does. The hanging wall then moves by a heave that is the same at all depths and sags vertically onto the ramp (a
        rollover).
    drag : float
        Distance from the surface at which displacement has died away; 0 for blocks that move as a whole.
    share : float
        Share of the displacement that the hanging wall takes, the footwall takes the rest.
    rake_deg : float
        Angle of slip in the plane from strike: 90 is dip slip.
    buried : bool
        True where the fault is older than the unconformity, which then cuts it off.

    References
    ----------
    .. [1] J. J. Walsh and J. Watterson, Journal of Structural Geology 9(8), 1039-1046, 1987.
    """

    centre: tuple[float, float, float]
    strike_deg: float
    dip_deg: float
    throw: float
    profile: Literal["uniform", "gaussian", "elliptic"] = "uniform"
    semi_axes: tuple[float, float] = (1e6, 1e6)
    trend: tuple[float, float] = (0.0, 0.0)
    bend: tuple[float, float] = (0.0, 0.0)
    ripple: tuple[float, float, float] = (0.0, 1.0, 0.0)
    listric: tuple[float, float] | None = None
    drag: float = 0.0
    share: float = 1.0
    rake_deg: float = 90.0
    buried: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        as_number(self.dip_deg, "dip_deg", low=5.0, high=89.0)
        as_number(self.strike_deg, "strike_deg")
        as_number(self.share, "share", low=0.0, high=1.0)
        as_number(self.drag, "drag", low=0.0)
        as_number(self.rake_deg, "rake_deg", low=20.0, high=160.0)
        as_number(self.throw, "throw")
        for name, n in (("centre", 3), ("semi_axes", 2), ("trend", 2), ("bend", 2), ("ripple", 3)):
            as_numbers(getattr(self, name), name, n=n)
        if self.listric is not None:
            as_numbers(self.listric, "listric", n=2)
        if not is_among(self.profile, _PROFILES):
            raise ParameterError(f"profile is {told(self.profile)}; expected one of {', '.join(_PROFILES)}.")
        if min(self.semi_axes) <= 0.0:
            raise ParameterError(f"semi_axes are {self.semi_axes}; expected two positive lengths.")
        steepest = {
            "uniform": abs(self.trend[1]),
            "gaussian": 0.61 / self.semi_axes[1],
            "elliptic": 1.6 / self.semi_axes[1],
        }
        if self.listric is None and abs(self.throw) * steepest[self.profile] > 0.9:
            remedy = "Give a smaller trend[1]" if self.profile == "uniform" else "Lengthen semi_axes"
            raise ParameterError(
                f"throw {self.throw:g} changes by {abs(self.throw) * steepest[self.profile]:.2g} samples a sample down "
                f"dip; expected at most 0.9, or layers would turn over. {remedy}."
            )
        if self.drag and abs(self.throw) * 2.0 * max(self.share, 1.0 - self.share) > 0.9 * self.drag:
            raise ParameterError(
                f"drag is {self.drag:g}; expected more than twice the throw, or layers would turn over."
            )
        if self.listric is not None and (self.rake_deg != 90.0 or self.drag or self.share != 1.0 or self.bend[1]):
            raise ParameterError(
                "a listric fault moves its hanging wall by dip slip alone. Leave rake_deg, drag, share and bend[1] out."
            )

    def row(self) -> Float64Array:
        """Return the fault as the row of numbers that the compiled loops read."""
        strike, dip = np.deg2rad(self.strike_deg), np.deg2rad(self.dip_deg)
        deep, length = self.listric or (self.dip_deg, 1.0)
        amplitude, wavelength, phase = self.ripple
        row = np.zeros(N_COLUMNS)
        row[:6] = (*self.centre, -np.sin(strike), np.cos(strike), 1.0 / np.tan(dip))
        row[kernels.SHAPE] = kernels.PLANE if self.listric is None else kernels.LISTRIC
        row[kernels.BEND_A : kernels.RIPPLE + 1] = (*self.bend, amplitude)
        row[kernels.RIPPLE_K : kernels.THROW] = (2 * np.pi / wavelength, phase, np.tan(np.deg2rad(deep)), length)
        row[kernels.THROW : kernels.SEMI_S + 1] = (self.throw, _PROFILES[self.profile], *self.semi_axes)
        row[kernels.TREND_A : kernels.SHARE + 1] = (*self.trend, self.drag, self.share)
        row[kernels.RAKE :] = (1.0 / (np.tan(np.deg2rad(self.rake_deg)) * np.sin(dip)), np.sin(dip))
        return row


def fault_rows(faults: Sequence[SyntheticFault]) -> Float64Array:
    """Stack faults, oldest first, into one array of shape (n, 24)."""
    return np.array([fault.row() for fault in faults]).reshape(len(faults), N_COLUMNS)


_Dip: TypeAlias = Annotated[float, "[5, 89]"]


@dataclass(frozen=True, slots=True)
class FaultPopulation:
    """Ranges from which random faults are drawn; every pair is (lowest, highest), shares are probabilities.

    Attributes
    ----------
    count : tuple of int in [0, 10000], not falling
        Number of faults.
    dip_deg, throw : tuple of float in [5, 89], (0, inf), not falling
        Dip in degrees and maximal throw in samples.
    families : int in [1, 10000]
        Number of preferred strikes; faults of a family keep ``strike_spread`` degrees of each other.
    strike_spread : float in [0, 180]
        Half-width of a family's strikes, degrees.
    conjugate : float in [0, 1]
        Share that dips the opposite way.
    reverse, curved, listric, buried, oblique : float in [0, 1]
        Shares of reverse, curved and listric faults, of faults older than the unconformity, of slip off the dip line.
    profiles : tuple of float in [0, 1], of sum 1
        Shares of uniform (with trends), Gaussian and elliptic throw.
    trend : tuple of float in [0, inf)
        Largest relative change of a uniform throw over the width and over the depth of the cube.
    spacing : float in [0, inf)
        Smallest distance between the centre lines of faults of one family, as a share of the cube's width.
    """

    count: Annotated[tuple[Many, Many], "not falling"] = (5, 8)
    dip_deg: Annotated[tuple[_Dip, _Dip], "not falling"] = (60.0, 85.0)
    throw: Annotated[tuple[Positive, Positive], "not falling"] = (5.0, 40.0)
    families: Annotated[int, "[1, 10000]"] = 2
    strike_spread: Annotated[float, "[0, 180]"] = 15.0
    conjugate: Share = 0.4
    reverse: Share = 0.15
    curved: Share = 0.3
    listric: Share = 0.0
    buried: Share = 0.0
    oblique: Share = 0.15
    profiles: Annotated[tuple[Share, Share, Share], "of sum 1"] = (0.5, 0.25, 0.25)
    trend: tuple[Amount, Amount] = (0.4, 0.6)
    spacing: Amount = 0.14

    def __post_init__(self) -> None:
        check_fields(self)


def sample_faults(
    rng: np.random.Generator, shape: tuple[int, int, int], population: FaultPopulation
) -> tuple[SyntheticFault, ...]:
    """Draw faults, oldest first.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    shape : tuple of int
        Cube's (inline, crossline, sample) size.
    population : FaultPopulation
        Ranges to draw from.

    Returns
    -------
    tuple of SyntheticFault
        Buried ones first.
    """
    check_generator(rng)
    as_cube_shape(shape)
    as_kind(population, FaultPopulation, "population", remedy="Give FaultPopulation(...).")
    n = int(rng.integers(population.count[0], population.count[1] + 1))
    first = rng.uniform(0.0, 180.0)
    step = 180.0 / max(population.families, 1)
    strikes = [first + k * step + rng.uniform(-0.15, 0.15) * step for k in range(population.families)]
    taken: list[list[float]] = [[] for _ in strikes]
    faults = []
    for k in range(n):
        family = k % population.families
        strike = strikes[family] + rng.uniform(-1.0, 1.0) * population.strike_spread
        offset = _free_offset(rng, taken[family], population.spacing)
        taken[family].append(offset)
        faults.append(_sample_fault(rng, shape, population, strike, offset))
    return tuple(sorted(faults, key=lambda fault: not fault.buried))


def _free_offset(rng: np.random.Generator, taken: list[float], spacing: float) -> float:
    """Draw a distance across strike, share of the half-width, as far from the others as room allows."""
    best, best_gap = 0.0, -1.0
    for _ in range(40):
        offset = float(rng.uniform(-0.85, 0.85))
        gap = min((abs(offset - other) for other in taken), default=2.0)
        if gap > best_gap:
            best, best_gap = offset, gap
        if gap >= 2.0 * spacing:
            break
    return best


def _sample_fault(
    rng: np.random.Generator, shape: tuple[int, int, int], p: FaultPopulation, strike: float, offset: float
) -> SyntheticFault:
    ni, nx, ns = shape
    if rng.random() < p.conjugate:
        strike, offset = strike + 180.0, -offset
    angle = np.deg2rad(strike)
    along = rng.uniform(-0.3, 0.3)
    centre = (
        0.5 * ni * (1.0 - offset * np.sin(angle)) + along * ni * np.cos(angle),
        0.5 * nx * (1.0 + offset * np.cos(angle)) + along * nx * np.sin(angle),
        ns * rng.uniform(0.3, 0.7),
    )
    dip = float(rng.uniform(*p.dip_deg))
    size = float(np.exp(rng.uniform(np.log(p.throw[0]), np.log(p.throw[1]))))
    throw = -size if rng.random() < p.reverse else size
    profile = ("uniform", "gaussian", "elliptic")[int(rng.choice(3, p=p.profiles))]
    listric = None
    if rng.random() < p.listric:
        listric = (rng.uniform(15.0, 30.0), rng.uniform(0.25, 0.5) * ns)
        profile = "uniform"
    settings = _sample_slip(rng, shape, throw, profile, p, free=listric is None)
    if rng.random() < p.curved:
        # Down dip the surface may steepen, but it must not turn over within the cube.
        steepen = 0.0 if listric else rng.uniform(-1.0, 1.0) * min(0.5, 1.1 / np.tan(np.deg2rad(dip))) / ns
        settings["bend"] = (rng.uniform(-1.0, 1.0) * 0.6 / nx, steepen)
        settings["ripple"] = (rng.uniform(0.0, 2.0), rng.uniform(0.4, 1.0) * nx, rng.uniform(0.0, 2.0 * np.pi))
    return SyntheticFault(
        tuple(float(c) for c in centre),  # type: ignore[arg-type]
        float(strike % 360.0),
        float(dip),
        throw,
        listric=listric,
        buried=bool(rng.random() < p.buried),
        **settings,  # type: ignore[arg-type]
    )


def _sample_slip(
    rng: np.random.Generator, shape: tuple[int, int, int], throw: float, profile: str, p: FaultPopulation, *, free: bool
) -> dict[str, object]:
    """Draw how the throw of one fault changes over its surface."""
    _, nx, ns = shape
    settings: dict[str, object] = {"profile": profile}
    if profile == "uniform":
        steepest = min(p.trend[1], 0.4 * ns / abs(throw))
        settings["trend"] = (rng.uniform(-1.0, 1.0) * p.trend[0] / nx, rng.uniform(-1.0, 1.0) * steepest / ns)
    else:
        floor = abs(throw) * (1.6 if profile == "gaussian" else 4.0)
        low, high = (0.35, 0.7) if profile == "gaussian" else (0.5, 0.9)
        settings["semi_axes"] = (rng.uniform(low, high) * nx * 1.2, max(rng.uniform(low, high) * ns, floor))
        settings["share"] = float(rng.choice([0.5, 1.0]))
    if profile == "elliptic":
        settings["drag"] = max(rng.uniform(0.4, 0.9) * nx, 4.0 * abs(throw))
    if free and rng.random() < p.oblique:
        settings["rake_deg"] = rng.uniform(60.0, 120.0)
    return settings
