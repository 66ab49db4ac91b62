"""The affine map from line indices to metres, fitted to the coordinates of a file's traces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_points
from seismo3d.errors import ShapeError


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


def fit_map(indices: ArrayLike, xy: ArrayLike) -> MapFit | None:
    """Fit map coordinates as an affine function of line indices, by least squares.

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
