from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from seismo3d.seismic.sheet_distances import SheetNodes, are_near, bounds_of, within_box
from seismo3d.seismic.sheets import Sheet


def bent_sheet(rng, origin, strike_deg, rows=40, columns=30):
    across = np.array([np.cos(np.radians(strike_deg)), np.sin(np.radians(strike_deg))])
    w = 0.4 * np.arange(columns)[None, :] + 3.0 * np.sin(0.2 * np.arange(rows))[:, None]
    w = np.where(rng.random(w.shape) < 0.9, w, np.nan).astype(np.float32)
    return Sheet(np.array(origin), across, 10, 2, -20.0, w, np.ones_like(w))


@pytest.mark.parametrize("distance", [0.8, 2.5, 8.0, 30.0])
@pytest.mark.parametrize("origin", [(20.0, 20.0), (26.0, 18.0), (45.0, 20.0), (-300.0, 0.0)])
def test_nodes_within_a_distance_are_those_that_all_distances_tell(rng, origin, distance):
    one = SheetNodes.of(bent_sheet(rng, (20.0, 20.0), 10.0))
    other = SheetNodes.of(bent_sheet(rng, origin, 75.0))
    expected = cdist(one.points, other.points).min(axis=1) < distance
    np.testing.assert_array_equal(one.are_within(other, distance), expected)
    assert one.touches(other, distance) == expected.any()
    assert other.touches(one, distance) == expected.any()


def test_every_node_lies_in_its_cell(rng):
    nodes = SheetNodes.of(bent_sheet(rng, (-7.0, 3.0), 40.0))
    assert np.abs(nodes.points - nodes.cells[nodes.cell]).max() <= 4.0
    assert len(np.unique(nodes.cells, axis=0)) == len(nodes.cells) < len(nodes.points) / 4


def test_boxes():
    points = np.array([[0.0, 0.0], [4.0, 2.0]])
    bounds = bounds_of(points)
    np.testing.assert_array_equal(bounds, [[0.0, 0.0], [4.0, 2.0]])
    near = within_box(np.array([[5.0, 3.0], [5.1, 1.0], [2.0, -1.0]]), bounds, 1.0)
    np.testing.assert_array_equal(near, [True, False, True])
    assert are_near(bounds, bounds + 5.0, 3.0)
    assert not are_near(bounds, bounds + 5.0, 2.9)
