"""The affine map from line indices to metres, fitted to the coordinates of a file's traces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import ArrayLike, BoolArray, Float64Array
from seismo3d._validate import as_points
from seismo3d.errors import ShapeError

OFF_BINS = 0.5
"""Distance off the map, in bins, that is no rounding: coordinates farther off are wrong, or lie on no map."""
# the same in the deviation of the others
_OFF_SPREAD = 6.0
# of a normal distribution
_MEDIAN_TO_RMS = 1.4826
# share of the points that one map must hold before the others count as wrong
_LEAST_ON_MAP = 0.75
# most rounds of reweighted least squares
_N_STEPS = 60
# distances that weigh alike in the search for that map: in bins, and in coordinates
_ALIKE_BINS, _ALIKE = 0.01, 1e-12


@dataclass(frozen=True, slots=True)
class MapFit:
    """The affine map from fractional line indices to metres: ``(x, y) = origin + M @ (inline, crossline)``.

    Attributes
    ----------
    origin : (float, float)
        Map coordinates of index (0, 0).
    inline_step, crossline_step : (float, float)
        Map vector from one index to the next along axis 0 and along axis 1, the columns of M.
    rms : float
        Root mean square distance, in metres, of the points that it was fitted to.
    """

    origin: tuple[float, float]
    inline_step: tuple[float, float]
    crossline_step: tuple[float, float]
    rms: float = 0.0

    @property
    def matrix(self) -> Float64Array:
        """M, of shape (2, 2)."""
        return np.array([self.inline_step, self.crossline_step], dtype=np.float64).T

    @property
    def shorter_step(self) -> float:
        """Length on the map of the step to the next index, along the axis where that is less."""
        return float(min(np.hypot(*self.inline_step), np.hypot(*self.crossline_step)))

    def distances(self, indices: Float64Array, xy: Float64Array) -> Float64Array:
        """Distances between where the map places indices and where they are said to lie, shape (n,)."""
        return np.asarray(np.linalg.norm(indices @ self.matrix.T + np.array(self.origin) - xy, axis=1))


def fit_map(indices: ArrayLike, xy: ArrayLike) -> MapFit | None:
    """Fit map coordinates as an affine function of line indices, by least squares.

    Where that leaves more than half a bin, and three quarters of the points or more lie on one map, it is fitted to
    these: the coordinates of the others are wrong.

    Parameters
    ----------
    indices : array of shape (n, 2)
        Fractional (inline, crossline) indices.
    xy : array of shape (n, 2)
        Map coordinates in metres; rows that are not finite are left out.

    Returns
    -------
    MapFit or None
        None where the points do not span a plane, neither in index space nor on the map: then there is no map.
    """
    ij, metres = as_points(indices, "indices", dim=2), as_points(xy, "xy", dim=2, finite=False)
    if len(ij) != len(metres):
        raise ShapeError(f"indices has {len(ij)} rows and xy {len(metres)}; expected as many.")
    keep = np.isfinite(metres).all(axis=1)
    ij, metres = ij[keep], metres[keep]
    fit = _least_squares(ij, metres)
    if fit is None or fit.rms <= OFF_BINS * fit.shorter_step:
        return fit
    on_map = _on_one_map(ij, metres)
    return fit if on_map.mean() < _LEAST_ON_MAP else _least_squares(ij[on_map], metres[on_map])


def _least_squares(ij: Float64Array, metres: Float64Array) -> MapFit | None:
    if len(ij) < 3:
        return None
    centre, middle = ij.mean(axis=0), metres.mean(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(ij - centre, metres - middle, rcond=1e-9)
    if rank < 2:
        return None
    area = abs(np.linalg.det(solution))
    if area <= 1e-6 * max(float((solution**2).sum()), 1e-12):
        return None
    rms = float(np.sqrt(((metres - middle - (ij - centre) @ solution) ** 2).sum(axis=1).mean()))
    origin = middle - centre @ solution
    pairs = [(float(a), float(b)) for a, b in (origin, solution[0], solution[1])]
    return MapFit(pairs[0], pairs[1], pairs[2], rms)


def _on_one_map(ij: Float64Array, metres: Float64Array) -> BoolArray:
    """Tell the points that lie on the map of the least sum of distances.

    Wrong points do not move that map, however far off they are, up to a quarter of all, at one end of the survey.
    """
    terms = np.column_stack([np.ones(len(ij)), ij - np.median(ij, axis=0)])
    away = metres - np.median(metres, axis=0)
    off = np.ones(len(ij))
    alike = 0.0
    for _ in range(_N_STEPS):
        before, root = off, 1.0 / np.sqrt(np.maximum(off, alike))[:, None]
        solution = np.linalg.lstsq(root * terms, root * away, rcond=None)[0]
        off = np.linalg.norm(away - terms @ solution, axis=1)
        step = float(np.linalg.norm(solution[1:], axis=1).min())
        alike = max(_ALIKE_BINS * step, _ALIKE * float(np.abs(metres).max()))
        if np.abs(off - before).max() <= alike:
            break
    return np.asarray(off <= max(OFF_BINS * step, _OFF_SPREAD * _MEDIAN_TO_RMS * float(np.median(off))))
