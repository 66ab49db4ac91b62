"""Fault sticks in the ASCII forms that OpendTect and Petrel read.

- OpendTect (Survey > Import > Faults > ASCII, "Import Multiple Faults"): columns fault name, x, y, z, stick index,
  node index. Without map coordinates the second and third column are inline and crossline, which its import dialog
  takes too.
- Petrel ("Charisma fault sticks (ASCII)"): ``INLINE- inline crossline x y z fault_name stick_number``, also read by
  many others.

Both have no header line. z grows downwards, in ms or m; nodes run from the top of a stick to its foot.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.io._files import written_aside


@dataclass(frozen=True, slots=True, eq=False)
class FaultStick:
    """One picked line down a fault.

    Attributes
    ----------
    fault : str
        The fault's name, without blanks.
    number : int
        The stick's number within its fault, from 1.
    points : ndarray of shape (n, 3), float64
        x, y, z of the nodes from top to foot.
    lines : ndarray of shape (n, 2), float64
        Inline and crossline numbers of the nodes; not whole between lines.
    """

    fault: str
    number: int
    points: Float64Array
    lines: Float64Array


def write_opendtect_sticks(path: str | Path, sticks: Iterable[FaultStick]) -> None:
    """Write sticks for OpendTect: fault name, x, y, z, stick index, node index.

    Parameters
    ----------
    path : str or Path
        The file.
    sticks : iterable of FaultStick
        The sticks.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    with written_aside(path) as aside, aside.open("wb") as file:
        for stick in sticks:
            for node, (x, y, z) in enumerate(stick.points, start=1):
                file.write(f"{stick.fault}\t{x:.2f}\t{y:.2f}\t{z:.3f}\t{stick.number}\t{node}\n".encode())


def write_charisma_sticks(path: str | Path, sticks: Iterable[FaultStick]) -> None:
    """Write sticks for Petrel in Charisma's form.

    Line numbers are rounded to whole lines, as the format wants them; x and y stay exact.

    Parameters
    ----------
    path : str or Path
        The file.
    sticks : iterable of FaultStick
        The sticks.

    Raises
    ------
    FileAccessError
        If the folder cannot be written to.
    """
    with written_aside(path) as aside, aside.open("wb") as file:
        for stick in sticks:
            lines = np.rint(stick.lines).astype(np.int64)
            for (inline, crossline), (x, y, z) in zip(lines, stick.points, strict=True):
                place = f"{inline:>8d} {crossline:>8d} {x:>15.2f} {y:>15.2f} {z:>12.3f}"
                file.write(f"INLINE- {place} {stick.fault} {stick.number:>6d}\n".encode())
