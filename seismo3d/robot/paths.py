"""Paths: where a robot is to be, when, and how fast."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np

from seismo3d._typing import Float64Array

COLUMNS = ("time", "x", "y", "heading", "speed", "curvature", "world_x", "world_y", "world_z")


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A way of a robot's middle over the ground, or word that there is none.

    Attributes
    ----------
    state : str
        "found"; or "no way" that keeps within the limits, "start blocked" or "goal blocked" since the map has
        changed: then all arrays are empty and the cost is infinite.
    poses : ndarray of shape (n, 3), float64
        x and y (metres) and heading (radians, counterclockwise from x, continuous) in map axes. They begin and end in
        the middle of the start's and the goal's cell, with one of the lattice's 16 headings.
    length : ndarray of shape (n,), float64
        Metres gone since the start.
    times, speeds : ndarray of shape (n,), float64
        Seconds since the start, and metres a second.
    curvature : ndarray of shape (n,), float64
        Of the piece that begins at each point, one over metres, positive to the left; at the end, of the last one.
    points_world : ndarray of shape (n, 3), float64
        On the ground, in the world's frame.
    cost : float
        Metres, each counted as many times as the ground there costs, 1 on open and level ground, and turns a tenth
        more.
    expansions : int
        Vertices of the lattice that were expanded for it.
    """

    state: str
    poses: Float64Array
    length: Float64Array
    times: Float64Array
    speeds: Float64Array
    curvature: Float64Array
    points_world: Float64Array
    cost: float
    expansions: int

    def save_csv(self, path: str | FilePath) -> None:
        """Write one point a row: time, x, y, heading, speed, curvature, world_x, world_y, world_z; SI units.

        Raises
        ------
        FileAccessError
            If it cannot be written.
        """
        from seismo3d.io.tables import write_csv

        table = np.column_stack([self.times, self.poses, self.speeds, self.curvature, self.points_world])
        write_csv(path, [dict(zip(COLUMNS, row, strict=True)) for row in table.tolist()], columns=COLUMNS)
