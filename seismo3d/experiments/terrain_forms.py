"""Made-up terrain whose faults are known: scarps of many kinds, and forms without a fault that look like one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.special import erf

from seismo3d._typing import Float64Array
from seismo3d.experiments.worn_terrain import make_worn_mountains


@dataclass(frozen=True, slots=True)
class ScarpCase:
    """A scarp and the ground that it cuts.

    Attributes
    ----------
    cell : float
        Side of a cell, in metres.
    height : float
        Vertical separation, in metres; at the middle where it tapers.
    age : float
        Diffusivity times age, in square metres: the step is an error function of width twice its root.
    noise : float
        Standard deviation of the elevations' noise, in metres.
    relief : float
        Root mean square slope of the ground that is cut, a fractal surface smoothed over two cells.
    gullies : int
        Channels that cross the scarp, as deep as a third of its height to all of it.
    wave : float
        Amplitude of the trace's windings, in cells.
    taper : bool
        Whether the height falls to zero at both ends of the map.
    """

    cell: float = 1.0
    height: float = 2.0
    age: float = 10.0
    noise: float = 0.05
    relief: float = 0.03
    gullies: int = 0
    wave: float = 0.0
    taper: bool = False


SCARPS = {
    "1 m, 2 m high, young": ScarpCase(),
    "1 m, 1 m high": ScarpCase(height=1.0),
    "1 m, 0.5 m high": ScarpCase(height=0.5, age=4.0),
    "1 m, 5 m high, old": ScarpCase(height=5.0, age=100.0),
    "1 m, 2 m high, old": ScarpCase(age=50.0),
    "1 m, 10 m high, very old": ScarpCase(height=10.0, age=250.0),
    "1 m, 2 m high, noise 0.3 m": ScarpCase(noise=0.3),
    "1 m, 2 m high, gullies": ScarpCase(gullies=10),
    "1 m, 2 m high, rough ground": ScarpCase(relief=0.1),
    "1 m, 2 m high, winding, tapered": ScarpCase(wave=3.0, taper=True),
    "5 m, 5 m high": ScarpCase(cell=5.0, height=5.0, age=100.0, noise=0.3, relief=0.05),
    "10 m, 10 m high, gullies": ScarpCase(cell=10.0, height=10.0, age=200.0, noise=1.0, relief=0.05, gullies=10),
    "30 m, 60 m high": ScarpCase(cell=30.0, height=60.0, age=3000.0, noise=3.0, relief=0.1, gullies=10),
    "90 m, 200 m high": ScarpCase(cell=90.0, height=200.0, age=30000.0, noise=5.0, relief=0.1, gullies=10),
}
"""Scarps by name; the name begins with the side of a cell."""


def make_fractal(n: int, rng: np.random.Generator, *, hurst: float = 0.8) -> Float64Array:
    """Return an isotropic fractal surface of n x n cells with a root mean square slope of one along rows and columns.

    Parameters
    ----------
    n : int
    rng : numpy.random.Generator
    hurst : float
        Exponent of the surface: 0.5 is rough, 1 is smooth.
    """
    frequency = np.fft.fftfreq(n)
    size = np.hypot(frequency[:, None], frequency[None, :])
    size[0, 0] = np.inf
    z = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=(n, n))) * size ** -(hurst + 1.0)))
    gy, gx = np.gradient(z)
    return np.asarray(z / np.sqrt(0.5 * (gy**2 + gx**2).mean()))


def make_scarp(
    case: ScarpCase, n: int, strike_deg: float, rng: np.random.Generator
) -> tuple[Float64Array, Float64Array]:
    """Return elevations of n x n cells in metres, and the signed distance of every cell from the fault, in cells.

    The fault runs through the middle; strikes are clockwise from up.
    """
    i, j = np.mgrid[:n, :n] - 0.5 * (n - 1)
    a = np.radians(strike_deg)
    across, along = j * np.cos(a) + i * np.sin(a), i * np.cos(a) - j * np.sin(a)
    distance = across + case.wave * np.sin(along / 40.0)
    ground = ndimage.gaussian_filter(make_fractal(n, rng), 2.0) * case.relief * case.cell
    height = case.height * (np.sqrt(np.clip(1.0 - (along / (0.5 * n)) ** 2, 0.0, None)) if case.taper else 1.0)
    z = ground - 0.05 * distance * case.cell
    z -= 0.5 * height * erf(distance * case.cell / (2.0 * np.sqrt(case.age)))
    for _ in range(case.gullies):
        course = ndimage.gaussian_filter1d(rng.normal(size=2 * n), 8.0) * 15.0 + rng.uniform(-0.5 * n, 0.5 * n)
        aside = along - course[np.clip((across + n).astype(np.int64), 0, 2 * n - 1)]
        z -= rng.uniform(0.3, 1.0) * case.height * np.exp(-0.5 * (aside / rng.uniform(1.5, 4.0)) ** 2)
    return z + rng.normal(0.0, case.noise, z.shape), distance


def mean_height(case: ScarpCase) -> float:
    """Return a scarp's height on the mean along its trace, in metres."""
    # an ellipse where it tapers
    return case.height * (0.25 * np.pi if case.taper else 1.0)


def make_hill(n: int, rng: np.random.Generator) -> Float64Array:
    """Return one smooth round hill."""
    i, j = np.mgrid[:n, :n] - rng.uniform(0.4, 0.6, 2)[:, None, None] * n
    return np.asarray(60.0 * np.exp(-(i**2 + j**2) / (2.0 * (0.16 * n) ** 2)))


def make_noisy_plane(n: int, rng: np.random.Generator) -> Float64Array:
    """Return a plane with white noise."""
    i, j = np.mgrid[:n, :n].astype(np.float64)
    return 0.1 * i + 0.05 * j + rng.normal(0.0, 0.1, i.shape)


def make_rivers(n: int, rng: np.random.Generator) -> Float64Array:
    """Return a tilted plain that winding rivers are cut into."""
    i, j = np.mgrid[:n, :n].astype(np.float64)
    z = 0.02 * (n - 1 - i)
    for k, course in enumerate(np.linspace(0.16, 0.8, 4) * n):
        phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        winding = 12.0 * np.sin(i / (14.0 + 3.0 * k) + phase[0]) + 6.0 * np.sin(i / 7.3 + phase[1])
        z -= 3.0 * np.exp(-((j - course - winding) ** 2) / 18.0)
    return z + rng.normal(0.0, 0.02, z.shape)


def make_dunes(n: int, rng: np.random.Generator) -> Float64Array:
    """Return transverse dunes: crests some 30 cells apart that wind and end, steep on one side."""
    wind = rng.uniform(0.0, 2.0 * np.pi)
    i, j = np.mgrid[:n, :n].astype(np.float64)
    warp, size = (ndimage.gaussian_filter(rng.normal(size=(n, n)), w, mode="wrap") for w in (20.0, 25.0))
    phase = ((j * np.cos(wind) + i * np.sin(wind)) / 30.0 + warp / (3.0 * warp.std())) % 1.0
    profile = np.where(phase < 0.75, phase / 0.75, (1.0 - phase) / 0.25)
    z = 3.0 * (1.0 + 0.5 * size / size.std()) * profile
    return ndimage.gaussian_filter(z, 1.2) + rng.normal(0.0, 0.02, z.shape)


def make_terraces(n: int, rng: np.random.Generator) -> Float64Array:
    """Return slopes laid out in terraces of 3 m along the contours."""
    level = ndimage.gaussian_filter(make_fractal(n, rng, hurst=1.0) * 0.2, 4.0) / 3.0
    whole = np.floor(level)
    z = 3.0 * (whole + np.clip((level - whole - 0.8) / 0.2, 0.0, 1.0))
    return ndimage.gaussian_filter(z, 0.7) + rng.normal(0.0, 0.05, z.shape)


def make_road(n: int, rng: np.random.Generator) -> Float64Array:
    """Return hills with a winding road cut into and banked up on them."""
    z = ndimage.gaussian_filter(make_fractal(n, rng) * 0.15, 3.0)
    course = 0.5 * n + 100.0 * ndimage.gaussian_filter1d(rng.normal(size=n), 25.0)
    aside = (np.arange(n)[None, :] - course[:, None]) / np.hypot(1.0, np.gradient(course))[:, None]
    own = z[np.arange(n), np.clip(course.astype(np.int64), 0, n - 1)]
    share = np.clip((6.0 - np.abs(aside)) / 3.0, 0.0, 1.0)
    bed = ndimage.gaussian_filter1d(own, 10.0)[:, None]
    return z * (1.0 - share) + bed * share + rng.normal(0.0, 0.03, z.shape)


def make_valleys(n: int, rng: np.random.Generator) -> Float64Array:
    """Return a mountain side with valleys and spurs that run down it."""
    i = np.arange(n, dtype=np.float64)[:, None]
    shape = ndimage.gaussian_filter(rng.normal(size=(n, n)), (40.0, 8.0), mode="wrap")
    ground = ndimage.gaussian_filter(make_fractal(n, rng) * 0.2, 2.0)
    return -0.3 * i + 8.0 * np.abs(shape / shape.std()) ** 0.8 + ground


def _fractal_of(hurst: float, width: float) -> Callable[[int, np.random.Generator], Float64Array]:
    def make(n: int, rng: np.random.Generator) -> Float64Array:
        z = 0.3 * make_fractal(n, rng, hurst=hurst)
        return ndimage.gaussian_filter(z, width) if width else z

    return make


FORMS: dict[str, Callable[[int, np.random.Generator], Any]] = {
    "smooth hill": make_hill,
    "noisy plane": make_noisy_plane,
    "rivers": make_rivers,
    "rough fractal": _fractal_of(0.5, 0.0),
    "fractal": _fractal_of(0.8, 0.0),
    "smooth fractal": _fractal_of(1.0, 2.0),
    "dunes": make_dunes,
    "terraces": make_terraces,
    "winding road": make_road,
    "valleys": make_valleys,
    "worn mountains": lambda n, rng: make_worn_mountains(n, rng)[0],
}
"""Terrain without a fault, by name."""
