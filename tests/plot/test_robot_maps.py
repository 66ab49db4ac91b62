from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from seismo3d import plot
from seismo3d.robot import Occupancy, Planner, RobotLimits


def test_map_shows_cells_where_they_are_and_the_path_on_them():
    cells = np.zeros((40, 60), np.uint8)
    cells[20:24, 30:34], cells[30:, 50:] = 1, 2
    occupancy = Occupancy(cells, np.zeros((40, 60)), 0.1, (5.0, -2.0))
    planner = Planner(occupancy, (6.0, 0.0), (10.0, 0.0), robot=RobotLimits(radius=0.2))
    path = planner.plan()
    ax = plot.occupancy_map(occupancy, path=path, traversability=planner.traversability)
    try:
        image = ax.images[0]
        assert tuple(image.get_extent()) == occupancy.extent
        assert image.origin == "lower"
        colours = np.asarray(image.get_array())
        assert colours[21, 31].max() < 0.3 < colours[5, 5].min()
        assert not np.allclose(colours[21, 28], colours[10, 20])  # kept off
        segments = ax.collections[-1].get_segments()
        np.testing.assert_allclose(segments[0][0], path.poses[0, :2])
        np.testing.assert_allclose(segments[-1][-1], path.poses[-1, :2])
        names = [text.get_text() for text in ax.get_legend().get_texts()]
        assert names == ["start", "goal", "free", "occupied", "unknown", "not for its middle"]
    finally:
        plt.close(ax.figure)


def test_a_path_that_was_not_found_is_not_drawn():
    cells = np.zeros((40, 60), np.uint8)
    cells[:, 30] = 1
    occupancy = Occupancy(cells, np.zeros((40, 60)), 0.1)
    path = Planner(occupancy, (1.0, 2.0), (5.0, 2.0)).plan()
    assert path.state == "no way"
    figure, given = plt.subplots()
    try:
        ax = plot.occupancy_map(occupancy, path=path, ax=given)
        assert ax is given
        assert not ax.collections
        assert not ax.lines
    finally:
        plt.close(figure)
