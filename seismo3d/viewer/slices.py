"""Slices of a cube at the detail that a screen can show, read one at a time: the cube itself is never in memory."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.errors import ShapeError
from seismo3d.plot.drawing import amplitude_limits
from seismo3d.plot.pictures import is_live_counted, live_traces, name_axes

_KEPT_BYTES = 256 * 2**20
# percentile of the amplitude's size that gets the strongest colour
_CLIP = 99.0
# samples that are read down the traces of a lazy cube to tell which are dead
_LOOKS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """One slice, perhaps thinned out.

    Attributes
    ----------
    values : ndarray of shape (rows, columns), float32
        Amplitudes, NaN where there are none, as on traces that the cube says are not live; of a lazy cube that has not
        counted them, on traces that are zero wherever they are looked at. A vertical slice has samples as rows and
        traces as columns, a horizontal one inlines as rows and crosslines as columns.
    steps : (int, int)
        Of how many rows and columns one was taken.
    shape : (int, int)
        Rows and columns of the whole slice.
    """

    values: Float32Array
    steps: tuple[int, int]
    shape: tuple[int, int]

    @property
    def is_full(self) -> bool:
        """Whether nothing was left out."""
        return self.steps == (1, 1)


class SliceReader:
    """Reads slices of a cube and keeps the latest, up to 256 MiB.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube (inline, crossline, sample), in memory or lazy.

    Raises
    ------
    ShapeError
        If it has another number of axes.
    """

    def __init__(self, cube: Any) -> None:
        if len(name_axes(cube)) != 3:
            raise ShapeError(
                f"cube has shape {np.shape(cube)}; expected (inline, crossline, sample). Draw a line by plot.section."
            )
        self._data = cube.data if hasattr(cube, "dims") else cube
        self.shape: tuple[int, int, int] = (int(cube.shape[0]), int(cube.shape[1]), int(cube.shape[2]))
        self.is_lazy = not isinstance(self._data, np.ndarray)
        self._live = live_traces(cube)
        # dead traces are zero in the file; those of a lazy cube are not counted yet
        self._is_counted = is_live_counted(cube)
        self._alive_above: dict[tuple[int, int], BoolArray] = {}
        self._kept: OrderedDict[tuple[int, int, int], Slice] = OrderedDict()
        self._lock = threading.Lock()

    def read(self, axis: int, index: int, *, most: int = 1024) -> Slice:
        """Read one slice.

        Parameters
        ----------
        axis : int
            The axis that is held: 0 an inline, 1 a crossline, 2 a sample.
        index : int
            Where.
        most : int
            Largest number of rows, and of columns; where there are more, every second, third, ... is taken.

        Returns
        -------
        Slice
        """
        key = (axis, index, most)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        found = self._read(axis, index, most)
        with self._lock:
            self._kept[key] = found
            while len(self._kept) > 1 and sum(s.values.nbytes for s in self._kept.values()) > _KEPT_BYTES:
                self._kept.popitem(last=False)
        return found

    def _read(self, axis: int, index: int, most: int) -> Slice:
        sides = [n for k, n in enumerate(self.shape) if k != axis]
        steps = [-(-n // most) for n in sides]
        cut: list[Any] = [slice(None, None, step) for step in steps]
        cut.insert(axis, slice(index, index + 1))
        values = np.asarray(self._data[tuple(cut)], dtype=np.float32)
        live = self._live[tuple(cut[:2])] if self._is_counted else self._look_for_live(axis, values, cut)
        values = np.where(live[:, :, None], values, np.float32(np.nan)).squeeze(axis)
        if axis == 2:
            return Slice(values, (steps[0], steps[1]), (sides[0], sides[1]))
        return Slice(np.ascontiguousarray(values.T), (steps[1], steps[0]), (sides[1], sides[0]))

    def _look_for_live(self, axis: int, values: Float32Array, cut: list[Any]) -> BoolArray:
        """Tell which traces of a slice are live, by its own samples or, from above, by some samples down the traces."""
        if axis != 2:
            return (values != 0.0).any(axis=2)
        steps = (cut[0].step, cut[1].step)
        with self._lock:
            alive = self._alive_above.get(steps)
        if alive is None:
            down = slice(None, None, max(1, self.shape[2] // _LOOKS))
            alive = (np.asarray(self._data[(*cut[:2], down)]) != 0.0).any(axis=2)
            with self._lock:
                self._alive_above[steps] = alive
        return alive | (values[:, :, 0] != 0.0)

    def limits(self) -> tuple[float, float]:
        """Return the amplitudes that get the strongest colours, as three inlines tell; what is zero does not count."""
        n = self.shape[0]
        lines = [self.read(0, index, most=256).values for index in sorted({n // 4, n // 2, (3 * n) // 4})]
        values = np.concatenate([line.ravel() for line in lines])
        return amplitude_limits(values[values != 0], _CLIP)
