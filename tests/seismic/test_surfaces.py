from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.surfaces import build_surface
from seismo3d.seismic.throw import SheetThrow

SHAPE = (60, 60, 60)
BARE = SurveyGeometry.from_cube(np.zeros(SHAPE, np.float32))


def flat_sheet(normal_deg=90.0, cotangent=0.5, *, rows=11, columns=9, step=2, slant=0.0, hole=None):
    """A plane; it dips towards `normal_deg` where the cotangent is positive, away from it where it is negative."""
    angle = np.radians(normal_deg)
    r, c = np.indices((rows, columns))
    w = (cotangent * step * c + slant * r).astype(np.float32)
    if hole is not None:
        w[hole] = np.nan
    score = np.where(np.isfinite(w), 2.0, np.nan).astype(np.float32)
    return Sheet(np.array([30.0, 30.0]), np.array([np.cos(angle), np.sin(angle)]), 10, step, -5.0, w, score)


def surface_of(sheet, *, geometry=BARE, hanging_side=None, sampling=(1.0, "samples")):
    if hanging_side is None:
        hanging_side = 1 if np.nanmean(np.diff(sheet.w, axis=1)) >= 0 else -1
    throw = SheetThrow(np.where(sheet.inside, 3.0, np.nan).astype(np.float32), np.ones_like(sheet.w), hanging_side)
    return build_surface(sheet, throw, throw, 0.4 * sheet.score, SHAPE, geometry=geometry, sampling=sampling)


def apart(first, second):
    return np.abs((np.asarray(first, float) - second + 180.0) % 360.0 - 180.0)


@pytest.mark.parametrize("normal_deg", [0.0, 30.0, 90.0, 135.0, 250.0])
@pytest.mark.parametrize("cotangent", [0.5, -0.5, 1.5])
def test_normals_point_up_into_the_hanging_wall(normal_deg, cotangent):
    surface = surface_of(flat_sheet(normal_deg, cotangent))
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, atol=1e-6)
    # samples grow downwards: up is negative
    assert (surface.normals[:, 2] < 0).all()
    # horizontally a normal shows where the plane dips to
    towards = normal_deg if cotangent > 0 else normal_deg + 180.0
    azimuth = np.degrees(np.arctan2(surface.normals[:, 1], surface.normals[:, 0]))
    assert apart(azimuth, towards).max() < 0.01
    # a normal is square to every edge
    for a, b in ((0, 1), (1, 2)):
        edge = surface.vertices[surface.cells[:, b]] - surface.vertices[surface.cells[:, a]]
        assert np.abs((edge * surface.normals[surface.cells[:, a]]).sum(axis=1)).max() < 1e-4


@pytest.mark.parametrize("normal_deg", [0.0, 30.0, 90.0, 135.0, 250.0])
@pytest.mark.parametrize("cotangent", [0.5, -0.5])
def test_strike_obeys_the_right_hand_rule(normal_deg, cotangent):
    surface = surface_of(flat_sheet(normal_deg, cotangent))
    dips_towards = normal_deg if cotangent > 0 else normal_deg + 180.0
    # looking along strike the surface dips to the right, 90 degrees further clockwise
    assert apart(surface.strike_deg, dips_towards - 90.0).max() < 0.01
    assert ((surface.strike_deg >= 0) & (surface.strike_deg < 360)).all()
    np.testing.assert_allclose(surface.dip_deg, np.degrees(np.arctan2(1.0, abs(cotangent))), atol=1e-3)
    np.testing.assert_allclose(surface.strike_deg, BARE.strike_deg(surface.normals.astype(float)), atol=0.01)


def test_surface_ends_at_the_outer_traces_and_samples():
    sheet = replace(flat_sheet(), origin=np.array([58.4, 55.2]), first_sample=46)
    surface = surface_of(sheet)
    whole = sheet.nodes()
    assert (whole.max(axis=0) > [59.0, 59.0, 59.0]).all()
    np.testing.assert_array_equal(surface.vertices.max(axis=0), [59.0, 59.0, 59.0])
    within = (whole <= [59.0, 59.0, 59.0]).all(axis=1)
    np.testing.assert_allclose(surface.vertices[within], whole[within], atol=1e-5)


@pytest.mark.parametrize(("cotangent", "slant"), [(0.0, 0.0), (0.5, 0.0), (-1.0, 0.0), (0.5, 0.3)])
def test_area_of_a_plane(cotangent, slant):
    surface = surface_of(flat_sheet(30.0, cotangent, slant=slant))
    assert surface.area == pytest.approx(10 * 16 * np.sqrt(1 + cotangent**2 + slant**2), rel=1e-5)


def test_vertices_lie_on_the_sheet():
    surface = surface_of(flat_sheet(90.0, 0.5))
    vertices = surface.vertices
    np.testing.assert_allclose(vertices[:, 1] - 30.0, 0.5 * (vertices[:, 2] - 10.0), atol=1e-5)
    # along = (-1, 0): s from -5 to 5 gives inlines from 35 down to 25
    assert (vertices[:, 0].min(), vertices[:, 0].max()) == (25.0, 35.0)
    assert (vertices[:, 2].min(), vertices[:, 2].max()) == (10.0, 26.0)


def test_mesh_of_a_sheet_with_a_hole():
    sheet = flat_sheet(hole=(slice(4, 6), slice(3, 5)))
    surface = surface_of(sheet)
    assert surface.cells.dtype == np.int32
    assert len(surface.vertices) == 11 * 9 - 4
    np.testing.assert_array_equal(np.unique(surface.cells), np.arange(len(surface.vertices)))
    # 3 x 3 of the 10 x 8 squares are lost, and each has two triangles
    assert len(surface.cells) == 2 * (80 - 9)
    assert np.isfinite(surface.vertices).all()
    assert np.isfinite(surface.normals).all()
    np.testing.assert_allclose(surface.dip_deg, np.degrees(np.arctan(2.0)), atol=1e-3)
    # every edge belongs to one triangle or two, those of one being the rims: 36 outside and 12 around the hole
    edges = np.sort(
        np.concatenate([surface.cells[:, [0, 1]], surface.cells[:, [1, 2]], surface.cells[:, [2, 0]]]), axis=1
    )
    _, uses = np.unique(edges, axis=0, return_counts=True)
    assert uses.max() == 2
    assert (uses == 1).sum() == 36 + 12


def test_triangles_of_a_mesh_face_one_way():
    surface = surface_of(flat_sheet(30.0, 0.5))
    a, b, c = (surface.vertices[surface.cells[:, n]] for n in range(3))
    facing = (np.cross(b - a, c - a) * surface.normals[surface.cells[:, 0]]).sum(axis=1)
    assert (facing > 0).all() or (facing < 0).all()


def test_nodes_that_no_square_uses_are_left_out():
    sheet = flat_sheet(hole=(slice(5, 6), slice(None)))
    sheet.w[5, 4] = 4.0
    surface = surface_of(sheet)
    assert len(surface.vertices) == 10 * 9


def test_attributes_of_the_nodes():
    surface = surface_of(flat_sheet(), sampling=(4.0, "ms"))
    np.testing.assert_allclose(surface.likelihood, 0.8)
    np.testing.assert_allclose(surface.throw, 3.0)
    np.testing.assert_allclose(surface.throw_ms, 12.0)
    np.testing.assert_allclose(surface.throw_fit, 1.0)
    n = len(surface.vertices)
    for values in (surface.normals, surface.likelihood, surface.throw, surface.strike_deg, surface.dip_deg):
        assert len(values) == n
        assert values.dtype == np.float32
        assert not values.flags.writeable
    for values in (surface.vertices, surface.cells):
        assert not values.flags.writeable


@pytest.mark.parametrize("normal_deg", [0.0, 30.0, 250.0])
@pytest.mark.parametrize("cotangent", [0.5, -0.5])
def test_slip_runs_down_the_dip_within_the_surface(normal_deg, cotangent):
    surface = surface_of(flat_sheet(normal_deg, cotangent))
    np.testing.assert_allclose(surface.slip[:, 2], surface.throw, rtol=1e-5)
    np.testing.assert_allclose((surface.slip * surface.normals).sum(axis=1), 0.0, atol=1e-4)
    np.testing.assert_allclose(np.hypot(surface.slip[:, 0], surface.slip[:, 1]), 3.0 * abs(cotangent), rtol=1e-4)
    # down the dip of a normal fault: towards its hanging wall
    assert ((surface.slip[:, :2] * surface.normals[:, :2]).sum(axis=1) > 0).all()


@pytest.mark.parametrize("normal_deg", [0.0, 30.0, 250.0])
@pytest.mark.parametrize("share", [0.6, -0.4])
@pytest.mark.parametrize("throw", [3.0, -3.0])
def test_oblique_slip_lies_in_the_surface_and_has_the_parts_that_it_is_made_of(normal_deg, share, throw):
    cotangent = 0.5
    surface = replace(surface_of(flat_sheet(normal_deg, cotangent)), strike_share=share)
    surface = replace(surface, throw=np.full(len(surface.vertices), throw, np.float32))
    np.testing.assert_allclose((surface.slip * surface.normals).sum(axis=1), 0.0, atol=1e-4)
    outwards = surface.normals[:, :2] / np.hypot(*surface.normals[:, :2].T)[:, None]
    # looking along strike the hanging wall lies to the right: inlines ahead, crosslines to the right
    strike = np.column_stack([outwards[:, 1], -outwards[:, 0]])
    np.testing.assert_allclose((surface.slip[:, :2] * strike).sum(axis=1), share * throw, rtol=1e-4)
    np.testing.assert_allclose((surface.slip[:, :2] * outwards).sum(axis=1), cotangent * throw, rtol=1e-3)
    np.testing.assert_allclose(surface.strike_slip, share * throw, rtol=1e-5)
    np.testing.assert_allclose(surface.heave, cotangent * throw, rtol=1e-3)
    np.testing.assert_allclose(surface.dip_slip, throw * np.hypot(1.0, cotangent), rtol=1e-3)
    expected = np.degrees(np.arctan2(throw * np.hypot(1.0, cotangent), share * throw))
    np.testing.assert_allclose(surface.rake_deg, expected, rtol=1e-3)


@pytest.mark.parametrize("hanging_side", [1, -1])
def test_sheets_that_face_either_way_slip_alike(hanging_side):
    """What slides along the sheet's own `along` does so on the surface."""
    sheet = flat_sheet(30.0, 0.5 * hanging_side)
    throw = SheetThrow(np.where(sheet.inside, 3.0, np.nan).astype(np.float32), np.ones_like(sheet.w), hanging_side, 0.5)
    surface = build_surface(sheet, throw, throw, sheet.score, SHAPE, geometry=BARE,
                            sampling=(1.0, "samples"))  # fmt: skip
    np.testing.assert_allclose(surface.slip[:, :2] @ sheet.along, 1.5, atol=1e-3)


def test_upright_surface_slips_straight_down():
    slip = surface_of(flat_sheet(30.0, 0.0)).slip
    np.testing.assert_allclose(slip, np.tile([0.0, 0.0, 3.0], (len(slip), 1)), atol=1e-5)


def test_confidence_grows_with_size_up_to_the_likelihood():
    small, large = (surface_of(flat_sheet(rows=rows)).confidence for rows in (4, 60))
    assert 0.0 < small < large < 0.8


def test_section_becomes_a_polyline():
    angle = np.pi / 2
    w = np.array([[np.nan, 0.0, 1.0, 2.0, 3.0, np.nan, 5.0]], np.float32)
    sheet = Sheet(np.array([0.0, 20.0]), np.array([np.cos(angle), np.sin(angle)]), 0, 2, 0.0, w, np.ones_like(w))
    line = surface_of(sheet, geometry=None, hanging_side=1)
    np.testing.assert_allclose(line.vertices, [[20, 2], [21, 4], [22, 6], [23, 8]], atol=1e-5)
    np.testing.assert_array_equal(line.cells, [[0, 1], [1, 2], [2, 3]])
    np.testing.assert_allclose(line.normals, np.tile([2, -1] / np.sqrt(5), (4, 1)), atol=1e-5)
    assert np.isnan(line.strike_deg).all()
    np.testing.assert_allclose(line.slip, np.tile([1.5, 3.0], (4, 1)), atol=1e-5)
    np.testing.assert_allclose(line.dip_deg, np.degrees(np.arctan(2.0)), atol=1e-3)
    assert line.area == pytest.approx(3 * np.sqrt(5), rel=1e-5)


def test_dips_are_true_in_a_cube_in_depth_on_a_map():
    """A plane half a trace across for a sample down, in bins of 12.5 m and samples of 5 m: 6.25 m for 5 m."""
    lines = np.arange(40)
    coords = {"inline": lines, "crossline": lines, "depth": 5.0 * np.arange(60)}
    coords["cdp_x"] = (("inline", "crossline"), np.broadcast_to(12.5 * lines[:, None], (40, 40)))
    coords["cdp_y"] = (("inline", "crossline"), np.broadcast_to(12.5 * lines, (40, 40)))
    cube = xr.DataArray(np.zeros((40, 40, 60), np.float32), dims=list(coords)[:3], coords=coords)
    for unit, across in (("m", 6.25 / 5.0), ("ms", 0.5)):
        geometry = SurveyGeometry.from_cube(cube.assign_attrs(sample_unit=unit))
        surface = surface_of(flat_sheet(30.0), geometry=geometry, sampling=(5.0, unit))
        np.testing.assert_allclose(surface.dip_deg, np.degrees(np.arctan2(1.0, across)), atol=0.1)


def test_normals_are_those_of_the_fault_and_not_of_the_roughness_of_its_height():
    sheet = flat_sheet(30.0, 0.5, rows=40, columns=25)
    rng = np.random.default_rng(3)
    w = sheet.w + rng.normal(0.0, 0.3, sheet.w.shape).astype(np.float32)
    smooth, rough = surface_of(sheet), surface_of(replace(sheet, w=w))
    off = np.degrees(np.arccos(np.clip((smooth.normals * rough.normals).sum(axis=1), -1.0, 1.0)))
    # from node to node they would be 8 degrees off on the mean
    assert off.mean() < 1.0


def test_normals_follow_a_fault_that_flattens_downwards():
    sheet = flat_sheet(0.0, 0.5, rows=21, columns=24)
    z = np.arange(sheet.w.shape[1]) * sheet.step
    bent = sheet.w + (0.002 * (z - z.mean()) ** 2).astype(np.float32)
    surface = surface_of(replace(sheet, w=bent))
    depth = surface.vertices[:, 2] - sheet.first_sample - z.mean()
    true = np.degrees(np.arctan2(1.0, np.abs(0.5 + 0.004 * depth)))
    inner = np.abs(depth) < 12.0
    assert np.abs(surface.dip_deg - true)[inner].max() < 1.5
