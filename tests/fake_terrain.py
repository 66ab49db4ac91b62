"""Made-up terrain whose answers are known."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from seismo3d.io.elevation import make_elevation

CELL = 10.0


def make_hills(shape: tuple[int, int], seed: int = 3) -> np.ndarray:
    """Smooth random relief of about 100 cells' elevation with features from 6 cells up."""
    rng = np.random.default_rng(seed)
    z = sum(w * ndimage.gaussian_filter(rng.normal(size=shape), w, mode="wrap") * w for w in (3.0, 8.0, 20.0))
    return 40.0 * z / z.std()


def place(values: np.ndarray, *, crs: str = "EPSG:32611", cell: float = CELL) -> Any:
    return make_elevation(values, (cell, 0.0, 400_000.0, 0.0, -cell, 3_800_000.0), crs=crs)


def shift(z: np.ndarray, columns: float, rows: float) -> np.ndarray:
    """Content moved right and down, exactly, on a periodic map."""
    return np.real(np.fft.ifft2(ndimage.fourier_shift(np.fft.fft2(z), (rows, columns))))


def make_rivers(n: int = 256, seed: int = 0) -> np.ndarray:
    """A tilted plain with winding rivers and their winding tributaries cut into it; nothing else."""
    rng = np.random.default_rng(seed)
    i, j = np.mgrid[:n, :n].astype(float)
    cut = np.zeros((n, n))
    rows = np.arange(n)
    for k in range(4):
        wind = ndimage.gaussian_filter1d(rng.normal(size=n), 8.0) * 30.0 + 12.0 * np.sin(rows / (13.0 + 3.0 * k) + k)
        course = 35.0 + 60.0 * k + wind
        cut = np.maximum(cut, 4.0 * np.exp(-((j - course[:, None]) ** 2) / 18.0))
        for start in rng.integers(30, n - 30, 4):
            side = rng.choice([-1.0, 1.0])
            reach = np.arange(40)
            y = start - 0.7 * reach + 5.0 * np.sin(reach / 6.0 + start)
            x = course[start] + side * reach + 3.0 * np.sin(reach / 4.0)
            distance = np.min((i[..., None] - y[::3]) ** 2 + (j[..., None] - x[::3]) ** 2, axis=-1)
            cut = np.maximum(cut, 2.5 * np.exp(-distance / 10.0))
    return 0.05 * (n - i) - cut + 0.02 * rng.normal(size=(n, n))


def make_scarp(n: int = 200, height: float = 3.0, azimuth_deg: float = 0.0, width: float = 3.0) -> np.ndarray:
    """A scarp through the middle of a rough, gently sloping plain; north is up, the lower side is clockwise of it."""
    from scipy.special import erf

    rng = np.random.default_rng(1)
    i, j = np.mgrid[:n, :n] - 0.5 * (n - 1)
    a = np.radians(azimuth_deg)
    across = j * np.cos(a) + i * np.sin(a)
    rough = ndimage.gaussian_filter(rng.normal(size=(n, n)), 3.0) * 0.15
    return 0.02 * across + rough - 0.5 * height * erf(across / width)
