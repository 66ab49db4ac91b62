"""Folding: layers bent by sums of 2D Gaussians whose height grows linearly with depth, and sheared by a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_cube_shape, as_number, as_numbers, as_whole_number, check_generator
from seismo3d.synthetic import _kernels as kernels


@dataclass(frozen=True, slots=True, eq=False)
class Folding:
    """Vertical shift of the layers; added to the sample index it gives the layer time.

    Attributes
    ----------
    bumps : ndarray of shape (n, 4), float64
        Centre (inline, crossline), 1 / (2 sigma^2), height in samples, one Gaussian a row.
    terms : ndarray of shape (7,), float64
        Base and gain a sample of the scale, constant, slopes along inline and crossline, centre of the plane.
    """

    bumps: Float64Array
    terms: Float64Array

    def shift(self, inline: float, crossline: float, sample: float) -> float:
        """Return the shift in samples at one point."""
        return float(kernels.fold_shift(inline, crossline, sample, self.bumps, self.terms))


def sample_folding(
    rng: np.random.Generator,
    shape: tuple[int, int, int],
    *,
    slope: float,
    tilt: float,
    n_bumps: int = 14,
    width: tuple[float, float] = (0.1, 0.3),
    base: float = 0.25,
) -> Folding:
    r"""Draw a random folding of a given steepness.

    As in [1]_: :math:`s_1 = z \sum_k b_k \exp(-r_k^2 / 2 \sigma_k^2)` and a shear plane
    :math:`s_2 = e + f x + g y`; the Gaussians are scaled so that the steepest layer at the base of the cube has the
    wanted slope.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    shape : tuple of int
        Cube's (inline, crossline, sample) size.
    slope : float
        Steepest slope of the folds in samples a trace, at the base of the cube.
    tilt : float
        Slope of the plane in samples a trace; its direction is random.
    n_bumps : int
        Number of Gaussians, 10,000 at most.
    width : tuple of float
        Range of their standard deviations, as shares of the larger horizontal size.
    base : float
        Share of the folding at the top of the cube.

    Returns
    -------
    Folding
        With layer time growing with depth everywhere.

    References
    ----------
    .. [1] X. Wu et al., Geophysics 84(3), IM35-IM45, 2019. :doi:`10.1190/geo2018-0646.1`
    """
    check_generator(rng)
    ni, nx, ns = as_cube_shape(shape)
    for name, number in (("slope", slope), ("tilt", tilt), ("base", base)):
        as_number(number, name)
    as_numbers(width, "width", n=2, low=0.0)
    n_bumps = as_whole_number(n_bumps, "n_bumps", low=0, high=10_000)
    size = float(max(ni, nx))
    sigma = rng.uniform(width[0], width[1], n_bumps) * size
    centre = rng.uniform(-0.15, 1.15, (n_bumps, 2)) * (ni, nx)
    height = rng.uniform(-1.0, 1.0, n_bumps) * sigma
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    bumps = np.column_stack([centre, 0.5 / sigma**2, height])
    grid_i, grid_x = np.meshgrid(np.arange(0, ni, max(1, ni // 48)), np.arange(0, nx, max(1, nx // 48)), indexing="ij")
    value, steepness = _relief(grid_i.ravel().astype(float), grid_x.ravel().astype(float), bumps)
    factor = slope / max(steepness, 1e-12)
    gain = (1.0 - base) / ns
    factor = min(factor, 0.6 / max(gain * float(np.abs(value).max()), 1e-12))
    bumps[:, 3] *= factor
    plane = (tilt * np.cos(azimuth), tilt * np.sin(azimuth), 0.5 * ni, 0.5 * nx)
    return Folding(bumps, np.array([base, gain, 0.0, *plane]))


def flat_folding() -> Folding:
    """Return the folding that leaves every layer flat."""
    return Folding(np.zeros((0, 4)), np.zeros(7))


def _relief(i: Float64Array, x: Float64Array, bumps: Float64Array) -> tuple[Float64Array, float]:
    di, dx = i[:, None] - bumps[:, 0], x[:, None] - bumps[:, 1]
    gauss = bumps[:, 3] * np.exp(-(di**2 + dx**2) * bumps[:, 2])
    slope = np.hypot((-2 * di * bumps[:, 2] * gauss).sum(1), (-2 * dx * bumps[:, 2] * gauss).sum(1))
    return gauss.sum(1), float(slope.max())
