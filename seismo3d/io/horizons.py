"""Horizons in the ASCII forms that other programs read: XYZ points, Charisma points, IRAP classic grids.

z grows downwards, in the cube's own unit. Charisma's rows name the lines: ``INLINE : n XLINE : m x y z``. An IRAP
classic grid (ROXAR text) has no line numbers; places without a value hold 9999900.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.errors import GeometryError
from seismo3d.io._files import written_aside

_UNKNOWN = 9999900.0


@dataclass(frozen=True, slots=True, eq=False)
class HorizonGrid:
    """A horizon on the traces of a survey.

    Attributes
    ----------
    x, y, z : ndarray of shape (inline, crossline), float64
        Map coordinates of the traces, and the horizon's time or depth; NaN where it is not known.
    inlines, crosslines : ndarray, float64
        Line numbers.
    """

    x: Float64Array
    y: Float64Array
    z: Float64Array
    inlines: Float64Array
    crosslines: Float64Array


def write_xyz_horizon(path: str | Path, horizon: HorizonGrid) -> None:
    """Write one row ``x y z`` for every trace with a value.

    Parameters
    ----------
    path : str or Path
        The file.
    horizon : HorizonGrid
        What to write.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    known = np.isfinite(horizon.z)
    with written_aside(path) as aside, aside.open("wb") as file:
        for x, y, z in zip(horizon.x[known], horizon.y[known], horizon.z[known], strict=True):
            file.write(f"{x:.2f} {y:.2f} {z:.4f}\n".encode())


def write_charisma_horizon(path: str | Path, horizon: HorizonGrid) -> None:
    """Write one row ``INLINE : n XLINE : m x y z`` for every trace with a value; parameters as of the XYZ form."""
    known = np.isfinite(horizon.z)
    lines = np.meshgrid(horizon.inlines, horizon.crosslines, indexing="ij")
    columns = [np.rint(line[known]).astype(np.int64) for line in lines]
    with written_aside(path) as aside, aside.open("wb") as file:
        for i, j, x, y, z in zip(*columns, horizon.x[known], horizon.y[known], horizon.z[known], strict=True):
            file.write(f"INLINE :{i:>8d} XLINE :{j:>8d} {x:>15.2f} {y:>15.2f} {z:>14.4f}\n".encode())


def write_irap_classic(path: str | Path, horizon: HorizonGrid) -> None:
    """Write an IRAP classic grid: a header with origin, steps and rotation, then six values a row.

    Parameters
    ----------
    path : str or Path
        The file.
    horizon : HorizonGrid
        Its traces must lie on a rectangular grid, which may be turned.

    Raises
    ------
    GeometryError
        If they do not.
    FileAccessError
        If the folder cannot be written to.
    """
    x, y, z = horizon.x, horizon.y, horizon.z
    if min(z.shape) < 2:
        raise GeometryError(f"horizon has {z.shape} traces; an IRAP grid needs two lines each way. Write XYZ.")
    along = np.array([x[-1, 0] - x[0, 0], y[-1, 0] - y[0, 0]]) / (z.shape[0] - 1)
    across = np.array([x[0, -1] - x[0, 0], y[0, -1] - y[0, 0]]) / (z.shape[1] - 1)
    if along[0] * across[1] - along[1] * across[0] < 0:  # columns must lie to the left of rows
        x, y, z, along, across = x.T, y.T, z.T, across, along
    step = np.hypot(*along), np.hypot(*across)
    if min(step) <= 0 or abs(along @ across) > 1e-3 * step[0] * step[1]:
        raise GeometryError("horizon's lines do not meet at right angles; an IRAP grid cannot hold it. Write XYZ.")
    rotation = np.degrees(np.arctan2(along[1], along[0]))
    n, m = z.shape
    ends = x[0, 0] + step[0] * (n - 1), y[0, 0] + step[1] * (m - 1)
    header = (
        f"-996 {m} {step[0]:.6f} {step[1]:.6f}\n{x[0, 0]:.6f} {ends[0]:.6f} {y[0, 0]:.6f} {ends[1]:.6f}\n"
        f"{n} {rotation:.6f} {x[0, 0]:.6f} {y[0, 0]:.6f}\n0 0 0 0 0 0 0\n"
    )
    values = np.where(np.isfinite(z), z, _UNKNOWN).T.ravel()
    rows = (" ".join(f"{v:.4f}" for v in values[k : k + 6]) for k in range(0, len(values), 6))
    with written_aside(path) as aside, aside.open("wb") as file:
        file.write((header + "\n".join(rows) + "\n").encode())
