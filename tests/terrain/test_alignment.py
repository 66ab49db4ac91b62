from __future__ import annotations

import numpy as np
import pytest
from fake_terrain import CELL, make_hills, place, shift
from scipy import ndimage

from seismo3d.errors import GeometryError, ParameterError
from seismo3d.geometry.map_grid import MapGrid
from seismo3d.terrain import register
from seismo3d.terrain._kernels_align import slopes_with_holes
from seismo3d.terrain.coarse import match_pose
from seismo3d.terrain.pyramid import make_levels

# bilinear resampling between cells costs up to 0.003 cells; noise of 1 m on these slopes, 0.002
TOLERANCE = 0.01


@pytest.mark.parametrize(("columns", "rows"), [(0.4, -0.3), (1.25, 2.5), (23.6, -17.2)])
def test_a_shift_is_found_to_a_hundredth_of_a_cell(hills, rng, columns, rows):
    moved = shift(hills, columns, rows) + 4.0 + rng.normal(0.0, 1.0, hills.shape)
    found = register(place(hills), place(moved))
    assert found.converged
    np.testing.assert_allclose(found.shift[:2] / CELL, [-columns, rows], atol=TOLERANCE)
    assert found.shift[2] == pytest.approx(-4.0, abs=0.1)
    assert found.nmad_after < 0.5 * found.nmad_before


def test_holes_and_tilt(hills, rng):
    y, x = np.mgrid[: hills.shape[0], : hills.shape[1]] * CELL
    moved = shift(hills, 3.3, 1.7) + 0.004 * x - 0.002 * y + rng.normal(0.0, 1.0, hills.shape)
    target = hills.copy()
    for z in (target, moved):
        z[rng.random(z.shape) < 0.3] = np.nan
    found = register(place(target), place(moved), vertical="tilt")
    np.testing.assert_allclose(found.shift[:2] / CELL, [-3.3, 1.7], atol=0.02)
    # carrying the source back takes its tilt out; y of the map runs against the rows
    np.testing.assert_allclose(found.tilt, [-0.004, -0.002], atol=1e-4)


def test_turn_growth_and_vertical_scale(hills):
    a, s = np.radians(7.0), 1.08
    i, j = np.mgrid[:200, :240] - np.array([99.5, 119.5])[:, None, None]
    u, v = s * (np.cos(a) * j - np.sin(a) * i), s * (np.sin(a) * j + np.cos(a) * i)
    source = 0.9 * ndimage.map_coordinates(hills, [v + 119.5, u + 149.5], order=3, mode="wrap")
    target = hills[20:220, 30:270]
    found = register(target, source, model="similarity", vertical="scaled")
    assert found.growth == pytest.approx(s, abs=2e-3)
    assert abs(np.degrees(found.turn)) == pytest.approx(7.0, abs=0.1)
    assert found.vertical_scale == pytest.approx(1.0 / 0.9, rel=0.01)


def test_far_maps_are_found(hills):
    found = register(place(hills[:, :200]), place(hills[:, 90:290]))
    np.testing.assert_allclose(found.shift[:2] / CELL, [90.0, 0.0], atol=TOLERANCE)


@pytest.mark.parametrize("side", [24, 30])
def test_a_small_map_within_a_large_one_is_found(hills, rng, side):
    noise = rng.normal(0.0, 1.0, hills.shape)
    moved = place(shift(hills, 0.4, -0.3) + noise)
    patch = moved[100 : 100 + side, 120 : 120 + side]  # from 0.8 % of the large map
    a, b, c, d, e, f = moved.attrs["transform"]
    patch.attrs["transform"] = (a, b, c + 120 * a, d, e, f + 100 * e)
    found = register(place(hills), patch)
    # with noise of 1 m, a few hundred cells tell the shift to some 0.02 cells
    np.testing.assert_allclose(found.shift[:2] / CELL, [-0.4, -0.3], atol=0.1)
    assert found.overlap == pytest.approx(side**2 / hills.size, rel=0.15)


def test_features_lead_maps_that_are_turned_far(hills):
    a = np.radians(70.0)
    i, j = np.mgrid[:160, :160] - 79.5
    u, v = np.cos(a) * j - np.sin(a) * i, np.sin(a) * j + np.cos(a) * i
    source = ndimage.map_coordinates(hills, [v + 119.5, u + 149.5], order=3, mode="wrap")
    target = np.ascontiguousarray(hills[40:200, 70:230])
    grid = MapGrid.from_elevation(target)
    led = match_pose(make_levels(target, grid, source, grid), "rigid")
    assert led is not None
    turn = np.degrees(np.arctan2(led.motion[1, 0], led.motion[0, 0]))
    assert abs(turn) == pytest.approx(70.0, abs=1.0)
    found = register(target, source, model="rigid")
    assert found.converged
    assert found.turn == pytest.approx(np.radians(turn), abs=0.02)


@pytest.mark.parametrize("seed", range(8))
def test_maps_of_whole_metres_converge(hills, seed):
    rng = np.random.default_rng(seed)
    low = [0.05 * z + rng.normal(0.0, 0.3, z.shape) for z in (hills, shift(hills, 3.3, -4.6))]
    found = register(*(place(np.round(z)) for z in low), model="rigid")
    assert found.converged
    np.testing.assert_allclose(found.shift[:2] / CELL, [-3.3, -4.6], atol=0.1)  # relief of two metres


@pytest.mark.parametrize(("relief", "noise", "model"), [(2.0, 0.02, "rigid"), (1.0, 0.3, "translation")])
def test_noisy_maps_of_the_same_cells_converge(hills, relief, noise, model):
    # at no shift a row of cells joins or leaves with every step, and noise in the slopes makes steps short
    states = []
    for seed in range(8):
        noises = np.random.default_rng(seed).normal(0.0, noise, (2, 120, 120))
        states.append(register(*(relief / 40.0 * hills[:120, :120] + noises), model=model).state)
    assert states.count("converged") >= 7


@pytest.mark.parametrize("seed", [7, 9])
def test_steps_far_below_the_standard_error_are_at_rest(seed):
    # cells that join and leave at the edges move the answer round and round, by a hundredth of what noise does
    rng = np.random.default_rng(seed)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(256), np.fft.rfftfreq(256), indexing="ij"))
    frequency[0, 0] = 1.0
    rough = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(256, 256))) * frequency**-1.6)[:120, :140]
    rough *= 50.0 / rough.std()
    noise = np.random.default_rng(seed)
    target = rough + noise.normal(0.0, 1.0, rough.shape)
    found = register(target, rough[12:, :-9] + noise.normal(0.0, 1.0, (108, 131)))
    assert found.converged
    assert np.abs(found.shift[0]) < 4.0 * found.sigma[0]


def test_other_grids_of_one_system(hills):
    coarse = ndimage.uniform_filter(hills, 2, origin=-1, mode="wrap")[::2, ::2]
    found = register(place(hills), place(coarse, cell=2.0 * CELL))
    assert np.abs(found.shift[:2]).max() < 0.05 * CELL
    moved = found.apply(place(coarse, cell=2.0 * CELL), place(hills))
    assert moved.shape == hills.shape


def test_the_transform_carries_points(hills):
    moved = place(shift(hills, 5.0, -2.0) + 3.0)
    T = register(place(hills), moved, vertical="tilt").T_target_source
    point = np.array([400_000.0 + 105.5 * CELL, 3_800_000.0 - 98.5 * CELL, 7.0, 1.0])
    np.testing.assert_allclose(T @ point - point, [-50.0, -20.0, -3.0, 0.0], atol=0.05)


@pytest.mark.parametrize(
    ("relief", "noise", "holes"), [(40.0, 4.0, 0.0), (2.0, 0.2, 0.3), (1.0, 0.5, 0.0), (0.5, 0.25, 0.0)]
)
def test_the_covariance_is_honest(hills, relief, noise, holes):
    errors, sigmas = [], []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        pair = relief / 40.0 * hills[:120, :120] + rng.normal(0.0, noise, (2, 120, 120))
        pair[rng.random(pair.shape) < holes] = np.nan
        found = register(*pair)
        errors.append(found.shift[:2])
        sigmas.append(found.sigma[:2])
    # thirty-two errors tell a standard deviation to an eighth
    assert 0.6 < np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(sigmas))) < 1.6


def test_unlike_maps_are_a_poor_fit(rng):
    noise = rng.normal(size=(2, 100, 100))
    assert register(noise[0], noise[1]).state == "poor_fit"


def test_a_small_unlike_map_is_a_poor_fit_within_a_large_one(hills):
    other = place(make_hills((60, 60), seed=9))
    assert register(place(hills), other).state == "poor_fit"


def test_slopes_are_those_of_a_plane(rng):
    i, j = np.mgrid[:20, :30].astype(float)
    z = 2.0 * j - 3.0 * i
    z[rng.random(z.shape) < 0.3] = np.nan
    gu, gv = np.empty_like(z), np.empty_like(z)
    slopes_with_holes(z, gu, gv)
    known = np.isfinite(gu)
    assert known.mean() > 0.5
    np.testing.assert_allclose(gu[known], 2.0, atol=1e-9)
    np.testing.assert_allclose(gv[known], -3.0, atol=1e-9)


def test_refusals(hills):
    with pytest.raises(ParameterError, match="model is 'affine'; expected one of translation"):
        register(hills, hills, model="affine")
    with pytest.raises(ParameterError, match="vertical is 'bent'"):
        register(hills, hills, vertical="bent")
    with pytest.raises(GeometryError, match="target is in EPSG:32611 and source in EPSG:32612"):
        register(place(hills), place(hills, crs="EPSG:32612"))
    with pytest.raises(GeometryError, match="source has no georeference and target has one"):
        register(place(hills), hills)
    with pytest.raises(GeometryError, match="source holds no elevation"):
        register(hills, np.full_like(hills, np.nan))
    # the same relief: a georeference that puts it elsewhere is not passed over
    far = place(hills)
    far.attrs["transform"] = (CELL, 0.0, 900_000.0, 0.0, -CELL, 3_800_000.0)
    with pytest.raises(GeometryError, match="no common area: target covers x 400000 to 403000"):
        register(place(hills), far)
    corner = np.full_like(hills, np.nan)
    corner[:12, :12] = hills[:12, :12]
    with pytest.raises(GeometryError, match="no common area with elevations"):
        register(place(np.where(np.isfinite(corner), np.nan, hills)), place(corner))
