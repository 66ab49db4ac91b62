from __future__ import annotations

import numpy as np

from seismo3d.seismic.sheets import Sheet


def test_grid_places_become_points():
    sheet = Sheet(
        np.array([3.0, 4.0]),
        np.array([0.6, 0.8]),
        10,
        2,
        -5.0,
        np.zeros((8, 6), np.float32),
        np.ones((8, 6), np.float32),
    )
    point = sheet.points(np.array([5.0, 6.0]), np.array([0.0, 1.5]), np.array([0.0, 2.0]))
    np.testing.assert_allclose(point, [[3, 4, 10], [3 - 0.8 + 1.2, 4 + 0.6 + 1.6, 13]])
    assert sheet.area == 96.0
