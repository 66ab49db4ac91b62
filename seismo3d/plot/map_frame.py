"""How views from above lie on the page: crosslines to the right, bins in their true proportions, never mirrored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.errors import GeometryError, ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.plot.drawing import label_axes
from seismo3d.plot.pictures import at_index, axis_coordinates, axis_labels, name_axes, outer_edges


@dataclass(frozen=True, slots=True, eq=False)
class MapFrame:
    """Where the traces of a cube lie on a view from above.

    Attributes
    ----------
    rows, columns : ndarray, float64
        Numbers of the inlines and of the crosslines.
    row_name, column_name : str
        What they are, to be written beside the axes.
    inlines_up : bool
        Whether the inline index grows upwards on the page.
    bins : (float, float)
        How high and how wide a bin is drawn, one in proportion to the other.
    """

    rows: Float64Array
    columns: Float64Array
    row_name: str
    column_name: str
    inlines_up: bool
    bins: tuple[float, float]

    @classmethod
    def from_cube(cls, cube: Any) -> MapFrame:
        """Lay out the traces of a cube of 3 axes; without a map bins are square and inlines go downwards."""
        if len(name_axes(cube)) != 3:
            raise ShapeError(f"cube has shape {np.shape(cube)}: a section has no map. Use plot.section.")
        up, bins = False, (1.0, 1.0)
        try:
            survey = SurveyGeometry.from_cube(cube)
            up = survey.inlines_up
            # of a single line a bin has no width, and of crooked ones none to go by
            if 0.1 <= survey.bin_size[0] / (survey.bin_size[1] or np.nan) <= 10.0:
                bins = survey.bin_size
        except GeometryError:
            # line numbers with gaps lie on no grid
            pass
        row_name, column_name, *_ = axis_labels(cube)
        return cls(axis_coordinates(cube, 0), axis_coordinates(cube, 1), row_name, column_name, up, bins)

    def place(self, points: AnyArray) -> Float64Array:
        """Carry index points (n, 2 or 3) to (crossline, inline) numbers, as x and y of the page."""
        points = np.asarray(points, dtype=np.float64)
        return np.stack([at_index(self.columns, points[:, 1]), at_index(self.rows, points[:, 0])], axis=1)

    def lay_out(self, ax: Any) -> None:
        """Show the whole survey, to the outer edges of its bins."""
        ax.set(xlim=sorted(outer_edges(self.columns)), ylim=sorted(outer_edges(self.rows)))
        self.turn(ax)

    def turn(self, ax: Any) -> None:
        """Name the axes, and give them the map's proportions and handedness, whatever part of it they show."""
        label_axes(ax, self.column_name, self.row_name)
        (first, last), (left, right) = outer_edges(self.rows), outer_edges(self.columns)
        ax.xaxis.set_inverted(right < left)
        ax.yaxis.set_inverted((last < first) == self.inlines_up)
        # height of an inline number over width of a crossline number
        height, width = (
            self.bins[0] * len(self.rows) / abs(last - first),
            self.bins[1] * len(self.columns) / abs(right - left),
        )
        ax.set_aspect(height / width)
