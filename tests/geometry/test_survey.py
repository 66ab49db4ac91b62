from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from hypothesis import assume, given
from hypothesis import strategies as st

from seismo3d.errors import GeometryError, ShapeError
from seismo3d.geometry.axis import unit_of
from seismo3d.geometry.survey import Axis, MapFit, SectionGeometry, SurveyGeometry, fit_map
from seismo3d.io.cubes import as_cube


def survey(rotation_deg=0.0, bins=(25.0, 12.5), left_handed=False, shear=0.0):
    """A survey whose inline axis points to an azimuth; crosslines grow clockwise of it, or the other way."""
    a = np.radians(rotation_deg)
    u = bins[0] * np.array([np.sin(a), np.cos(a)])
    v = bins[1] * np.array([np.cos(a), -np.sin(a)]) * (-1 if left_handed else 1) + shear * u
    fit = MapFit((500_000.0, 6_000_000.0), (u[0], u[1]), (v[0], v[1]))
    return SurveyGeometry(Axis(100, 2, 40), Axis(300, 1, 60), Axis(800, 4, 50), "ms", fit)


def test_axis_known_answers():
    axis = Axis(10, -2.5, 4)
    np.testing.assert_array_equal(axis.coordinates(), [10, 7.5, 5, 2.5])
    assert axis.last == 2.5
    assert axis.index(6.25) == 1.5
    assert axis.coordinate(1.5) == 6.25
    assert Axis.from_coordinates([10, 7.5, 5, 2.5], "x") == axis
    assert Axis.from_coordinates([7], "x") == Axis(7, 1, 1)


@pytest.mark.parametrize("arguments", [(0, 0, 3), (0, 1, 0), (np.nan, 1, 3), (0, np.inf, 3)])
def test_axis_refuses(arguments):
    with pytest.raises(GeometryError, match="expected finite numbers, a step other than 0"):
        Axis(*arguments)


@pytest.mark.parametrize("values", [[1, 2, 4], [1, 1, 1], [1, np.nan, 3]])
def test_uneven_coordinates_are_refused(values):
    with pytest.raises(GeometryError, match="inline is not evenly spaced"):
        Axis.from_coordinates(values, "inline")
    with pytest.raises(GeometryError, match="has no coordinates"):
        Axis.from_coordinates([], "inline")


@given(
    st.floats(0, 360),
    st.floats(1, 100),
    st.floats(1, 100),
    st.booleans(),
    st.floats(-0.5, 0.5),
    st.integers(0, 2**32 - 1),
)
def test_index_and_map_are_inverse(rotation, a, b, left_handed, shear, seed):
    geometry = survey(rotation, (a, b), left_handed, shear)
    points = np.random.default_rng(seed).uniform(-50, 200, (20, 3))
    np.testing.assert_allclose(geometry.map_to_index(geometry.index_to_map(points)), points, atol=1e-6)
    np.testing.assert_allclose(geometry.lines_to_index(geometry.index_to_lines(points)), points, atol=1e-9)


def test_known_points():
    geometry = survey(90.0)  # inlines grow eastwards, crosslines southwards
    xyz = geometry.index_to_map([[0, 0, 0], [2, 0, 1], [0, 3, 2.5]])
    np.testing.assert_allclose(xyz, [[500_000, 6_000_000, 800], [500_050, 6_000_000, 804], [500_000, 5_999_962.5, 810]])
    np.testing.assert_allclose(geometry.index_to_lines([[1.5, 2, 1]]), [[103, 302, 804]])
    assert geometry.bin_size == (25.0, 12.5)


@pytest.mark.parametrize("rotation", [0.0, 30.0, 90.0, 200.0, 359.0])
@pytest.mark.parametrize("left_handed", [False, True])
def test_azimuths(rotation, left_handed):
    geometry = survey(rotation, left_handed=left_handed)
    assert geometry.inline_axis_azimuth_deg == pytest.approx(rotation, abs=1e-9)
    across = (rotation + (270 if left_handed else 90)) % 360
    assert geometry.crossline_axis_azimuth_deg == pytest.approx(across, abs=1e-9)
    assert geometry.is_right_handed is not left_handed
    assert geometry.inlines_up is not left_handed


@pytest.mark.parametrize("inlines", [1, -1])
@pytest.mark.parametrize("crosslines", [1, -1])
def test_without_a_map_strikes_go_by_the_numbers_of_lines_in_whatever_order(inlines, crosslines):
    cube = xr.DataArray(
        np.zeros((4, 5, 6), np.float32),
        dims=("inline", "crossline", "time"),
        coords={"inline": 100 + np.arange(4), "crossline": 200 + np.arange(5), "time": 4.0 * np.arange(6)},
    )
    geometry = SurveyGeometry.from_cube(cube[::inlines, ::crosslines])
    # dips towards growing crosslines and less towards growing inlines
    normal = np.array([[0.3 * inlines, 0.9 * crosslines, -0.4]])
    assert geometry.strike_deg(normal) == pytest.approx(np.degrees(np.arctan2(0.9, 0.3)) - 90.0 + 360.0)
    assert geometry.inline_axis_azimuth_deg == (0.0 if inlines > 0 else 180.0)
    assert geometry.crossline_axis_azimuth_deg == (90.0 if crosslines > 0 else 270.0)
    assert geometry.is_right_handed is (inlines * crosslines > 0)
    assert not geometry.inlines_up


@given(st.floats(0, 359), st.floats(5, 85), st.floats(0, 359), st.booleans(), st.floats(-0.4, 0.4))
def test_strike_is_that_of_the_plane_on_the_map(strike, dip, rotation, left_handed, shear):
    """Normals found from three points of a known plane, in index space, give its strike whatever the survey."""
    geometry = survey(rotation, (25.0, 10.0), left_handed, shear)
    s, d = np.radians(strike), np.radians(dip)
    along = np.array([np.sin(s), np.cos(s), 0.0])
    down = np.array([np.cos(d) * np.cos(s), -np.cos(d) * np.sin(s), np.sin(d)])  # dips to the right of strike, z down
    centre = geometry.index_to_map([[20, 30, 25]])[0]
    p = geometry.map_to_index([centre, centre + 100 * along, centre + 100 * down])
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    assume(abs(normal[2]) > 1e-6 * np.linalg.norm(normal))
    for n in (normal, -3 * normal):
        difference = (geometry.strike_deg([n])[0] - strike + 180) % 360 - 180
        assert abs(difference) < 1e-4


def test_strike_without_a_map_counts_from_the_inline_axis():
    geometry = SurveyGeometry(Axis(0, 1, 5), Axis(0, 1, 5), Axis(0, 1, 5))
    assert not geometry.has_map
    # dips towards growing crosslines: strikes along growing inlines
    np.testing.assert_allclose(geometry.strike_deg([[0, 1, -1], [1, 0, -1], [0, -1, 1]]), [0, 270, 0])
    np.testing.assert_allclose(geometry.azimuth_deg([[1, 0], [0, 1], [-1, 0]]), [0, 90, 180])
    assert np.isnan(geometry.strike_deg([[0, 0, -1]])[0])
    np.testing.assert_array_equal(geometry.index_to_map([[1, 2, 3]]), [[1, 2, 3]])
    assert np.isnan(geometry.bin_size[0])


def test_fit_finds_the_map_and_says_how_well(rng):
    truth = survey(33.0, shear=0.1)
    ij = np.stack(np.meshgrid(np.arange(40), np.arange(60), indexing="ij"), axis=-1).reshape(-1, 2)
    xy = truth.index_to_map(np.column_stack([ij, np.zeros(len(ij))]))[:, :2]
    noisy = xy + rng.normal(0, 0.5, xy.shape)
    noisy[7] = np.nan
    fit = fit_map(ij, noisy)
    assert fit is not None
    np.testing.assert_allclose(fit.matrix, truth.map_fit.matrix, atol=0.01)
    assert fit.rms == pytest.approx(0.5 * np.sqrt(2), rel=0.05)  # noise in x and in y


@pytest.mark.parametrize("wrong", ["one far off", "an eighth at one end", "a fifth anywhere", "ten times too large"])
def test_fit_leaves_wrong_coordinates_out(rng, wrong):
    truth = survey(33.0, shear=0.1)
    ij = np.stack(np.meshgrid(np.arange(24), np.arange(20), indexing="ij"), axis=-1).reshape(-1, 2)
    right = truth.index_to_map(np.column_stack([ij, np.zeros(len(ij))]))[:, :2] + rng.normal(0, 0.5, (len(ij), 2))
    xy = right.copy()
    if wrong == "one far off":
        xy[77, 0] = 2e9
    elif wrong == "an eighth at one end":
        xy[:60] = 1.0
    elif wrong == "a fifth anywhere":
        xy[rng.permutation(len(ij))[:96]] += rng.uniform(200, 5e5, (96, 2))
    else:
        xy[:60] *= 10.0
    fit = fit_map(ij, xy)
    kept = (xy == right).all(axis=1)
    assert fit == fit_map(ij[kept], right[kept])


def test_coordinates_on_no_map_are_fitted_as_they_are(rng):
    ij = np.stack(np.meshgrid(np.arange(24), np.arange(20), indexing="ij"), axis=-1).reshape(-1, 2)
    fit = fit_map(ij, 25.0 * ij + rng.uniform(-500, 500, ij.shape))
    assert fit.rms > 300.0


def test_fit_without_area_is_none():
    line = np.column_stack([np.arange(9), np.arange(9)])
    assert fit_map(line, line * 25.0) is None
    assert fit_map(line[:2], line[:2]) is None
    square = np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    assert fit_map(square, np.zeros((4, 2))) is None
    assert fit_map(square, square[:, :1] * [[3.0, 4.0]]) is None
    with pytest.raises(ShapeError, match="expected as many"):
        fit_map(square, square[:2])


def cube_of(geometry):
    n_il, n_xl = geometry.inline.n, geometry.crossline.n
    ij = np.stack(np.meshgrid(np.arange(n_il), np.arange(n_xl), indexing="ij"), axis=-1).reshape(-1, 2)
    xy = geometry.index_to_map(np.column_stack([ij, np.zeros(len(ij))]))[:, :2].reshape(n_il, n_xl, 2)
    coords = {
        "inline": geometry.inline.coordinates(),
        "crossline": geometry.crossline.coordinates(),
        "time": geometry.sample.coordinates(),
        "cdp_x": (("inline", "crossline"), xy[..., 0]),
        "cdp_y": (("inline", "crossline"), xy[..., 1]),
    }
    dims = ("inline", "crossline", "time")
    shape = (n_il, n_xl, geometry.sample.n)
    return xr.DataArray(np.zeros(shape, np.float32), dims=dims, coords=coords, attrs={"sample_unit": "ms"})


@pytest.mark.parametrize("stored", [False, True])
def test_geometry_of_a_cube_and_of_its_part(stored):
    truth = survey(57.0, left_handed=True)
    cube = cube_of(truth)
    if stored:
        cube.attrs["survey"] = truth.to_dict()
    found = SurveyGeometry.from_cube(cube)
    assert (found.inline, found.unit) == (truth.inline, "ms")
    np.testing.assert_allclose(found.map_fit.matrix, truth.map_fit.matrix, atol=1e-9)
    part = SurveyGeometry.from_cube(cube.isel(inline=slice(5, None, 3), crossline=slice(10, 2, -1), time=slice(4, 9)))
    np.testing.assert_allclose(part.index_to_map([[2, 3, 1]]), truth.index_to_map([[11, 7, 5]]), atol=1e-5)


def test_changed_coordinates_of_traces_are_what_counts():
    truth = survey(57.0, left_handed=True)
    cube = cube_of(truth)
    cube.attrs["survey"] = truth.to_dict()
    moved = cube.assign_coords(cdp_x=cube.cdp_x + 1e5, cdp_y=cube.cdp_y - 30.0)
    shift = SurveyGeometry.from_cube(moved).index_to_map([[2, 3, 1]]) - truth.index_to_map([[2, 3, 1]])
    np.testing.assert_allclose(shift, [[1e5, -30.0, 0.0]], atol=1e-6)
    part = SurveyGeometry.from_cube(moved.isel(inline=slice(4, 9)))
    np.testing.assert_allclose(part.index_to_map([[0, 3, 1]]), truth.index_to_map([[4, 3, 1]]) + shift, atol=1e-6)
    # other line numbers do not move the traces
    numbered = SurveyGeometry.from_cube(cube.assign_coords(inline=7000.0 + np.arange(truth.inline.n)))
    assert numbered.inline.first == 7000.0
    np.testing.assert_allclose(numbered.index_to_map([[2, 3, 1]]), truth.index_to_map([[2, 3, 1]]), atol=1e-6)


def test_map_of_the_file_is_kept_where_traces_round_or_lack_their_coordinates():
    truth = survey(57.0)
    cube = cube_of(truth)
    fit = truth.map_fit
    cube.attrs["survey"] = truth.to_dict() | {"map": truth.to_dict()["map"] | {"rms": 0.4}}
    rounded = cube.assign_coords(cdp_x=cube.cdp_x.round(), cdp_y=cube.cdp_y.round())
    assert SurveyGeometry.from_cube(rounded).map_fit.origin == fit.origin
    rounded.coords["cdp_x"][3:] = np.nan
    assert SurveyGeometry.from_cube(rounded).map_fit.origin == fit.origin
    assert SurveyGeometry.from_cube(rounded.isel(inline=slice(5, 9))).has_map
    assert SurveyGeometry.from_cube(rounded.drop_vars(["cdp_x", "cdp_y"])).map_fit.origin == fit.origin


def test_geometry_of_bare_arrays_and_sections():
    assert SurveyGeometry.from_cube(np.zeros((3, 4, 5))).crossline == Axis(0, 1, 4)
    with pytest.raises(GeometryError, match="expected 3 axes"):
        SurveyGeometry.from_cube(np.zeros((3, 4)))
    bare = SectionGeometry.from_cube(np.zeros((3, 4)))
    np.testing.assert_array_equal(bare.index_to_map([[1.5, 2]]), [[1.5, 0, 2]])
    with pytest.raises(GeometryError, match="expected 2 axes"):
        SectionGeometry.from_cube(np.zeros((3, 4, 5)))


def test_a_section_runs_along_its_traces():
    coords = {"time": [100.0, 104.0], "cdp_x": ("trace", [0.0, 10.0, 10.0]), "cdp_y": ("trace", [0.0, 0.0, 20.0])}
    line = xr.DataArray(np.zeros((3, 2)), dims=("trace", "time"), coords=coords)
    geometry = SectionGeometry.from_cube(line)
    np.testing.assert_allclose(
        geometry.index_to_map([[0.5, 0], [1.25, 1], [9, 0.5]]), [[5, 0, 100], [10, 5, 104], [10, 20, 102]]
    )
    with pytest.raises(GeometryError, match="A section has no survey"):
        SurveyGeometry.from_cube(line)


def test_traces_of_a_section_without_a_place_lie_in_line_with_their_neighbours():
    nan = np.nan
    coords = {"cdp_x": ("trace", [nan, 10.0, nan, 30.0, nan]), "cdp_y": ("trace", [0.0, 5.0, 5.0, 1.0, nan])}
    line = xr.DataArray(np.zeros((5, 2)), dims=("trace", "time"), coords=coords)
    want = [[0, 7], [10, 5], [20, 3], [30, 1], [40, -1]]
    np.testing.assert_allclose(SectionGeometry.from_cube(line).xy, want)
    np.testing.assert_allclose(SectionGeometry.from_cube(line[:2]).xy, [[10, 5], [10, 5]])
    assert not SectionGeometry.from_cube(line[:1]).has_map


@pytest.mark.parametrize(
    ("dim", "units", "attrs", "wanted"),
    [
        ("depth", None, {}, "m"),
        ("time", None, {}, "ms"),
        ("depth", "ft", {}, "ft"),
        ("depth", "Feet", {}, "ft"),
        ("depth", "metres", {}, "m"),
        ("depth", "ft", {"sample_unit": "m"}, "m"),
        ("time", "s", {}, "s"),
        ("time", None, {"sample_unit": "samples"}, "samples"),
    ],
)
def test_the_unit_is_what_the_cube_or_its_coordinate_says(dim, units, attrs, wanted):
    axis = (dim, 2.0 * np.arange(6), {} if units is None else {"units": units})
    cube = xr.DataArray(np.zeros((4, 5, 6)), dims=("inline", "crossline", dim), coords={dim: axis}, attrs=attrs)
    assert unit_of(cube) == wanted
    assert SurveyGeometry.from_cube(cube).unit == wanted
    assert unit_of(as_cube(cube)) == wanted
