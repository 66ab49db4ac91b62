from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solveh_banded

from seismo3d.seismic import _kernels_slip as kernels
from seismo3d.seismic.dip import DipSettings
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.slip_fields import Sides, SlipSettings, _pull, refine_slip, smooth_field
from seismo3d.seismic.throw import ThrowSettings, gather_sides, match_sides, slopes_beside
from seismo3d.synthetic import CubeRecipe, SyntheticFault, make_cube

SHAPE = (72, 64, 96)


def cut_cube(throw, rake_deg, *, dip_deg=65.0, trend=(0.0, 0.0), seed=5):
    """Folded layers cut by one plane through the middle that strikes along growing inlines."""
    fault = SyntheticFault((36.0, 32.0, 48.0), 0.0, dip_deg, throw, rake_deg=rake_deg, trend=trend)
    recipe = CubeRecipe(shape=SHAPE, wavelength=(14.0, 14.0), fold_slope=(0.8, 0.8), population=None, faults=(fault,))
    return make_cube(recipe, seed=seed)


def sheet_of(cube, step=2):
    """The plane of the cube's only fault; rows count growing inlines."""
    fault = cube.fault_list[0]
    columns = np.arange(0, SHAPE[2], step)
    w = (columns - fault.centre[2]) / np.tan(np.radians(fault.dip_deg))
    w = np.broadcast_to(w, (SHAPE[0], len(columns))).astype(np.float32).copy()
    # `across` along growing crosslines turns `along` against growing inlines
    return Sheet(np.array([0.0, 32.0]), np.array([0.0, 1.0]), 0, step, -(SHAPE[0] - 1.0), w, np.ones_like(w))


def layer_slopes(volume, valid, sheet):
    return slopes_beside(volume, valid, [sheet], dip=DipSettings(), settings=ThrowSettings())


def measured(cube, settings=None):
    volume, settings = cube.seismic.copy(), settings or ThrowSettings()
    valid, sheet = np.ones(volume.shape, bool), sheet_of(cube)
    sides = gather_sides(volume, valid, layer_slopes(volume, valid, sheet), sheet, settings=settings)
    return match_sides(sheet, sides.both, sides.known, settings=settings)


@pytest.mark.parametrize(("throw", "rake_deg"), [(12.0, 60.0), (12.0, 120.0), (-12.0, 60.0), (10.0, 50.0)])
def test_strike_slip_of_an_exact_oblique_fault(throw, rake_deg):
    cube = cut_cube(throw, rake_deg)
    sheet = sheet_of(cube)
    found = measured(cube)
    along = float(np.median((cube.slip[:, :2] @ sheet.along) / cube.slip[:, 2]))
    assert abs(along) > 0.3
    # the direction in the plane, within ten degrees
    flat = np.sin(np.radians(65.0))
    rakes = (np.degrees(np.arctan(share * flat)) for share in (found.strike_share, along))
    assert abs(np.subtract(*rakes)) < 10.0
    assert found.slip_certainty > 0.1
    matched = found.fit > 0.4
    assert matched.mean() > 0.5
    assert (np.abs(found.throw[matched] - throw) < 1.5).mean() > 0.9


def test_oblique_slip_left_out_spoils_the_throw():
    """In layers folded along strike, what has slid along it seems to have come down."""
    cube = cut_cube(14.0, 55.0)
    straight = measured(cube, ThrowSettings(slip=SlipSettings(least_gain=2.0)))
    free = measured(cube)
    inner = np.s_[12:-12, 12:-4]
    assert np.abs(free.throw[inner] - 14.0).mean() < 0.6 * np.abs(straight.throw[inner] - 14.0).mean()


@pytest.mark.parametrize("limit", [{"least_gain": 2.0}, {"least_certainty": 1.0}, {"most_misfit": 0.0}])
def test_slip_is_oblique_only_where_it_is_told_well(limit):
    assert measured(cut_cube(14.0, 55.0), ThrowSettings(slip=SlipSettings(**limit))).strike_share == 0.0


@pytest.mark.parametrize("throw", [12.0, -12.0, 5.0])
def test_slip_down_the_dip_is_not_called_oblique(throw):
    found = measured(cut_cube(throw, 90.0))
    assert found.strike_share == 0.0
    matched = found.fit > 0.4
    assert (np.abs(found.throw[matched] - throw) < 1.5).mean() > 0.95


def test_throw_that_changes_is_followed():
    cube = cut_cube(16.0, 90.0, trend=(0.006, 0.008))
    found = measured(cube)
    sheet = sheet_of(cube)
    rows, columns = np.nonzero(found.fit > 0.4)
    at = sheet.points(rows.astype(float), columns.astype(float), sheet.w[rows, columns].astype(float))
    truth = 16.0 * (1.0 + 0.006 * (at[:, 0] - 36.0) + 0.008 * (at[:, 2] - 48.0))
    assert np.ptp(truth) > 8.0
    assert (np.abs(found.throw[rows, columns] - truth) < 1.0).mean() > 0.95


def test_level_layers_give_an_exact_throw(rng):
    sides = flat_sides(rng, throw=6.0)
    slip = refined(sides, 6.0)
    np.testing.assert_allclose(slip.throw[:, 6:-2], 6.0, atol=0.1)


def flat_sides(rng, *, throw):
    """Both sides of a fault through level layers."""
    values = np.convolve(rng.normal(size=400), np.hanning(9), "same")
    depth = np.arange(80.0)
    foot = np.tile(np.interp(depth, np.arange(-100, 300), values), (48, 1)).astype(np.float32)
    hanging = np.tile(np.interp(depth - throw, np.arange(-100, 300), values), (48, 1)).astype(np.float32)
    ones = np.ones_like(foot)
    return Sides(hanging, foot, ones, ones)


def refined(sides, throw):
    shape = (24, 40)
    return refine_slip(
        sides, np.full(shape, throw, np.float32), np.ones(shape, np.float32), np.ones(shape, bool), thin=2,
        settings=SlipSettings(),
    )  # fmt: skip


@pytest.mark.parametrize("start", [3.0, 5.0, 8.0])
def test_a_start_some_samples_off_is_mended(rng, start):
    found = refined(flat_sides(rng, throw=6.0), start)
    np.testing.assert_allclose(found.throw[:, 6:-2], 6.0, atol=0.1)


def test_nothing_known_leaves_the_field_level(rng):
    sides = flat_sides(rng, throw=6.0)
    nothing = Sides(sides.hanging, sides.foot, np.zeros_like(sides.foot), np.zeros_like(sides.foot))
    slip = refined(nothing, 6.0)
    assert np.isinf(slip.misfit).all()
    np.testing.assert_allclose(slip.throw, 6.0, atol=1e-3)


# ----- the field


def test_field_keeps_a_plane_and_carries_it_on():
    r, k = np.meshgrid(np.arange(30.0), np.arange(40.0), indexing="ij")
    plane = (3.0 + 0.2 * r - 0.1 * k).astype(np.float32)
    weights = ((r < 20) & (k > 10)).astype(np.float32)
    np.testing.assert_allclose(smooth_field(plane, weights, stiffness=30.0), plane, atol=0.15)


def test_field_of_one_row():
    line = np.linspace(0, 5, 40, dtype=np.float32)[None]
    np.testing.assert_allclose(smooth_field(line, np.ones_like(line), stiffness=30.0), line, atol=0.05)


def test_field_of_nothing_is_level():
    assert (smooth_field(np.ones((8, 8), np.float32), np.zeros((8, 8), np.float32), stiffness=1.0) == 0.0).all()


def test_field_solves_its_own_normal_equations(rng):
    """Against a dense least-squares problem written down row by row."""
    values, weights = rng.normal(size=(9, 6)), rng.random((9, 6))
    n_rows, n_columns, coarse, stiffness = 3, 3, 4, 2.5
    rows, right = [], []
    for r, k in np.ndindex(values.shape):
        row = np.zeros((n_rows, n_columns))
        i, j, fr, fk = r // coarse, k // coarse, r % coarse / coarse, k % coarse / coarse
        for a, b in np.ndindex(2, 2):
            row[min(i + a, 2), min(j + b, 2)] += (fr if a else 1 - fr) * (fk if b else 1 - fk)
        rows.append(np.sqrt(weights[r, k]) * row.ravel())
        right.append(np.sqrt(weights[r, k]) * values[r, k])
    for m in range(3):
        for line in (np.eye(3)[m][:, None] * [1, -2, 1], np.transpose(np.eye(3)[m][:, None] * [1, -2, 1])):
            rows.append(np.sqrt(stiffness) * line.ravel())
            right.append(0.0)
    for i, j in np.ndindex(2, 2):
        twist = np.zeros((3, 3))
        twist[i : i + 2, j : j + 2] = [[1, -1], [-1, 1]]
        rows.append(np.sqrt(2 * stiffness) * twist.ravel())
        right.append(0.0)
    expected = np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0]
    bands, vector = np.zeros((2 * n_columns + 1, 9)), np.zeros(9)
    kernels.add_places(values, weights, coarse, n_columns, bands, vector)
    kernels.add_bending(n_columns, stiffness, bands)
    from scipy.linalg import solveh_banded

    np.testing.assert_allclose(solveh_banded(bands, vector), expected, atol=1e-8)


# ----- kernels


def test_shifts_are_drawn_to_the_usual_one():
    cost = np.ones((1, 1, 17), np.float32)
    cost[0, 0, 3] = 0.0  # five below the middle
    cost[0, 0, 10] = 0.2  # two above
    known, out = np.ones((1, 1), bool), [np.empty((1, 1), np.float32) for _ in range(3)]
    usual = np.zeros((1, 1), np.float32)
    kernels.pull_shifts(cost, known, usual, np.float32(0.0), *out)
    assert out[0][0, 0] == pytest.approx(-5.0, abs=0.5)
    assert out[1][0, 0] == 0.0
    kernels.pull_shifts(cost, known, usual, np.float32(0.02), *out)
    assert out[0][0, 0] == pytest.approx(2.0, abs=0.5)
    assert out[1][0, 0] == pytest.approx(0.2)
    kernels.pull_shifts(cost, ~known, usual, np.float32(0.02), *out)
    assert out[0][0, 0] == 0.0
    assert np.isinf(out[1][0, 0])


@pytest.mark.parametrize(("n", "width"), [(1, 0), (5, 2), (40, 7), (300, 36)])
def test_banded_systems_are_solved_as_lapack_does(rng, n, width):
    bands = np.zeros((width + 1, n))
    for off in range(width + 1):
        bands[width - off, off:] = rng.normal(size=n - off)
    bands[width] = np.abs(bands[width]) + 4.0 * width + 1.0
    right = rng.normal(size=n)
    wanted = solveh_banded(bands, right)
    kernels.solve_bands(bands, right)
    np.testing.assert_allclose(right, wanted, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("rest", "counts"), [(0.02, False), (0.3, True)])
def test_what_leaves_a_third_of_the_energy_counts_only_where_the_rest_leaves_as_much(rest, counts):
    """Without noise right places leave next to nothing, and the others match by chance."""
    cost = np.full((10, 10, 17), 1.0, np.float32)
    cost[..., 8] = rest
    cost[4, 4, 8], cost[4, 4, 11] = 1.0, 0.35
    shift, weight = _pull(cost, np.ones((10, 10), bool), np.zeros((10, 10), np.float32), 4.0, 0.0)
    assert shift[4, 4] == pytest.approx(3.0, abs=0.5)
    assert (weight[4, 4] > 0.05) == counts
    assert weight[0, 0] > 0.1


def test_where_nothing_is_known_nothing_counts():
    cost = np.full((4, 4, 17), np.inf, np.float32)
    _, weight = _pull(cost, np.zeros((4, 4), bool), np.zeros((4, 4), np.float32), 4.0, 0.0)
    np.testing.assert_array_equal(weight, 0.0)
