"""Mountains that rise while running water wears them down, with or without a zone of weak rock along a fault."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d._typing import Float64Array
from seismo3d.experiments._kernels_erosion import cut_in, drain

_STEPS = 300
_RISE = 0.3
"""Cells that the ground rises by in a step."""
_ERODIBILITY = 0.3
"""Times a step; per root of the cells that drain through."""
_CREEP = 0.6
"""Width, in cells, of the Gaussian that soil's creep blurs the ground by in a step."""
_SHORE = 24
"""Cells at each edge that are cut off: there all rivers run straight to the level that they end at."""


def make_worn_mountains(
    n: int,
    rng: np.random.Generator,
    *,
    weakness: float = 0.0,
    strike_deg: float = 0.0,
    width: float = 2.0,
    offset: float = 0.0,
) -> tuple[Float64Array, Float64Array]:
    r"""Return mountains with a branching drainage of their own, and the distance of every cell from the fault.

    The ground rises evenly, rivers cut into it by the stream power law, :math:`K A^{1/2} S` [1]_, and soil creeps.
    Along the fault rock is crushed: :math:`K` is larger there, and valleys and saddles line up on it although nothing
    moves. Without weakness valleys follow nothing but the slope and each other.

    Parameters
    ----------
    n : int
        Rows and columns.
    rng : numpy.random.Generator
    weakness : float
        Erodibility on the fault over that of the rock, less one.
    strike_deg : float
        Clockwise from up.
    width : float
        Width of the weak zone, as that of a Gaussian, in cells.
    offset : float
        Distance of the fault from the map's middle, in cells.

    Returns
    -------
    (ndarray, ndarray) of shape (n, n), float64
        Elevation and signed distance, both in cells.

    References
    ----------
    .. [1] J. Braun and S. D. Willett, Geomorphology 180-181, 170-179, 2013. :doi:`10.1016/j.geomorph.2012.10.008`
    """
    m = n + 2 * _SHORE
    i, j = np.mgrid[:m, :m] - 0.5 * (m - 1)
    a = np.radians(strike_deg)
    distance = j * np.cos(a) + i * np.sin(a) - offset
    # rock is never all alike
    rock = np.exp(0.2 * _even_noise(m, 3.0, rng))
    strength = _ERODIBILITY * rock * (1.0 + weakness * np.exp(-0.5 * (distance / width) ** 2))
    z = 0.15 * rng.random((m, m))
    receiver, order, area = np.empty(m * m, np.int64), np.empty(m * m, np.int64), np.empty(m * m)
    inside = np.zeros((m, m))
    inside[1:-1, 1:-1] = _RISE
    for _ in range(_STEPS):
        z = ndimage.gaussian_filter(z + inside, _CREEP, mode="nearest")
        drain(z, receiver, order, area)
        cut_in(z.ravel(), receiver, order, area, strength.ravel())
    inner = (slice(_SHORE, -_SHORE), slice(_SHORE, -_SHORE))
    return z[inner].copy(), distance[inner].copy()


def _even_noise(n: int, width: float, rng: np.random.Generator) -> Any:
    noise = ndimage.gaussian_filter(rng.normal(size=(n, n)), width, mode="wrap")
    return noise / noise.std()
