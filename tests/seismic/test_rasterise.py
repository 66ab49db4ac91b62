from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from seismo3d.seismic.rasterise import draw_sheets, sample_grid, sheet_voxels, to_likelihood
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetThrow

SHAPE = (30, 30, 40)


def plane(normal_deg=0.0, cotangent=0.3, *, step=2, outside=()):
    """A plane through the middle of the cube, larger than it."""
    angle = np.radians(normal_deg)
    rows, columns = 61, 40 // step
    w = np.broadcast_to(cotangent * (step * np.arange(columns) - 20.0), (rows, columns)).astype(np.float32).copy()
    for row, column in outside:
        w[row, column] = np.nan
    score = np.where(np.isfinite(w), 1.0, np.nan).astype(np.float32)
    return Sheet(np.array([15.0, 15.0]), np.array([np.cos(angle), np.sin(angle)]), 0, step, -30.0, w, score)


def off(voxels, normal_deg, cotangent):
    angle = np.radians(normal_deg)
    return (voxels[:, 0] - 15) * np.cos(angle) + (voxels[:, 1] - 15) * np.sin(angle) - cotangent * (voxels[:, 2] - 20.0)


@pytest.mark.parametrize("normal_deg", [0.0, 30.0, 45.0, 90.0, 215.0])
@pytest.mark.parametrize("cotangent", [0.0, 0.3, -0.8])
def test_voxels_are_those_that_the_plane_passes_through(normal_deg, cotangent):
    voxels, places = sheet_voxels(plane(normal_deg, cotangent), SHAPE)
    assert ((voxels >= 0) & (voxels < np.array(SHAPE))).all()
    assert len(np.unique(voxels, axis=0)) == len(voxels) == len(places)
    # the sample rounds to the voxel: half a voxel off along each horizontal axis at most
    reach = 0.5 * (abs(np.cos(np.radians(normal_deg))) + abs(np.sin(np.radians(normal_deg))))
    assert np.abs(off(voxels, normal_deg, cotangent)).max() <= reach + 1e-4


@pytest.mark.parametrize("normal_deg", [0.0, 30.0, 45.0, 80.0])
@pytest.mark.parametrize("cotangent", [0.0, 0.4, -0.8])
def test_no_holes(normal_deg, cotangent):
    """No path of steps along the axes leads from one side to the other within a time slice, but through the plane."""
    voxels, _ = sheet_voxels(plane(normal_deg, cotangent), SHAPE)
    wall = np.zeros(SHAPE, bool)
    wall[tuple(voxels.T)] = True
    points = np.argwhere(~wall)
    side = np.zeros(SHAPE, bool)
    side[tuple(points.T)] = off(points, normal_deg, cotangent) > 0
    for k in range(2, 38):
        parts, n_parts = ndimage.label(~wall[:, :, k])
        for number in range(1, n_parts + 1):
            assert len(np.unique(side[:, :, k][parts == number])) == 1


def test_place_on_the_grid_is_that_of_the_voxel():
    sheet = plane(30.0, 0.3)
    voxels, places = sheet_voxels(sheet, SHAPE)
    at = sheet.points(places[:, 0], places[:, 1], sample_grid(sheet.w, places).astype(float))
    np.testing.assert_array_equal(np.rint(at).astype(int), voxels)


def test_outside_of_the_sheet_stays_empty():
    rows = range(30, 61)
    sheet = plane(outside=[(row, column) for row in rows for column in range(20)])
    voxels, _ = sheet_voxels(sheet, SHAPE)
    full, _ = sheet_voxels(plane(), SHAPE)
    # along = (0, 1): the rows kept are those of crosslines below 15
    assert voxels[:, 1].max() <= 15
    assert 0.4 < len(voxels) / len(full) < 0.6


def test_sheet_out_of_the_cube_has_no_voxels():
    far = plane()
    moved = Sheet(far.origin + 500.0, far.across, 0, 2, -30.0, far.w, far.score)
    voxels, places = sheet_voxels(moved, SHAPE)
    assert voxels.shape == (0, 3)
    assert len(places) == 0


def test_one_row_is_a_line():
    w = np.linspace(5.0, 20.0, 20, dtype=np.float32)[None]
    sheet = Sheet(np.zeros(2), np.array([0.0, 1.0]), 0, 2, 0.0, w, np.ones_like(w))
    voxels, _ = sheet_voxels(sheet, (1, 30, 40))
    np.testing.assert_array_equal(voxels[:, 0], 0)
    assert set(voxels[:, 2]) == set(range(39))


def test_grid_is_sampled_linearly(rng):
    rows, columns = np.meshgrid(np.arange(6.0), np.arange(7.0), indexing="ij")
    grid = (2 * rows - 3 * columns).astype(np.float32)
    places = rng.uniform(0, 5, (40, 2))
    np.testing.assert_allclose(sample_grid(grid, places), 2 * places[:, 0] - 3 * places[:, 1], atol=1e-4)


def test_beside_a_missing_node_the_nearest_one_counts():
    grid = np.ones((4, 4), np.float32)
    grid[1, 1] = np.nan
    places = np.array([[1.6, 1.0], [1.4, 1.0], [3.0, 3.0]])
    np.testing.assert_array_equal(sample_grid(grid, places), [1.0, np.nan, 1.0])


def test_likelihood_grows_from_zero_to_one():
    score = np.array([-3.0, 0.0, 0.6, 1.2, 60.0], np.float32)
    np.testing.assert_allclose(to_likelihood(score), [0.0, 0.0, 0.5, 0.75, 1.0], atol=1e-6)


@pytest.mark.parametrize(("generations", "winner"), [((0, 1), 1), ((1, 0), 2), ((0, 0), 2), ((2, 2), 2)])
def test_where_faults_cross_the_voxel_is_the_younger_s_or_the_likelier_s(generations, winner):
    sheets = [plane(0.0), plane(90.0)]
    likelier = replace(sheets[1], score=2.0 * sheets[1].score)
    throws = [
        SheetThrow(np.full_like(sheet.w, throw), np.ones_like(sheet.w), 1, generation=generation)
        for sheet, throw, generation in zip(sheets, (5.0, 9.0), generations, strict=True)
    ]
    labels, thrown = draw_sheets([sheets[0], likelier], throws, SHAPE)
    both = set.intersection(*(set(map(tuple, sheet_voxels(sheet, SHAPE)[0])) for sheet in sheets))
    assert len(both) > 30
    at = tuple(np.array(sorted(both)).T)
    assert (labels[at] == winner).all()
    np.testing.assert_array_equal(np.isfinite(thrown), labels > 0)
    np.testing.assert_array_equal(thrown[at], (5.0, 9.0)[winner - 1])
