from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic import _kernels_linking as kernels
from seismo3d.seismic.linking import link_sheets
from seismo3d.seismic.scan import RidgePoints

SHAPE = (40, 40, 32)
STEP = 2


def plane_points(normal_deg, cotangent, *, centre=(20.0, 20.0, 32.0), keep=None, score=1.0):
    """Ridge points on a plane through `centre` that moves along its horizontal normal as it goes down."""
    normal = np.array([np.cos(np.radians(normal_deg)), np.sin(np.radians(normal_deg))])
    main = int(np.argmax(np.abs(normal)))
    other, k = np.meshgrid(np.arange(SHAPE[1 - main]), np.arange(SHAPE[2]), indexing="ij")
    other, k = other.ravel(), k.ravel()
    away = cotangent * (STEP * k - centre[2])
    at = centre[main] + (away - (other - centre[1 - main]) * normal[1 - main]) / normal[main]
    positions = np.empty((len(k), 3), np.float32)
    positions[:, main], positions[:, 1 - main], positions[:, 2] = at, other, STEP * k
    inside = (at >= 0) & (at <= SHAPE[main] - 1)
    if keep is not None:
        inside &= keep(positions)
    positions = positions[inside]
    voxels = np.rint(positions / [1, 1, STEP]).astype(np.int32)
    planes = np.tile(np.array([*normal, cotangent], np.float32), (len(voxels), 1))
    return RidgePoints(voxels, positions, planes, np.full(len(voxels), score, np.float32))


def together(*sets):
    """Join sets of points; where two share a voxel the first keeps it, as thinning does."""
    joined = [np.concatenate([getattr(part, name) for part in sets]) for name in RidgePoints.__slots__]
    _, first = np.unique(joined[0], axis=0, return_index=True)
    return RidgePoints(*(values[np.sort(first)] for values in joined))


def link(ridges, least_points=100):
    return link_sheets(ridges, SHAPE, step=STEP, least_points=least_points)


def nodes(sheet):
    rows, columns = np.nonzero(sheet.inside)
    return sheet.points(rows.astype(float), columns.astype(float), sheet.w[rows, columns].astype(float))


def off(points, normal_deg, cotangent, centre=(20.0, 20.0, 32.0)):
    normal = np.array([np.cos(np.radians(normal_deg)), np.sin(np.radians(normal_deg))])
    return (points[:, :2] - centre[:2]) @ normal - cotangent * (points[:, 2] - centre[2])


# ----- kernels


def index_of(voxels, shape):
    cells, n_cells = kernels.number_cells(voxels, *shape)
    points = np.empty((n_cells, 64), np.int32)
    kernels.fill_cells(voxels, cells, points)
    return cells, points


@pytest.mark.parametrize("reach", [0, 2, 5])
def test_points_around_a_voxel_are_found(rng, reach):
    shape = (11, 9, 6)
    voxels = np.argwhere(rng.random(shape) < 0.1).astype(np.int32)
    cells, points = index_of(voxels, shape)
    found = np.empty((2 * reach + 1) ** 2, np.int64)
    for i, j, k in [(0, 0, 0), (10, 8, 5), (5, 4, 3), (-3, 4, 1), (14, 12, 2)]:
        n = kernels.find_points(cells, points, i, j, k, reach, np.empty(0, np.int32), 0, found)
        near = (np.abs(voxels - [i, j, k]) <= [reach, reach, 0]).all(axis=1)
        np.testing.assert_array_equal(np.sort(found[:n]), np.flatnonzero(near))


def test_cells_of_one_surface_are_passed_over():
    voxels = np.array([[0, 0, 0], [1, 1, 1], [5, 0, 0], [6, 0, 0], [9, 9, 0]], np.int32)
    label = np.array([3, 3, 3, 4, -1], np.int32)
    cells, points = index_of(voxels, (12, 12, 4))
    holds = kernels.find_lone_surfaces(voxels, label, cells, len(points))
    np.testing.assert_array_equal(holds[cells[[0, 1, 2], [0, 0, 2], 0]], [3, -2, -1])
    found = np.empty(15**2, np.int64)
    n = kernels.find_points(cells, points, 3, 3, 0, 7, holds, 3, found)
    np.testing.assert_array_equal(np.sort(found[:n]), [2, 3, 4])


@pytest.mark.parametrize(
    ("step", "tilt_deg", "expected"),
    [((0, 1, 2), 0.0, True), ((2, 1, 0), 0.0, False), ((1.2, 0, 0), 0.0, True), ((0, 1, 0), 30.0, False)],
)
def test_neighbours_lie_on_each_others_planes(step, tilt_deg, expected):
    positions = np.array([[5, 5, 5], np.add([5, 5, 5], step)], np.float32)
    tilt = np.radians(tilt_deg)
    normals = np.array([[1, 0, 0], [np.cos(tilt), np.sin(tilt), 0]], np.float32)
    limits = np.float32(np.cos(np.radians(25.0))), np.float32(1.4)
    for signs in ((1, 1), (1, -1)):
        turned = normals * np.array(signs, np.float32)[:, None]
        assert kernels._on_each_other(positions, turned, 0, 1, *limits) == expected
        assert kernels._on_each_other(positions, turned, 1, 0, *limits) == expected


# ----- sheets


@pytest.mark.parametrize("normal_deg", [0.0, 20.0, 45.0, 90.0, 160.0])
@pytest.mark.parametrize("cotangent", [0.0, 0.3, -0.3])
def test_plane_is_one_sheet_in_its_place(normal_deg, cotangent):
    ridges = plane_points(normal_deg, cotangent)
    sheets = link(ridges)
    assert len(sheets) == 1
    sheet = sheets[0]
    assert (
        abs(np.cos(np.radians(normal_deg)) * sheet.across[0] + np.sin(np.radians(normal_deg)) * sheet.across[1]) > 0.999
    )
    assert np.hypot(*sheet.across) == pytest.approx(1.0)
    assert sheet.along @ sheet.across == pytest.approx(0.0, abs=1e-12)
    at = nodes(sheet)
    # the plane is a plane up to its rim: smoothing takes the trend out first
    assert np.abs(off(at, normal_deg, cotangent)).max() < 0.15
    assert len(at) > 0.9 * len(ridges.score)
    assert sheet.area == STEP * len(at)
    np.testing.assert_allclose(sheet.score[sheet.inside], 1.0, atol=0.05)
    assert np.isnan(sheet.score[~sheet.inside]).all()


def test_crossing_planes_pass_through_each_other():
    first, second = plane_points(0.0, 0.3, score=1.2), plane_points(90.0, -0.3)
    sheets = link(together(first, second))
    assert len(sheets) == 2
    found = {int(np.abs(sheet.across[1]) > 0.7): nodes(sheet) for sheet in sheets}
    assert set(found) == {0, 1}
    for number, truth in ((0, (0.0, 0.3)), (1, (90.0, -0.3))):
        assert np.percentile(np.abs(off(found[number], *truth)), 95) < 0.5
        # on both sides of the other plane
        other = off(found[number], *((90.0, -0.3) if number == 0 else (0.0, 0.3)))
        assert (other > 5).mean() > 0.25
        assert (other < -5).mean() > 0.25


def test_conjugate_planes_stay_two():
    """An X in section: both dip, towards each other, with the same strike."""
    sheets = link(together(plane_points(0.0, 0.4, score=1.1), plane_points(0.0, -0.4)))
    assert len(sheets) >= 2
    for sheet in sheets:
        at = nodes(sheet)
        error = [np.abs(off(at, 0.0, cotangent)) for cotangent in (0.4, -0.4)]
        assert min(np.percentile(e, 90) for e in error) < 1.0


def test_parallel_planes_stay_apart():
    sheets = link(together(plane_points(0.0, 0.3), plane_points(0.0, 0.3, centre=(26.0, 20.0, 32.0))))
    assert len(sheets) == 2
    offsets = sorted(float(np.median(off(nodes(sheet), 0.0, 0.3))) for sheet in sheets)
    np.testing.assert_allclose(offsets, [0.0, 6.0], atol=0.1)


def test_gap_is_bridged_and_wide_gap_is_not():
    narrow = plane_points(0.0, 0.2, keep=lambda at: np.abs(at[:, 1] - 20) > 1.6)
    assert len(link(narrow)) == 1
    bridged = nodes(link(narrow)[0])
    assert (np.abs(bridged[:, 1] - 20) < 1.5).any()
    assert np.abs(off(bridged, 0.0, 0.2)).max() < 0.2
    wide = plane_points(0.0, 0.2, keep=lambda at: np.abs(at[:, 1] - 20) > 8)
    assert len(link(wide)) == 2


def test_hole_is_filled():
    holed = plane_points(0.0, 0.2, keep=lambda at: np.hypot(at[:, 1] - 20, at[:, 2] - 32) > 5)
    sheet = link(holed)[0]
    at = nodes(sheet)
    assert (np.hypot(at[:, 1] - 20, at[:, 2] - 32) < 2).any()
    assert np.abs(off(at, 0.0, 0.2)).max() < 0.2


def test_small_sets_are_left_out():
    speck = plane_points(0.0, 0.2, keep=lambda at: np.hypot(at[:, 1] - 20, at[:, 2] - 32) < 8)
    assert link(speck, least_points=len(speck.score) + 1) == []
    assert len(link(speck, least_points=20)) == 1


def test_nothing_gives_nothing():
    empty = RidgePoints(
        np.empty((0, 3), np.int32), np.empty((0, 3), np.float32), np.empty((0, 3), np.float32), np.empty(0, np.float32)
    )
    assert link(empty) == []


def test_scattered_points_are_no_sheet(rng):
    voxels = np.unique(rng.integers(0, SHAPE, (1500, 3)), axis=0).astype(np.int32)
    angle = rng.uniform(0, 2 * np.pi, len(voxels))
    planes = np.column_stack([np.cos(angle), np.sin(angle), rng.uniform(-1, 1, len(voxels))]).astype(np.float32)
    ridges = RidgePoints(voxels, (voxels * [1, 1, STEP]).astype(np.float32), planes, np.ones(len(voxels), np.float32))
    assert link(ridges, least_points=60) == []


def test_order_of_points_does_not_matter(rng):
    ridges = plane_points(20.0, 0.3)
    ridges = RidgePoints(
        ridges.voxels, ridges.positions, ridges.planes, rng.uniform(0.8, 1.2, len(ridges.score)).astype(np.float32)
    )
    order = rng.permutation(len(ridges.score))
    mixed = RidgePoints(*(getattr(ridges, name)[order] for name in RidgePoints.__slots__))
    one, other = link(ridges)[0], link(mixed)[0]
    np.testing.assert_allclose(other.w, one.w, atol=1e-3)


def test_larger_sheets_come_first():
    small = plane_points(0.0, 0.0, centre=(30.0, 20.0, 32.0), keep=lambda at: at[:, 1] < 15)
    sheets = link(together(small, plane_points(0.0, 0.0, centre=(10.0, 20.0, 32.0))))
    areas = [sheet.area for sheet in sheets]
    assert len(areas) == 2
    assert areas == sorted(areas, reverse=True)
    assert np.median(nodes(sheets[0])[:, 0]) == pytest.approx(10.0, abs=0.1)


def test_gentle_curve_stays_one_sheet():
    ridges = plane_points(0.0, 0.0)
    bend = 0.01 * (ridges.positions[:, 1] - 20.0) ** 2
    slope = 0.02 * (ridges.positions[:, 1] - 20.0)
    positions, planes = ridges.positions.copy(), ridges.planes.copy()
    positions[:, 0] += bend
    planes[:, 0], planes[:, 1] = 1 / np.hypot(1, slope), -slope / np.hypot(1, slope)
    voxels = np.rint(positions / [1, 1, STEP]).astype(np.int32)
    sheets = link(RidgePoints(voxels, positions, planes, ridges.score))
    assert len(sheets) == 1
    at = nodes(sheets[0])
    error = np.abs(at[:, 0] - 20 - 0.01 * (at[:, 1] - 20) ** 2)
    # smoothing cuts the corner at the rim alone, where the bend has no other side
    assert np.median(error) < 0.25
    assert error.max() < 1.0


def test_section_becomes_one_row():
    k = np.arange(SHAPE[2])
    positions = np.column_stack([np.zeros(len(k)), 10.0 + 0.5 * k, STEP * k]).astype(np.float32)
    voxels = np.rint(positions / [1, 1, STEP]).astype(np.int32)
    planes = np.tile(np.array([0.0, 1.0, 0.25], np.float32), (len(k), 1))
    for sign in (1.0, -1.0):
        signed = planes * np.array([1.0, sign, sign], np.float32)
        ridges = RidgePoints(voxels, positions, signed, np.ones(len(k), np.float32))
        sheets = link_sheets(ridges, (1, *SHAPE[1:]), step=STEP, least_points=10)
        assert len(sheets) == 1
        assert sheets[0].w.shape[0] == 1
        at = nodes(sheets[0])
        # not off the section by as much as a rounding error: a place outside has no data
        assert not at[:, 0].any()
        np.testing.assert_allclose(at[:, 1], 10.0 + 0.25 * at[:, 2], atol=0.1)


@pytest.mark.parametrize("dip_deg", [32.0, 40.0])
@pytest.mark.parametrize("normal_deg", [0.0, 35.0, 90.0])
def test_a_low_dip_is_linked_down_its_dip(dip_deg, normal_deg):
    ridges = plane_points(normal_deg, 1.0 / np.tan(np.radians(dip_deg)))
    sheets = link(ridges)
    assert len(sheets) == 1
    assert sheets[0].inside.sum() >= 0.8 * len(ridges.score)


@pytest.mark.parametrize("cotangent", [0.0, 0.6])
def test_a_sheet_that_nearly_reaches_the_cubes_end_goes_on_to_it(cotangent):
    def inner(positions):
        return (positions[:, 1] >= 2) & (positions[:, 1] <= 36) & (positions[:, 2] >= 4)

    sheet = link(plane_points(0.0, cotangent, keep=inner))[0]
    points = nodes(sheet)
    assert points[:, 1].min() <= 0.5
    assert points[:, 1].max() >= 38.5
    assert points[:, 2].min() == 0
    assert (points >= -1e-6).all()
    assert (points <= np.array([39, 39, STEP * 31]) + 1e-6).all()
    assert np.abs(off(points, 0.0, cotangent)).max() < 0.3


def test_a_sheet_that_ends_inside_stays_where_it_ends():
    sheet = link(plane_points(0.0, 0.0, keep=lambda p: (p[:, 1] >= 8) & (p[:, 1] <= 30) & (np.abs(p[:, 2] - 30) < 15)))[
        0
    ]
    points = nodes(sheet)
    assert points[:, 1].min() >= 7
    assert points[:, 1].max() <= 31
    assert points[:, 2].min() >= 14
    assert points[:, 2].max() <= 46
