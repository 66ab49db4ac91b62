from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.seismic import _kernels_extending as kernels
from seismo3d.seismic.extending import ExtendSettings, extend_sheet, extend_sheets
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheets import Sheet

SHAPE = (40, 48, 32)
STEP = 2
NORMAL = np.array([0.8, 0.6])
ALONG = np.array([-0.6, 0.8])
CENTRE = np.array([20.0, 24.0])


def flat_sheet(rows=range(-10, 11), columns=range(8, 20), cotangent=0.0):
    """A certain sheet on a plane through the cube's middle: `rows` along its strike, `columns` down it."""
    down = cotangent * (STEP * np.array(columns) - 32.0)
    w = np.tile(down, (len(rows), 1)).astype(np.float32)
    return Sheet(CENTRE, NORMAL, STEP * columns[0], STEP, float(rows[0]), w, np.ones(w.shape, np.float32))


def ridges(rows, columns, *, cotangent=0.0, off=0.0, score=0.3, normal=NORMAL):
    """Ridge points at every node of the sheet's plane, by growing inline."""
    s, k = (a.ravel() for a in np.meshgrid(np.array(rows), np.array(columns), indexing="ij"))
    w = cotangent * (STEP * k - 32.0) + off
    flat = CENTRE + s[:, None] * ALONG + w[:, None] * NORMAL
    positions = np.column_stack([flat, STEP * k]).astype(np.float32)
    voxels = np.rint(positions / [1, 1, STEP]).astype(np.int32)
    inside = ((voxels >= 0) & (voxels < SHAPE)).all(axis=1)
    order = np.flatnonzero(inside)[np.argsort(voxels[inside, 0], kind="stable")]
    planes = np.tile(np.array([*normal, cotangent], np.float32), (len(order), 1))
    return RidgePoints(voxels[order], positions[order], planes, np.full(len(order), score, np.float32))


@pytest.mark.parametrize("cotangent", [0.0, 0.5])
def test_a_sheet_follows_weak_ridges_in_its_plane_and_ends_with_them(cotangent):
    sheet = flat_sheet(cotangent=cotangent)
    longer = extend_sheet(sheet, ridges(range(-10, 18), range(8, 26), cotangent=cotangent), SHAPE)
    rows, columns = np.nonzero(longer.inside)
    s, k = longer.first_s + rows, longer.first_sample // STEP + columns
    assert (s.min(), k.min()) == (pytest.approx(-10, abs=1), pytest.approx(8, abs=1))
    assert (s.max(), k.max()) == (pytest.approx(17, abs=1), pytest.approx(25, abs=1))
    assert np.abs(longer.w[rows, columns] - cotangent * (STEP * k - 32.0)).max() < 0.05
    assert longer.score[rows, columns].min() >= np.float32(0.15)
    assert longer.area > 1.8 * sheet.area


@pytest.mark.parametrize(
    "points",
    [
        ridges(range(11, 18), range(8, 20), score=0.1),
        ridges(range(11, 18), range(8, 20), off=2.5),
        ridges(range(11, 18), range(8, 20), normal=ALONG),
        ridges(range(18, 22), range(8, 20)),
        ridges(range(11, 18, 3), range(8, 20, 3)),
    ],
    ids=["too weak", "off the plane", "turned away", "apart", "too few"],
)
def test_what_does_not_continue_a_sheet_leaves_it_as_it_is(points):
    sheet = flat_sheet()
    assert extend_sheet(sheet, points, SHAPE) is sheet


def test_a_sheet_ends_with_the_cube():
    sheet = flat_sheet(columns=range(20, 30))
    longer = extend_sheet(sheet, ridges(range(-40, 40), range(20, 32)), SHAPE, settings=ExtendSettings(rings=30))
    rows, columns = np.nonzero(longer.inside)
    points = longer.points(rows.astype(float), columns.astype(float), longer.w[rows, columns].astype(float))
    assert points.min(axis=0)[:2].min() >= -0.5
    assert (points.max(axis=0) <= np.array([39.5, 47.5, 62.5])).all()
    assert points[:, 2].max() == 62.0


def test_what_ends_beside_the_end_of_the_cube_reaches_it():
    nowhere = ridges(range(0), range(0))
    longer = extend_sheet(flat_sheet(columns=range(20, 31)), nowhere, SHAPE)
    assert longer.first_sample == 40
    assert longer.w.shape[1] == 12
    assert longer.inside[1:-1].all()
    short = flat_sheet(columns=range(20, 30))
    assert extend_sheet(short, nowhere, SHAPE) is short


def test_ridges_far_off_change_nothing():
    sheet, near = flat_sheet(), ridges(range(-10, 18), range(8, 26))
    first, last = (replace_inline(ridges(range(-3, 3), range(8, 20)), at) for at in (-400.0, 400.0))
    more = RidgePoints(
        *(np.concatenate([getattr(part, name) for part in (first, near, last)]) for name in RidgePoints.__slots__)
    )
    alone, among = extend_sheet(sheet, near, SHAPE), extend_sheet(sheet, more, SHAPE)
    assert np.array_equal(alone.w, among.w, equal_nan=True)
    assert np.array_equal(alone.score, among.score, equal_nan=True)


def replace_inline(points, shift):
    """Move ridge points along the inlines."""
    away = np.array([shift, 0.0, 0.0])
    return replace(points, voxels=points.voxels + away.astype(np.int32), positions=points.positions + np.float32(away))


def test_what_lies_beside_a_certain_sheet_is_followed_on_too():
    support = ridges(range(-10, 18), range(8, 26))
    weak = replace(flat_sheet(), score=flat_sheet().score * 0.5)
    settings = ExtendSettings(strength=20.0, company_strength=5.0)
    beside = replace(flat_sheet(), origin=CENTRE + 6.0 * NORMAL)
    far = replace(flat_sheet(), origin=CENTRE + 12.0 * NORMAL)
    for certain, is_longer in ((beside, True), (far, False)):
        found = extend_sheets([weak, certain], support, SHAPE, settings=settings)
        assert (found[0].area > 1.8 * weak.area) == is_longer
        assert found[1] is certain
    assert extend_sheets([weak], support, SHAPE, settings=settings)[0] is weak
    speck = replace(weak, score=weak.score * 0.1)
    assert extend_sheets([speck, beside], support, SHAPE, settings=settings)[0] is speck


# ----- kernels


def test_ridges_beside_a_sheet_are_those_on_its_grid(rng):
    positions = rng.uniform(0, 40, (500, 3)).astype(np.float32)
    score = rng.random(500).astype(np.float32)
    grid = (CENTRE, ALONG, NORMAL, -6.0, 8, STEP)
    found = kernels.find_beside(positions, score, *grid, (13, 10), -5.0, 7.0, 0.3)
    away = positions[:, :2] - CENTRE
    row, column = np.rint(away @ ALONG + 6.0), np.rint((positions[:, 2] - 8) / STEP)
    height = away @ NORMAL
    on_grid = (row >= 0) & (row < 13) & (column >= 0) & (column < 10) & (height > -5) & (height < 7) & (score >= 0.3)
    np.testing.assert_array_equal(found, np.flatnonzero(on_grid))
    assert 0 < len(found) < 100
    laid = kernels.lay_on_grid(positions, found, *grid)
    for values, expected in zip(laid, (row, column, height), strict=True):
        np.testing.assert_allclose(values, expected[found], atol=1e-9)


def test_the_best_ridge_on_a_nodes_plane_is_followed():
    number = np.full((2, 3), -1, np.int32)
    number[1, 2], number[0, 0] = 0, 1
    planes = np.array([[4.0, 0.1, 0.2], [0.0, 0.0, 0.0]])
    on_plane = NORMAL - 0.1 * ALONG
    normal = np.array([*on_plane, -0.2 / STEP]) / np.sqrt(1.0 + 0.01 + 0.01)
    # off the plane, turned away from it, fitting, as good and later, worse, and where no plane is
    height = np.array([5.6, 4.0, 4.5, 3.5, 4.0, 4.0])
    score = np.array([0.9, 0.8, 0.5, 0.5, 0.4, 0.9])
    normals = np.stack([normal, [*ALONG, 0.0], normal, -normal, normal, normal])
    rows, columns = np.array([1, 1, 1, 1, 1, 0]), np.array([2, 2, 2, 2, 2, 1])
    best, heights = np.zeros(2), np.zeros(2)
    kernels.follow_planes(
        number, planes, ALONG, NORMAL, STEP, rows, columns, height, score, normals, 1.5, np.cos(0.4), best, heights
    )
    np.testing.assert_array_equal(best, [0.5, 0.0])
    np.testing.assert_array_equal(heights, [3.5, 0.0])
