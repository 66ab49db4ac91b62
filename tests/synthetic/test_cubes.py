from __future__ import annotations

import numpy as np
import pytest

from seismo3d import synthetic
from seismo3d.errors import ParameterError
from seismo3d.synthetic import CubeRecipe, SyntheticFault, make_cube

SHAPE = (48, 56, 64)
FLAT = {"shape": SHAPE, "fold_slope": (0.0, 0.0), "tilt": (0.0, 0.0), "population": None}


def flat_cube(*faults: SyntheticFault, **settings):
    return make_cube(CubeRecipe(**{**FLAT, **settings}, faults=faults), seed=4)


def plane_normal(points):
    """Unit normal (upwards) and centroid of the plane through points."""
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre, full_matrices=False)[2][-1]
    return (normal if normal[2] < 0 else -normal), centre


PLANAR = SyntheticFault((24, 28, 32), strike_deg=30.0, dip_deg=65.0, throw=7.5)


def test_flat_layers_jump_by_the_throw():
    cube = flat_cube(PLANAR)
    shift = cube.layer_time - np.arange(SHAPE[2])
    # The hanging wall came from 7.5 samples higher, the footwall never moved.
    assert set(np.unique(shift.round(3))) == {-7.5, 0.0}
    assert np.allclose(cube.throw[cube.faults == 1], 7.5, atol=1e-6)
    assert np.isnan(cube.throw[cube.faults == 0]).all()
    # The hanging wall lies above the plane: on the side of dip, to the right of strike (crossline grows to the right).
    assert (shift[:, -1, 0] < -7).any()
    assert (shift[:, 0, -1] == 0).all()


def test_reverse_fault_moves_the_hanging_wall_up():
    cube = flat_cube(SyntheticFault((24, 28, 32), 30.0, 65.0, -7.5))
    shift = cube.layer_time - np.arange(SHAPE[2])
    assert set(np.unique(shift.round(3))) == {7.5, 0.0}
    assert np.allclose(cube.throw[cube.faults == 1], -7.5, atol=1e-6)


@pytest.mark.parametrize(("strike", "dip"), [(0.0, 80.0), (30.0, 65.0), (123.0, 50.0), (200.0, 37.0), (300.0, 85.0)])
def test_fault_voxels_lie_on_the_plane_asked_for(strike, dip):
    cube = flat_cube(SyntheticFault((24, 28, 32), strike, dip, 5.0))
    s, d = np.deg2rad(strike), np.deg2rad(dip)
    towards = np.array([-np.sin(s), np.cos(s), 0.0])
    normal = np.sin(d) * towards - np.cos(d) * np.array([0.0, 0.0, 1.0])
    points = np.argwhere(cube.faults == 1)
    distance = (points - np.array([24, 28, 32])) @ normal
    assert np.abs(distance).max() <= 0.5 + 1e-9
    # Nothing is left out: every voxel that near along the grid axis nearest to the normal is marked.
    every = (np.indices(SHAPE).reshape(3, -1).T - np.array([24, 28, 32])) @ normal / np.abs(normal).max()
    assert len(points) == ((every >= -0.5) & (every < 0.5)).sum()
    found, _ = plane_normal(points)
    assert np.degrees(np.arccos(min(1.0, abs(found @ normal)))) < 1.0
    # One voxel thick along that axis.
    assert (cube.faults > 0).sum(axis=int(np.abs(normal).argmax())).max() == 1


def test_slip_lies_in_the_plane_and_its_vertical_part_is_the_throw():
    cube = flat_cube(PLANAR, least_throw=0.5)
    s, d = np.deg2rad(30.0), np.deg2rad(65.0)
    normal = np.array([-np.sin(s) * np.sin(d), np.cos(s) * np.sin(d), -np.cos(d)])
    assert cube.slip.shape == ((cube.faults > 0).sum(), 3)
    assert np.abs(cube.slip @ normal).max() < 1e-5
    assert np.allclose(cube.slip[:, 2], cube.throw[cube.faults > 0])
    # Dip slip: no part along strike.
    assert np.abs(cube.slip @ np.array([np.cos(s), np.sin(s), 0.0])).max() < 1e-5


def test_rake_turns_the_slip_within_the_plane():
    cube = flat_cube(SyntheticFault((24, 28, 32), 30.0, 65.0, 7.5, rake_deg=60.0))
    s = np.deg2rad(30.0)
    slip = cube.slip[0].astype(float)
    along = slip @ np.array([np.cos(s), np.sin(s), 0.0])
    assert along / np.linalg.norm(slip) == pytest.approx(np.cos(np.deg2rad(60.0)), abs=1e-5)
    assert slip[2] == pytest.approx(7.5)


def test_the_wavelet_is_not_distorted_by_faulting():
    cube = flat_cube(SyntheticFault((24, 28, 32), 0.0, 80.0, 10.0), wavelength=(14.0, 14.0))
    hanging, foot = cube.signal[5, -1], cube.signal[5, 0]
    assert np.ptp(foot) > 1.0
    np.testing.assert_allclose(hanging[10:], foot[:-10], atol=2e-3)


FAULTS = {
    "trend": SyntheticFault((24, 28, 32), 10.0, 70.0, 8.0, trend=(0.005, 0.006)),
    "gaussian": SyntheticFault((24, 28, 32), 10.0, 70.0, 8.0, "gaussian", (20, 25)),
    "elliptic": SyntheticFault((24, 28, 32), 10.0, 60.0, 6.0, "elliptic", (22, 28), drag=25, share=0.5),
    "curved": SyntheticFault((24, 28, 32), 10.0, 60.0, 8.0, bend=(0.004, 0.004), ripple=(1.0, 40.0, 0.3)),
    "listric": SyntheticFault((24, 20, 20), 10.0, 65.0, 8.0, listric=(25.0, 20.0)),
    "reverse": SyntheticFault((24, 28, 32), 10.0, 50.0, -6.0, "elliptic", (30, 40), share=0.7),
    "oblique": SyntheticFault((24, 28, 32), 10.0, 60.0, 8.0, bend=(0.004, 0.002), rake_deg=70.0),
}


@pytest.mark.parametrize("name", FAULTS)
def test_throw_is_the_jump_of_flat_layers_along_a_trace(name):
    cube = flat_cube(FAULTS[name])
    tau, jump = cube.layer_time.astype(float), []
    for i, x, k in np.argwhere(cube.faults > 0):
        if 3 <= k < SHAPE[2] - 4:
            above, below = tau[i, x, k - 3], tau[i, x, k + 3]
            jump.append((below - above - 6.0, cube.throw[i, x, k]))
    jumps, throws = np.array(jump).T
    assert len(jumps) > 200
    # Six samples are crossed, in which a throw that dies out at up to 0.3 samples a sample strains the layers too.
    assert np.abs(jumps - throws).max() < (0.01 if name == "oblique" else 1.5)
    assert np.median(np.abs(jumps - throws)) < 0.35


def test_elliptic_fault_ends_at_its_tip_line():
    cube = flat_cube(FAULTS["elliptic"], least_throw=0.05)
    i, x, s = np.nonzero(cube.faults)
    strike = np.deg2rad(10.0)
    along = (i - 24) * np.cos(strike) + (x - 28) * np.sin(strike)
    r = np.hypot(along / 22, (s - 32) / 28)
    throw = cube.throw[i, x, s]
    assert r.max() < 1.0
    assert r.max() > 0.9
    assert throw[r < 0.05] == pytest.approx(6.0, abs=0.1)
    assert throw.max() <= 6.0
    # Walsh and Watterson: slip falls all the way from the centre to the tip line.
    means = [throw[(r >= a) & (r < a + 0.2)].mean() for a in np.arange(0.0, 1.0, 0.2)]
    assert (np.diff(means) < 0).all()


def test_listric_fault_flattens_and_rolls_the_hanging_wall_over():
    cube = flat_cube(SyntheticFault((24, 10, 12), 0.0, 65.0, 8.0, listric=(25.0, 20.0)))
    line = np.argwhere(cube.faults[24] > 0)
    upper, lower = line[line[:, 1] < 12], line[line[:, 1] > 35]
    slope = [np.polyfit(part[:, 0], part[:, 1], 1)[0] for part in (upper[upper[:, 1] > 2], lower)]
    assert np.degrees(np.arctan(slope[1])) < 45.0 < np.degrees(np.arctan(slope[0]))
    shift = np.arange(SHAPE[2]) - cube.layer_time[24]
    # Down to the fault: the nearer to the steep part, the deeper the hanging wall has sagged.
    sag = shift[[18, 28, 50], 2]
    assert (np.diff(sag) < -0.2).all()
    assert sag[-1] > 0


def test_later_fault_offsets_the_earlier_one_by_its_slip():
    first = SyntheticFault((24, 28, 32), 190.0, 75.0, 4.0)
    later = SyntheticFault((24, 28, 32), 20.0, 60.0, 9.0)
    cube = flat_cube(first, later)
    normal, _ = plane_normal(np.argwhere(flat_cube(first).faults == 1))
    moved = np.median(cube.slip[cube.faults[cube.faults > 0] == 2], axis=0)
    s, d = np.deg2rad(20.0), np.deg2rad(60.0)
    across = np.array([-np.sin(s) * np.sin(d), np.cos(s) * np.sin(d), -np.cos(d)])
    points = np.argwhere(cube.faults == 1)
    side = (points - np.array([24, 28, 32])) @ across
    foot, hanging = points[side < -2] @ normal, points[side > 2] @ normal
    assert foot.std() < 0.4
    assert hanging.std() < 0.4
    assert hanging.mean() - foot.mean() == pytest.approx(moved @ normal, abs=0.1)
    assert abs(moved @ normal) > 2.0
    # The later one is not moved by the earlier one.
    assert np.abs(side[cube.faults[tuple(points.T)] == 2]).sum() == 0
    assert np.abs((np.argwhere(cube.faults == 2) - np.array([24, 28, 32])) @ across).max() <= 0.5 + 1e-9
    # Four blocks, whose flat layers were shifted by none, one or both throws.
    assert set(np.unique((np.arange(SHAPE[2]) - cube.layer_time).round(2))) == {0.0, 4.0, 9.0, 13.0}


def test_horizons_agree_with_layer_time():
    cube = synthetic.fault_cube("folded", shape=SHAPE, seed=5)
    checked = 0
    for time, depth in zip(cube.horizon_times, cube.horizons):
        i, x = np.nonzero(np.isfinite(depth))
        low = np.floor(depth[i, x]).astype(int)
        part = depth[i, x] - low
        at = cube.layer_time[i, x, low] * (1 - part) + cube.layer_time[i, x, low + 1] * part
        np.testing.assert_allclose(at, time, atol=1e-3)
        checked += i.size
    assert checked > 1000


def test_horizon_is_absent_in_the_heave_of_a_normal_fault_and_uppermost_on_a_reverse_one():
    normal = flat_cube(SyntheticFault((24, 28, 32), 0.0, 45.0, 8.0))
    reverse = flat_cube(SyntheticFault((24, 28, 32), 0.0, 45.0, -8.0))
    for cube in (normal, reverse):
        time = cube.horizon_times[2]
        depth = cube.horizons[2, 24]
        if cube is normal:
            # Eight traces of heave, and the two in which the layer lies less than a sample from the fault.
            assert 8 <= np.isnan(depth).sum() <= 10
            assert set(np.unique((depth[np.isfinite(depth)] - time).round(3))) == {0.0, 8.0}
        else:
            assert np.isfinite(depth).all()
            assert set(np.unique((depth - time).round(3))) == {0.0, -8.0}
            # Dip is towards growing crosslines: eight traces hold the layer twice, and give the raised part.
            below = np.argmax(cube.layer_time[24] > time, axis=1)
            assert (depth <= below).all()


@pytest.mark.parametrize("kind", ["clean", "folded", "crossing", "low_dips", "channels"])
@pytest.mark.parametrize("seed", [2, 3])
def test_layer_time_increases_down_every_trace_within_fault_blocks(kind, seed):
    cube = synthetic.fault_cube(kind, shape=SHAPE, seed=seed)
    back = np.diff(cube.layer_time, axis=2) <= 0
    fault = cube.faults > 0
    assert not (back & ~(fault[..., 1:] | fault[..., :-1])).any()


@pytest.mark.parametrize("name", [name for name, fault in FAULTS.items() if fault.throw > 0])
def test_layer_time_increases_everywhere_across_one_normal_fault(name):
    cube = flat_cube(FAULTS[name], fold_slope=(0.2, 0.2), tilt=(0.1, 0.1))
    assert (np.diff(cube.layer_time, axis=2) > 0).all()


def test_unconformity_cuts_off_old_faults_and_layers():
    old = SyntheticFault((24, 28, 50), 0.0, 65.0, 8.0, buried=True)
    cube = flat_cube(old, unconformity=(0.5, 0.5), old_tilt=(0.2, 0.2))
    depths = np.nonzero(cube.faults)[2]
    assert depths.min() > 20
    assert depths.max() == SHAPE[2] - 1
    assert (np.diff(cube.layer_time, axis=2) > 0).all()
    # Above, flat young layers; below, tilted old ones.
    young, older = cube.layer_time[:, :, 5], cube.layer_time[:, :, -1]
    assert np.ptp(young) < 1e-3
    assert np.ptp(older) > 8.0


@pytest.mark.parametrize("kind", ["fault_free", "channels"])
def test_kinds_without_faults_have_none(kind):
    cube = synthetic.fault_cube(kind, shape=SHAPE, seed=1)
    assert not cube.faults.any()
    assert np.isnan(cube.throw).all()
    assert cube.slip.shape == (0, 3)
    assert cube.fault_list == ()


@pytest.mark.parametrize("kind", [kind for kind in synthetic.KINDS if kind != "demo"])
def test_same_seed_same_cube_and_the_section_is_its_middle_inline(kind):
    one = synthetic.fault_cube(kind, shape=(24, 32, 48), seed=7)
    two = synthetic.fault_cube(kind, shape=(24, 32, 48), seed=7)
    other = synthetic.fault_cube(kind, shape=(24, 32, 48), seed=8)
    section = synthetic.fault_section(kind, shape=(24, 32, 48), seed=7)
    for name in ("seismic", "faults", "throw", "layer_time", "horizons", "slip"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert not np.array_equal(one.seismic, other.seismic)
    np.testing.assert_array_equal(section.faults, one.faults[12])
    np.testing.assert_array_equal(section.layer_time, one.layer_time[12])
    scale = section.signal.std() / one.signal[12].std()
    np.testing.assert_allclose(section.signal, one.signal[12] * scale, atol=1e-3)


def test_number_of_threads_changes_nothing(monkeypatch):
    many = synthetic.fault_cube("demo", shape=(24, 32, 48), seed=7, population=None, faults=(PLANAR,))
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    one = synthetic.fault_cube("demo", shape=(24, 32, 48), seed=7, population=None, faults=(PLANAR,))
    np.testing.assert_array_equal(one.seismic, many.seismic)
    np.testing.assert_array_equal(one.slip, many.slip)


def test_small_throws_stay_small_everywhere():
    for seed in range(3):
        throw = np.abs(synthetic.fault_cube("small_throws", shape=(40, 40, 40), seed=seed).throw)
        assert np.nanmin(throw) > 2.2
        assert np.nanmax(throw) < 6.5


def test_truncated_layers_fade_out_at_the_unconformity():
    cube = make_cube(
        CubeRecipe(shape=(4, 60, 80), population=None, unconformity=(0.5, 0.5), fold_slope=(0.0, 0.0), tilt=(0.0, 0.0)),
        seed=3,
    )
    # Amplitudes are as smooth across traces there as elsewhere: a step of a whole reflector would exceed this.
    jump = np.abs(np.diff(cube.signal, axis=1)).max()
    assert jump < 0.5 * np.abs(cube.signal).max()


def test_noise_has_the_ratio_asked_for():
    cube = synthetic.fault_cube("noise", shape=SHAPE, seed=3)
    assert np.std(cube.signal) == pytest.approx(1.0, rel=0.02)
    assert np.sqrt(np.mean((cube.seismic - cube.signal) ** 2)) == pytest.approx(0.8, rel=1e-3)


def test_lost_traces_polarity_mute_and_smiles():
    settings = {"shape": (32, 32, 40), "seed": 3}
    plain = synthetic.fault_cube("clean", **settings)
    np.testing.assert_array_equal(
        synthetic.fault_cube("clean", reverse_polarity=True, **settings).seismic, -plain.seismic
    )
    broken = synthetic.fault_cube("clean", dead_traces=0.1, missing_corner=0.4, top_mute=6, **settings)
    missing = np.isnan(broken.seismic).all(axis=2)
    dead = (broken.seismic == 0).all(axis=2)
    assert missing[0, 0]
    assert 0.05 < missing.mean() < 0.11
    assert 0.03 < dead.mean() < 0.18
    np.testing.assert_array_equal(broken.live, ~(missing | dead))
    assert (broken.seismic[broken.live][:, :6] == 0).all()
    np.testing.assert_array_equal(broken.seismic[broken.live][:, 6:], plain.seismic[broken.live][:, 6:])
    smiles = synthetic.fault_cube("clean", smiles=2, **settings).seismic - plain.seismic
    assert 0.3 < np.abs(smiles).max() < 4.0


def test_throws_and_dips_are_drawn_from_the_ranges():
    for kind in ("clean", "small_throws", "low_dips"):
        recipe = synthetic.KINDS[kind]
        for seed in range(5):
            faults = synthetic.fault_cube(kind, shape=(16, 16, 64), seed=seed).fault_list
            assert recipe.population.count[0] <= len(faults) <= recipe.population.count[1]
            for fault in faults:
                assert recipe.population.dip_deg[0] <= fault.dip_deg <= recipe.population.dip_deg[1]
                assert recipe.population.throw[0] <= abs(fault.throw) <= recipe.population.throw[1]
    assert len(synthetic.fault_cube("crossing", shape=(16, 16, 64)).fault_list) == 8


def test_demo_has_everything():
    section = synthetic.fault_section("demo")
    faults = section.fault_list
    assert any(fault.listric for fault in faults)
    assert any(fault.bend[0] for fault in faults)
    assert any(fault.throw < 0 for fault in faults)
    assert sum(fault.buried for fault in faults) == 2
    assert len(section.channels) == 2
    assert len(np.unique(section.faults)) >= 5
    assert not section.recipe.missing_corner
    assert np.isfinite(section.seismic).all()


def test_to_dataarray_gives_a_rotated_survey():
    cube = synthetic.fault_cube("clean", shape=(8, 10, 16), dead_traces=0.2, seed=1)
    array = cube.to_dataarray(azimuth_deg=30.0, bin_m=(25.0, 12.5))
    assert array.dims == ("inline", "crossline", "time")
    assert array.time.values[1] - array.time.values[0] == 4.0
    step = np.array([array.cdp_x[1, 0] - array.cdp_x[0, 0], array.cdp_y[1, 0] - array.cdp_y[0, 0]])
    np.testing.assert_allclose(step, 25.0 * np.array([0.5, np.sqrt(0.75)]))
    across = np.array([array.cdp_x[0, 1] - array.cdp_x[0, 0], array.cdp_y[0, 1] - array.cdp_y[0, 0]])
    assert across @ step == pytest.approx(0.0, abs=1e-6)
    assert np.hypot(*across) == pytest.approx(12.5)
    np.testing.assert_array_equal(array.live.values, cube.live)
    section = synthetic.fault_section("clean", shape=(8, 10, 16)).to_dataarray()
    assert section.dims == ("trace", "time")
    assert section.cdp_x.shape == (10,)


def test_arrays_are_read_only_and_bad_input_is_refused():
    cube = synthetic.fault_cube("clean", shape=(8, 8, 16))
    with pytest.raises(ValueError, match="read-only"):
        cube.seismic[0, 0, 0] = 1.0
    with pytest.raises(ParameterError, match="kind is 'nice'; expected one of clean"):
        synthetic.fault_cube("nice")
    with pytest.raises(ParameterError, match="no field 'colour'"):
        synthetic.fault_cube("clean", colour=3)
    with pytest.raises(ParameterError, match="shape is"):
        CubeRecipe(shape=(8, 8, 2))
    with pytest.raises(ParameterError, match="no unconformity"):
        CubeRecipe(faults=(SyntheticFault((1, 1, 1), 0.0, 60.0, 4.0, buried=True),))
    with pytest.raises(ParameterError, match="expected a CubeRecipe"):
        make_cube("clean")
