"""Edge elements of images and volumes: where the gradient's magnitude peaks along its own direction."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array


def edge_elements(
    image: AnyArray, *, smoothing: float, share: float
) -> tuple[Float64Array, Float32Array, Float64Array]:
    """Return places (in array axis order, to a fraction of a pixel), unit normals and strengths of edges.

    Parameters
    ----------
    image : ndarray of 2 or 3 axes
        Real values; NaN counts as no edge.
    smoothing : float
        Standard deviation of the Gaussian that is differentiated, in pixels.
    share : float
        Share of the pixels, at most, that become edge elements: the strongest peaks.
    """
    from scipy import ndimage

    values = np.asarray(image, dtype=np.float32)
    holes = ~np.isfinite(values)
    if holes.any():
        values = np.where(holes, np.float32(np.mean(values[~holes])) if (~holes).any() else np.float32(0), values)
    d = values.ndim
    gradient = np.stack(
        [
            ndimage.gaussian_filter(values, smoothing, order=[int(a == k) for a in range(d)], mode="nearest")
            for k in range(d)
        ]
    )
    strength = np.sqrt((gradient**2).sum(axis=0))
    if holes.any():
        strength[ndimage.binary_dilation(holes, iterations=int(np.ceil(3 * smoothing)))] = 0.0
    margin = tuple(slice(2, -2) if n > 4 else slice(1, -1) for n in values.shape)
    inside = np.zeros(values.shape, dtype=bool)
    inside[margin] = True
    level = float(np.quantile(strength, 0.5))
    rows = np.argwhere(inside & (strength > level) & (strength > 1e-6 * (float(strength.max()) + 1e-30)))
    here = strength[tuple(rows.T)]
    normals = gradient[(slice(None), *rows.T)].T / here[:, None]
    ahead = ndimage.map_coordinates(strength, (rows + normals).T, order=1, mode="nearest")
    behind = ndimage.map_coordinates(strength, (rows - normals).T, order=1, mode="nearest")
    peak = (here > ahead) & (here >= behind)
    rows, here, normals, ahead, behind = (a[peak] for a in (rows, here, normals, ahead, behind))
    bend = np.maximum(2 * here - ahead - behind, 1e-12)
    places = rows + normals * np.clip(0.5 * (ahead - behind) / bend, -0.7, 0.7)[:, None]
    most = max(int(share * values.size), 1)
    if len(places) > most:
        keep = np.sort(np.argpartition(-here, most)[:most])
        places, normals, here = places[keep], normals[keep], here[keep]
    return places.astype(np.float64), normals.astype(np.float32), here.astype(np.float64)
