"""Where things lie in a 3D scene: index coordinates to a box with true bins, samples downwards, never mirrored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_number
from seismo3d.errors import GeometryError, ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.plot.pictures import axis_coordinates, axis_labels, live_traces, name_axes


@dataclass(frozen=True, slots=True, eq=False)
class SceneFrame:
    """How index coordinates become scene coordinates.

    Attributes
    ----------
    order : (int, int)
        The cube's axes that run to the right and to the back of the scene.
    scale : ndarray of shape (3,), float64
        Scene units a step along inline, crossline and sample; the longer horizontal side is 1.
    shape : tuple of int
        The cube's shape.
    """

    order: tuple[int, int]
    scale: Float64Array
    shape: tuple[int, int, int]

    @classmethod
    def from_cube(cls, cube: Any, *, height: float) -> SceneFrame:
        """Lay out a cube; ``height`` is that of the scene over its longer horizontal side.

        Bins have their true proportions where the cube lies on a map. Seen from above, the scene has the handedness of
        the map: crosslines to the right and inlines to the back, or the other way round.
        """
        if len(name_axes(cube)) != 3:
            raise ShapeError(f"cube has shape {np.shape(cube)}: a section is not a scene. Use plot.section.")
        height = as_number(height, "height", low=0.01, high=100)
        shape = (int(cube.shape[0]), int(cube.shape[1]), int(cube.shape[2]))
        bins, right_handed = np.ones(2), True
        try:
            survey = SurveyGeometry.from_cube(cube)
            right_handed = survey.is_right_handed
            if survey.has_map:
                bins = np.array(survey.bin_size)
        except GeometryError:
            # line numbers with gaps have no bin size: square bins
            pass
        sides = bins * np.maximum(np.array(shape[:2]) - 1, 1)
        vertical = height / max(shape[2] - 1, 1)
        order = (1, 0) if right_handed else (0, 1)
        return cls(order, np.array([*(bins / sides.max()), vertical]), shape)

    def place(self, points: AnyArray) -> Float64Array:
        """Carry index points (n, 3) to scene coordinates (right, back, up)."""
        scaled = np.asarray(points, dtype=np.float64) * self.scale
        return np.stack([scaled[:, self.order[0]], scaled[:, self.order[1]], -scaled[:, 2]], axis=1)

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """Scene coordinates of the box: left, right, front, back, bottom, top."""
        far = (np.array(self.shape) - 1) * self.scale
        return 0.0, float(far[self.order[0]]), 0.0, float(far[self.order[1]]), -float(far[2]), 0.0

    def axis_ranges(self, cube: Any) -> list[float]:
        """Coordinates of the cube at the box's bounds, in the order of :attr:`bounds`."""
        ends = [axis_coordinates(cube, axis)[[0, -1]] for axis in range(3)]
        pairs = [ends[self.order[0]], ends[self.order[1]], ends[2][::-1]]
        return [float(value) for pair in pairs for value in pair]

    def axis_titles(self, cube: Any) -> tuple[str, str, str]:
        """Return what is written beside the axes right, back and up."""
        names = axis_labels(cube)
        return names[self.order[0]], names[self.order[1]], names[2]


def slice_points(frame: SceneFrame, axis: int, index: int) -> tuple[Float64Array, tuple[int, int]]:
    """Index points of one slice, row by row, and its shape."""
    shape = tuple(n for k, n in enumerate(frame.shape) if k != axis)
    first, second = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")
    columns = [first.ravel(), second.ravel()]
    columns.insert(axis, np.full(first.size, float(index)))
    return np.stack(columns, axis=1), (shape[0], shape[1])


def far_slices(cube: Any) -> tuple[int, int, int]:
    """Choose the back walls and the floor: the last lines that are nine tenths as full as the fullest."""
    live = live_traces(cube)
    walls = []
    for axis in (0, 1):
        share = live.mean(axis=1 - axis)
        full = np.flatnonzero(share >= 0.9 * share.max())
        # the outermost lines of a survey are often poor: stay a sixty-fourth inside
        walls.append(int(full[-1 - len(full) // 64]))
    return walls[0], walls[1], int(cube.shape[2]) - 1
