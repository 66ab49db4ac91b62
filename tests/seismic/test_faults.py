from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
import xarray as xr
from scipy import ndimage

from seismo3d.errors import ParameterError, Seismo3dWarning, ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.faults import FaultSettings, largest_first, trace_faults
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.scores import fault_score, throw_score
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.surfaces import order_by_area
from seismo3d.seismic.throw import SheetThrow
from seismo3d.synthetic import SyntheticFault, fault_cube, fault_section
from seismo3d.synthetic.wavelets import ricker

SHAPE = (48, 48, 64)


def make_faulted(strike_deg=45.0, dip_deg=65.0, throw=8.0, *, seed=1, **overrides):
    """A cube cut in the middle by one plane of a uniform throw."""
    fault = SyntheticFault((24.0, 24.0, 32.0), strike_deg, dip_deg, throw)
    recipe = {"shape": SHAPE, "wavelength": (14.0, 14.0), "population": None, "faults": (fault,)} | overrides
    return fault_cube("clean", seed=seed, **recipe)


def turned(degrees, expected):
    """Smallest angle between directions."""
    return np.abs((np.asarray(degrees, dtype=float) - expected + 180.0) % 360.0 - 180.0)


def assert_same(first, second):
    for name in ("likelihood", "labels", "throw"):
        np.testing.assert_array_equal(np.asarray(getattr(first, name)), np.asarray(getattr(second, name)))
    assert len(first.surfaces) == len(second.surfaces)
    for one, other in zip(first.surfaces, second.surfaces, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
        np.testing.assert_array_equal(one.cells, other.cells)
        np.testing.assert_array_equal(one.throw, other.throw)


@pytest.fixture(scope="module")
def cube():
    return make_faulted()


@pytest.fixture(scope="module")
def traced(cube):
    return trace_faults(cube.seismic)


# the bounds leave room: one plane is found within two voxels nearly everywhere, and its throw within half a sample
@pytest.mark.parametrize(
    ("strike_deg", "dip_deg", "throw"),
    [(90.0, 70.0, 8.0), (0.0, 75.0, -8.0), (120.0, 60.0, 10.0), (225.0, 65.0, 6.0)],
    ids=["across inlines", "reverse", "low", "dipping back"],
)
def test_one_plane_is_found_with_its_orientation_and_throw(strike_deg, dip_deg, throw):
    cube = make_faulted(strike_deg, dip_deg, throw)
    faults = trace_faults(cube.seismic)
    assert fault_score(faults.labels, cube.faults).f1 > 0.9
    assert len(faults.surfaces) == 1
    surface = faults.surfaces[0]
    assert np.median(turned(surface.strike_deg, strike_deg)) < 6.0
    assert abs(np.median(surface.dip_deg) - dip_deg) < 5.0
    assert np.nanmedian(faults.throw) == pytest.approx(throw, abs=0.5)
    assert throw_score(faults.labels, faults.throw, cube.faults, cube.throw).within > 0.9


def test_the_largest_fault_is_the_first(traced):
    areas = [surface.area for surface in traced.surfaces]
    assert areas == sorted(areas, reverse=True)


def test_sheets_are_put_in_the_order_of_their_surfaces():
    """A steep sheet of more nodes than a flat one is the smaller surface."""
    across, origin = np.array([1.0, 0.0]), np.array([5.0, 20.0])
    steep = np.zeros((20, 12), np.float32)
    flat = np.tile(2.0 * np.arange(10, dtype=np.float32), (20, 1))
    sheets = [Sheet(origin, across, 8, 1, -10.0, w, np.ones_like(w)) for w in (steep, flat)]
    assert order_by_area(sheets, (60, 60, 60)) == [1, 0]
    throws = [SheetThrow(np.full(w.shape, n, np.float32), np.ones_like(w), 1) for n, w in enumerate((steep, flat))]
    ordered, moved, today = largest_first(sheets, throws, throws, (60, 60, 60))
    assert ordered == sheets[::-1]
    assert [t.throw[0, 0] for t in (*moved, *today)] == [1.0, 0.0, 1.0, 0.0]


def test_volumes_and_surfaces_tell_the_same(cube, traced):
    labels, throw, likelihood = (np.asarray(v) for v in (traced.labels, traced.throw, traced.likelihood))
    assert labels.shape == throw.shape == likelihood.shape == SHAPE
    assert (labels.dtype, throw.dtype, likelihood.dtype) == (np.int32, np.float32, np.float32)
    assert set(np.unique(labels)) == set(range(len(traced.surfaces) + 1))
    assert np.isnan(throw[labels == 0]).all()
    assert np.isfinite(throw[labels > 0]).mean() > 0.95
    assert likelihood.min() == 0.0
    assert likelihood.max() < 1.0
    assert fault_score(likelihood > 0.5, cube.faults).recall > 0.8
    for number, surface in enumerate(traced.surfaces, start=1):
        at = np.argwhere(labels == number)
        # every vertex lies in, or right beside, a voxel that carries its number
        gap = np.abs(surface.vertices[:, None, :] - at[None]).max(axis=2).min(axis=1)
        inside = (surface.vertices >= 0).all(axis=1) & (surface.vertices <= np.array(SHAPE) - 1).all(axis=1)
        assert gap[inside].max() <= 1.5
        assert 0.0 < surface.confidence <= 1.0


def test_surface_is_a_sound_mesh_with_normals_into_the_hanging_wall(traced):
    surface = traced.surfaces[0]
    assert surface.cells.min() == 0
    assert surface.cells.max() == len(surface.vertices) - 1
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, atol=1e-5)
    assert (surface.normals[:, 2] < 0).mean() > 0.99
    # a plane through the cube's middle, 65 degrees steep, 45 degrees across the grid
    full = 48 * np.sqrt(2) * 64 / np.sin(np.radians(65.0))
    assert 0.5 * full < surface.area < 1.2 * full


def test_no_two_pieces_of_a_mesh_are_the_same(traced):
    cells = np.sort(traced.surfaces[0].cells, axis=1)
    assert len(np.unique(cells, axis=0)) == len(cells)
    assert (np.diff(cells, axis=1) > 0).all()


def test_transposed_cube_gives_the_transposed_faults(cube, traced):
    turned_cube = trace_faults(np.ascontiguousarray(cube.seismic.transpose(1, 0, 2)))
    back = np.asarray(turned_cube.labels).transpose(1, 0, 2)
    score = fault_score(back, traced.labels, tolerance=1.0)
    assert min(score.precision, score.recall) > 0.95
    # strike and its right-hand rule turn over with the axes; throw does not
    expected = (90.0 - 45.0 + 180.0) % 360.0
    assert np.median(turned(turned_cube.surfaces[0].strike_deg, expected)) < 6.0
    assert np.nanmedian(turned_cube.throw) == pytest.approx(np.nanmedian(traced.throw), abs=0.3)


@pytest.mark.parametrize("factor", [1000.0, 2.0**-20])
def test_amplitudes_may_have_any_scale(cube, traced, factor):
    scaled = trace_faults(cube.seismic * np.float32(factor))
    score = fault_score(scaled.labels, traced.labels, tolerance=1.0)
    assert min(score.precision, score.recall) > 0.99
    np.testing.assert_allclose(np.nanmedian(scaled.throw), np.nanmedian(traced.throw), atol=0.05)


def test_polarity_does_not_matter(cube, traced):
    assert_same(trace_faults(-cube.seismic), traced)


def test_shifted_section_of_a_cube_gives_shifted_faults():
    whole = make_faulted(90.0, 70.0, 8.0, shape=(48, 60, 64))
    part = trace_faults(np.ascontiguousarray(whole.seismic[:, 12:]))
    all_labels = np.asarray(trace_faults(whole.seismic).labels)[:, 12:]
    score = fault_score(part.labels, all_labels, tolerance=1.0)
    assert min(score.precision, score.recall) > 0.9


def test_one_thread_and_two_give_the_same_bits(cube, traced):
    before = numba.get_num_threads()
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread is all there is")
    try:
        results = []
        for n_threads in (1, 2):
            numba.set_num_threads(n_threads)
            results.append(trace_faults(cube.seismic))
    finally:
        numba.set_num_threads(before)
    assert_same(*results)
    assert_same(results[0], traced)


def test_input_is_left_as_it_was(cube):
    amplitudes = cube.seismic.copy()
    amplitudes[3, 4] = np.nan
    before = amplitudes.copy()
    trace_faults(amplitudes)
    np.testing.assert_array_equal(amplitudes, before)


def test_integers_of_one_byte_are_enough(cube, traced):
    coarse = np.clip(np.rint(cube.seismic * 30.0), -127, 127).astype(np.int8)
    faults = trace_faults(coarse)
    score = fault_score(faults.labels, cube.faults)
    assert score.f1 > 0.9
    assert np.nanmedian(faults.throw) == pytest.approx(np.nanmedian(traced.throw), abs=0.3)


def test_data_array_comes_back_with_its_coordinates(cube, traced):
    array = cube.to_dataarray()
    faults = trace_faults(array)
    for name in ("likelihood", "labels", "throw"):
        volume = getattr(faults, name)
        assert isinstance(volume, xr.DataArray)
        assert volume.name == name
        assert volume.dims == array.dims
        for coordinate in array.coords:
            np.testing.assert_array_equal(volume[coordinate], array[coordinate])
        np.testing.assert_array_equal(volume.values, getattr(traced, name))
    surface = faults.surfaces[0]
    assert (surface.sample_unit, surface.sample_interval) == ("ms", 4.0)
    np.testing.assert_allclose(surface.throw_ms, 4.0 * surface.throw)
    expected = SurveyGeometry.from_cube(array).strike_deg(surface.normals.astype(np.float64))
    assert turned(surface.strike_deg, expected).max() < 0.1


def test_noise_of_half_the_signal_hides_little():
    cube = make_faulted(90.0, 70.0, 10.0, noise=0.5)
    faults = trace_faults(cube.seismic)
    assert fault_score(faults.labels, cube.faults).f1 > 0.75
    assert np.nanmedian(faults.throw) == pytest.approx(10.0, abs=1.0)


def test_two_crossing_planes_are_two_surfaces():
    first = SyntheticFault((24.0, 24.0, 32.0), 90.0, 70.0, 8.0)
    second = SyntheticFault((24.0, 24.0, 32.0), 0.0, 70.0, 8.0)
    cube = make_faulted(faults=(first, second), shape=(64, 64, 64))
    faults = trace_faults(cube.seismic)
    assert fault_score(faults.labels, cube.faults).f1 > 0.75
    assert 2 <= len(faults.surfaces) <= 4
    strikes = np.array([np.median(surface.strike_deg) for surface in faults.surfaces])
    assert turned(strikes, 90.0).min() < 10.0
    assert turned(strikes, 0.0).min() < 10.0


# ----- nothing is found where there is nothing


@pytest.mark.parametrize("value", [0.0, 7.0, np.nan])
@pytest.mark.parametrize(("shape", "name"), [(SHAPE, "cube"), (SHAPE[1:], "section")])
def test_what_has_no_live_trace_is_refused(value, shape, name):
    with pytest.raises(ShapeError, match=f"{name} has no live trace"):
        trace_faults(np.full(shape, value))


def test_amplitudes_beyond_single_precision_are_refused():
    with pytest.raises(ParameterError, match=r"samples up to 1e\+200; expected at most 3.4e\+38.*Scale them down"):
        trace_faults(np.full(SHAPE, 1e200))
    for value, dtype in ((1e-50, np.float64), (1e-42, np.float32)):
        with pytest.raises(ParameterError, match=rf"no sample larger than {value:g}; expected 1e-35.*Scale them up"):
            trace_faults(np.full(SHAPE, value, dtype))


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_alone_has_no_faults(seed):
    noise = np.random.default_rng(seed).normal(size=SHAPE)
    assert (np.asarray(trace_faults(noise).labels) > 0).mean() < 1e-3


@pytest.mark.parametrize("kind", ["fault_free", "channels"])
def test_folded_layers_and_channels_are_no_faults(kind):
    cube = fault_cube(kind, seed=3, shape=SHAPE)
    assert (np.asarray(trace_faults(cube.seismic).labels) > 0).mean() < 4e-3


def test_dipping_layers_are_no_faults(rng):
    depth = np.arange(64)[None, None] - 0.6 * np.arange(48)[:, None, None] + 0.9 * np.arange(48)[None, :, None]
    trace = np.convolve(rng.normal(size=400), np.hanning(7), "same")
    cube = np.interp(depth, np.arange(-100, 300), trace)
    assert not np.asarray(trace_faults(cube).labels).any()


def steep_folds(seed, shape=(64, 64, 96), period=12.0, noise=0.1):
    """Folds with flanks of up to 50 degrees, loud and quiet layers by turns, and noise that next traces share."""
    rng = np.random.default_rng(seed)
    i, j, k = np.indices(shape, dtype=float)
    time = k - 0.7 * i - 0.6 * j - 3.2 * np.sin(2.0 * np.pi * (0.8 * i + 0.6 * j) / 50.0)
    spikes = np.zeros(4 * int(np.ptp(time)) + 400)
    layers = np.cumsum(rng.exponential(5.0, size=200) + 1.0)
    layers = layers[4 * layers < len(spikes)]
    spikes[(4 * layers).astype(int)] = rng.laplace(size=len(layers)) * np.where(layers // 40 % 2, 1.0, 0.1)
    wavelet = ricker(np.arange(-3.0 * period, 3.0 * period, 0.25), 1.0 / period)
    trace = np.convolve(spikes, wavelet, "same")
    signal = np.interp(time - time.min(), np.arange(len(trace)) / 4.0, trace)
    shared = ndimage.gaussian_filter(rng.normal(size=shape), 1.0, mode="wrap")
    return (signal / signal.std() + noise * shared / shared.std()).astype(np.float32)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_steep_folds_between_quiet_layers_are_no_faults(seed):
    # the noise moves by nothing from trace to trace, and draws the slopes of the layers that it touches
    assert not (trace_faults(steep_folds(seed)).labels > 0).any()


@pytest.fixture(scope="module")
def unbroken():
    return fault_cube("clean", seed=5, shape=SHAPE, population=None, wavelength=(14.0, 14.0)).seismic.copy()


@pytest.mark.parametrize("fill", [0.0, np.nan, -3.0])
def test_edges_of_missing_data_are_no_faults(unbroken, fill):
    cube = unbroken.copy()
    cube[:, :10] = fill
    cube[30:, 30:] = fill
    cube[20:23] = fill
    cube[:, :, :14] = fill
    faults = trace_faults(cube)
    assert not np.asarray(faults.labels).any()


@pytest.mark.parametrize(("seed", "first", "slope"), [(4, 20, 0.7), (6, 10, 1.0)])
def test_a_mute_that_slopes_is_no_fault(seed, first, slope):
    unbroken = fault_cube("fault_free", seed=seed, shape=(96, 96, 96)).seismic
    muted = np.arange(96) < (first + slope * np.arange(96))[:, None, None].astype(int)
    assert not trace_faults(np.where(muted, np.float32(0.0), unbroken)).surfaces


def test_what_all_amplitudes_share_is_taken_off(cube):
    strength = np.abs(np.asarray(cube.seismic)).max()
    shifted = np.asarray(cube.seismic, np.float64) / strength * 100.0
    plain, lifted = trace_faults(shifted), trace_faults(shifted + 3000.0)
    assert lifted.labels.any()
    score = fault_score(np.asarray(lifted.labels), plain.labels, tolerance=1.0)
    assert min(score.precision, score.recall) > 0.99


def test_dead_traces_are_no_faults(unbroken, rng):
    cube = unbroken.copy()
    cube[rng.random(SHAPE[:2]) < 0.1] = 0.0
    assert not np.asarray(trace_faults(cube).labels).any()


def test_dead_traces_and_missing_zones_do_not_hide_a_fault(rng):
    cube = make_faulted(90.0, 70.0, 8.0)
    holed = cube.seismic.copy()
    lost = rng.random(SHAPE[:2]) < 0.08
    lost[:8, :8] = True
    holed[lost] = np.nan
    faults = trace_faults(holed)
    score = fault_score(faults.labels, cube.faults)
    assert min(score.precision, score.recall) > 0.85
    assert np.nanmedian(faults.throw) == pytest.approx(8.0, abs=0.7)


@pytest.mark.parametrize(("axis", "lines"), [(0, "inline"), (1, "crossline")])
def test_lines_with_dead_ones_between_are_warned_of(unbroken, axis, lines):
    cube = np.moveaxis(unbroken.copy(), axis, 0)
    cube[::2] = 0.0
    with pytest.warns(Seismo3dWarning, match=f"0 % of the live traces have a live one on the next {lines}"):
        faults = trace_faults(np.moveaxis(cube, 0, axis))
    assert faults.surfaces == ()


def test_no_fault_is_drawn_far_into_missing_data():
    cube = make_faulted(90.0, 70.0, 8.0)
    holed = cube.seismic.copy()
    holed[:20] = np.nan
    labels = np.asarray(trace_faults(holed).labels)
    assert (labels[20:] > 0).any()
    assert not labels[:12].any()


def test_spikes_do_not_drown_the_cube(cube, traced, rng):
    spiked = cube.seismic.copy()
    at = rng.integers(0, spiked.size, 20)
    spiked.ravel()[at] = 1e6
    score = fault_score(trace_faults(spiked).labels, traced.labels)
    assert min(score.precision, score.recall) > 0.9


# ----- sections


def make_section(fault, **overrides):
    """A section of short record cut by one fault."""
    recipe = {"shape": (48, 200, 80), "wavelength": (14.0, 14.0), "population": None, "faults": (fault,)} | overrides
    return fault_section("clean", seed=7, **recipe)


def test_section_gives_polylines():
    fault = SyntheticFault((24.0, 48.0, 48.0), 0.0, 65.0, 8.0)
    section = fault_section(
        "clean", seed=2, shape=(48, 96, 96), wavelength=(14.0, 14.0), population=None, faults=(fault,)
    )
    faults = trace_faults(section.seismic)
    assert np.asarray(faults.labels).shape == (96, 96)
    assert fault_score(faults.labels, section.faults).f1 > 0.85
    assert len(faults.surfaces) == 1
    line = faults.surfaces[0]
    assert line.vertices.shape[1] == line.normals.shape[1] == line.cells.shape[1] == 2
    assert np.isnan(line.strike_deg).all()
    assert abs(np.median(line.dip_deg) - 65.0) < 5.0
    np.testing.assert_allclose(np.linalg.norm(line.normals, axis=1), 1.0, atol=1e-5)
    assert np.nanmedian(line.throw) == pytest.approx(8.0, abs=0.6)
    # one line from top to bottom: every vertex but the two ends lies on two segments
    uses = np.bincount(line.cells.ravel(), minlength=len(line.vertices))
    assert sorted(uses)[:3] == [1, 1, 2]
    assert line.area == pytest.approx(np.hypot(np.ptp(line.vertices[:, 0]), np.ptp(line.vertices[:, 1])), rel=0.1)


@pytest.mark.parametrize(
    ("strike_deg", "dip_deg", "throw"),
    [(0.0, 89.0, 2.0), (180.0, 85.0, 2.0), (0.0, 85.0, 8.0), (180.0, 60.0, 4.0)],
    ids=["upright", "leaning back", "large", "dipping back"],
)
def test_one_fault_of_a_short_section_is_found_with_its_throw(strike_deg, dip_deg, throw):
    section = make_section(SyntheticFault((24.0, 100.0, 40.0), strike_deg, dip_deg, throw), noise=0.1)
    faults = trace_faults(section.seismic)
    assert len(faults.surfaces) == 1
    assert fault_score(faults.labels, section.faults).f1 > 0.95
    assert np.nanmedian(np.abs(faults.throw)) == pytest.approx(throw, abs=0.5)


def test_noisy_traces_of_a_section_are_no_faults():
    section = make_section(SyntheticFault((24.0, 120.0, 40.0), 0.0, 80.0, 3.0), noise=0.1)
    rng = np.random.default_rng(4)
    bad = np.arange(15, 100, 12)
    seismic = section.seismic.copy()
    seismic[bad] += 0.5 * rng.normal(size=(len(bad), seismic.shape[1])).astype(np.float32)
    seismic[160:] *= 1.3
    settings = FaultSettings.for_section()
    undoubted = replace(settings, section=replace(settings.section, doubt=0.0))
    found = trace_faults(seismic)
    score = fault_score(found.labels, section.faults)
    assert (len(found.surfaces), score.precision > 0.95, score.recall > 0.9) == (1, True, True)
    likely, taken = (np.asarray(f.likelihood) for f in (found, trace_faults(seismic, settings=undoubted)))
    on_fault = (section.faults > 0) & (likely > 0)
    assert likely[:105].max() < 0.6 * np.median(likely[on_fault])
    # what this takes: without the question for a move the bad traces are nearly as likely as the fault
    assert taken[:105].max() > 0.8 * np.median(taken[on_fault])


@pytest.mark.parametrize("seed", [2001, 2002])
def test_a_section_of_strong_noise_is_matched_by_registration(seed):
    section = fault_section("noise", seed=seed, shape=(64, 128, 96))
    settings = FaultSettings.for_section()
    slopes_alone = replace(settings, registration=replace(settings.registration, share=(0.0, 0.0, 0.0)))
    right = []
    for chosen in (settings, slopes_alone):
        likelihood = np.asarray(trace_faults(section.seismic, settings=chosen).likelihood)
        likeliest = likelihood >= np.sort(likelihood, axis=None)[-int((section.faults > 0).sum()) // 2]
        right.append(fault_score(likeliest, section.faults).precision)
    assert right[0] > 0.45
    assert right[0] > right[1] + 0.05


def test_surfaces_of_a_section_are_as_likely_as_its_volume():
    section = make_section(SyntheticFault((24.0, 100.0, 40.0), 0.0, 70.0, 5.0))
    faults = trace_faults(section.seismic)
    volume = np.asarray(faults.likelihood)
    along = ndimage.maximum_filter(volume, (3, 3))[np.asarray(faults.labels) == 1]
    assert np.median(faults.surfaces[0].likelihood) == pytest.approx(np.median(along), abs=0.05)


def test_upright_faults_ten_traces_apart_stay_apart():
    plain = make_section(SyntheticFault((24.0, 20.0, 40.0), 0.0, 89.0, 3.0)).seismic
    section = plain.copy()
    for trace in range(60, 120, 10):
        section[trace:] = np.roll(section[trace:], 3, axis=1)
    labels = np.asarray(trace_faults(np.ascontiguousarray(section[:, 18:])).labels)
    found = np.flatnonzero((labels[40:140] > 0).mean(axis=1) > 0.5) + 40
    gaps = np.abs(found[:, None] - np.arange(59.5, 119.5, 10.0))
    assert (gaps.min(axis=0) <= 1.5).all()
    assert (gaps.min(axis=1) <= 1.5).all()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_section_of_noise_alone_has_next_to_no_faults(seed):
    noise = np.random.default_rng(seed).normal(size=(300, 200))
    assert (np.asarray(trace_faults(noise).labels) > 0).mean() < 5e-3


@pytest.mark.parametrize("kind", ["fault_free", "channels"])
def test_section_of_folded_layers_and_channels_has_no_faults(kind):
    section = fault_section(kind, seed=3, shape=(48, 200, 128))
    assert (np.asarray(trace_faults(section.seismic).labels) > 0).mean() < 4e-3


def test_mirrored_section_gives_the_mirrored_fault():
    fault = SyntheticFault((24.0, 48.0, 48.0), 0.0, 65.0, 8.0)
    recipe = {"shape": (48, 96, 96), "wavelength": (14.0, 14.0), "population": None, "faults": (fault,)}
    section = fault_section("clean", seed=2, **recipe).seismic
    plain, mirrored = trace_faults(section), trace_faults(np.ascontiguousarray(section[::-1]))
    score = fault_score(np.asarray(mirrored.labels)[::-1], plain.labels, tolerance=1.5)
    assert min(score.precision, score.recall) > 0.95
    assert np.nanmedian(mirrored.throw) == pytest.approx(np.nanmedian(plain.throw), abs=0.3)


# ----- the interface


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros(100), r"shape \(100,\); expected \(inline, crossline, sample\) or \(trace, sample\)"),
        (np.zeros((8, 8, 8, 16)), r"shape \(8, 8, 8, 16\); expected"),
        (np.zeros(SHAPE, np.complex64), "type complex64; expected real numbers"),
        (np.zeros(SHAPE, bool), "type bool; expected real numbers"),
        (np.full((20, 20), "a"), "expected real numbers"),
        (np.zeros((7, 20, 40)), r"shape \(7, 20, 40\); expected at least \(8, 8, 16\)"),
        (np.zeros((20, 7, 40)), r"expected at least \(8, 8, 16\). Give one line of it as a 2D section"),
        (np.zeros((7, 7, 40)), "Give a larger cube"),
        (np.zeros((20, 20, 15)), "Give a larger cube"),
        (np.zeros((7, 40)), r"expected at least \(8, 16\). Give a larger section"),
    ],
)
def test_refusals(values, message):
    with pytest.raises(ShapeError, match=message):
        trace_faults(values)


def test_smallest_cube_is_taken(rng):
    assert np.asarray(trace_faults(rng.normal(size=(8, 8, 16))).labels).shape == (8, 8, 16)


def test_progress_is_told_stage_by_stage(cube):
    told = []
    trace_faults(cube.seismic, progress=lambda stage, share: told.append((stage, share)))
    stages = list(dict.fromkeys(stage for stage, _ in told))
    assert stages == ["dip", "misfit", "scan", "link", "throw", "surfaces"]
    assert all(0.0 <= share <= 1.0 for _, share in told)
    assert told[-1] == ("surfaces", 1.0)
    for stage in stages:
        shares = [share for name, share in told if name == stage]
        assert shares == sorted(shares)


def test_stricter_settings_find_nothing(cube):
    faults = trace_faults(cube.seismic, settings=FaultSettings(choice=ChoiceSettings(least_area=1e9, company_area=1e9)))
    assert faults.surfaces == ()
    assert faults.settings["choice"]["least_area"] == 1e9


def test_save_and_load_give_the_same_back(traced, cube, tmp_path):
    traced.save(tmp_path / "bare")
    back = FaultSet.load(tmp_path / "bare")
    assert_same(back, traced)
    # tuples may come back as lists of the same numbers
    assert back.settings["scan"]["n_strikes"] == traced.settings["scan"]["n_strikes"]
    labelled = trace_faults(cube.to_dataarray())
    labelled.save(tmp_path / "labelled")
    again = FaultSet.load(tmp_path / "labelled")
    assert_same(again, labelled)
    xr.testing.assert_identical(again.labels, labelled.labels)
