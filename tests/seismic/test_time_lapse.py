from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import ndimage

from seismo3d.errors import GeometryError, ParameterError, Seismo3dWarning, ShapeError
from seismo3d.plot import time_lapse_section
from seismo3d.seismic import time_lapse
from seismo3d.seismic.time_lapse import CubeAlignment, TimeLapseSettings, align_cubes
from seismo3d.synthetic import SyntheticCube, make_cube, recipe_of

SHAPE = (36, 36, 72)
INNER = (slice(5, -5), slice(5, -5), slice(14, -16))


@pytest.fixture(scope="module")
def folded() -> SyntheticCube:
    recipe = recipe_of("folded", shape=SHAPE, population=None, wavelength=(14.0, 14.0), fold_slope=(0.5, 0.6))
    return make_cube(recipe, seed=2101)


def warp(base: np.ndarray, shifts: list[Any]) -> np.ndarray:
    """The monitor that holds at x + s(x) what the base holds at x: found by running x back."""
    at = np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in base.shape), indexing="ij"))
    fields = [np.broadcast_to(s, base.shape) for s in shifts]
    place = at.copy()
    for _ in range(25):
        place = at - np.stack([ndimage.map_coordinates(f, place, order=1, mode="nearest") for f in fields])
    return ndimage.map_coordinates(base, place, order=3, mode="nearest").astype(np.float32)


def bump() -> np.ndarray:
    i, j, k = np.meshgrid(*(np.arange(n, dtype=float) for n in SHAPE), indexing="ij")
    return 3.0 + 1.5 * np.exp(-((i - 18) ** 2 + (j - 16) ** 2) / 150.0) * np.clip((k - 25) / 25, 0.0, 1.0)


@pytest.fixture(scope="module")
def pair(folded: SyntheticCube) -> tuple[np.ndarray, np.ndarray, CubeAlignment]:
    """A monitor of another strength, with noise, a local pull-down, dead and missing traces, and its alignment."""
    base = np.array(folded.seismic)
    noise = np.random.default_rng(3).normal(size=SHAPE)
    monitor = 1.8 * warp(base, [0.0, 0.0, bump()]) + 0.15 * noise
    monitor = monitor.astype(np.float32)
    monitor[12, 12:15] = 0.0
    monitor[20:22, 25] = np.nan
    return base, monitor, align_cubes(base, monitor)


def test_known_pull_down_is_found_and_its_uncertainty_is_honest(pair: Any) -> None:
    _, _, found = pair
    error = (found.shift - bump())[INNER]
    assert np.sqrt(np.mean(error**2)) < 0.2
    # within two standard deviations nine times out of ten, and not for their being huge
    assert (np.abs(error) < 2.0 * found.shift_std[INNER]).mean() > 0.9
    assert np.median(found.shift_std[INNER]) < 0.25
    assert found.start[:2] == (0.0, 0.0)
    assert abs(found.start[2] - 3.3) < 1.0


@pytest.mark.parametrize("noise", [0.0, 0.03])
@pytest.mark.parametrize("slope", [0.1, 0.55])
def test_shifts_of_a_part_are_found_in_clean_cubes_too(slope: float, noise: float, rng: np.random.Generator) -> None:
    recipe = recipe_of(
        "folded", shape=SHAPE, population=None, wavelength=(14.0, 14.0), fold_slope=(slope - 0.05, slope + 0.05)
    )
    base = np.array(make_cube(recipe, seed=2101).seismic)
    lens = bump() - 3.0
    found = align_cubes(base, warp(base, [0.0, 0.0, lens]) + noise * rng.normal(size=SHAPE))
    error = (found.shift - lens)[INNER]
    # windows are a third as wide as the lens, which rounds its top and foot
    assert np.abs(error).max() < 0.35
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert (np.abs(error) < 2.0 * found.shift_std[INNER]).mean() > 0.9
    # traces, along which dipping layers could be shifted instead
    for values, spread in (
        (found.inline_shift, found.inline_std), (found.crossline_shift, found.crossline_std)
    ):  # fmt: skip
        assert np.sqrt(np.mean(values[INNER] ** 2)) < 0.4
        assert (np.abs(values[INNER]) < 2.0 * spread[INNER]).mean() > 0.9


@pytest.mark.parametrize("noise", [0.3, 0.6])
def test_uncertainty_is_honest_in_noise(noise: float) -> None:
    """Noise of the wavelet's band, alike on neighbouring traces, in both cubes; shifts that change along all axes."""
    rng = np.random.default_rng(7)

    def smooth(width: tuple[float, float, float], most: float) -> np.ndarray:
        values = ndimage.gaussian_filter(rng.normal(size=SHAPE), width)
        return most * values / np.abs(values).max()

    recipe = recipe_of("folded", shape=SHAPE, population=None, wavelength=(14.0, 14.0), fold_slope=(0.35, 0.45))
    base = np.array(make_cube(recipe, seed=4).seismic)
    truth = [smooth((10.0, 10.0, 20.0), 0.5) + whole for whole in (0.3, -0.2)]
    truth.append(1.5 + smooth((10.0, 10.0, 20.0), 1.0))
    pair = []
    for cube in (base, warp(base, truth)):
        band = ndimage.gaussian_filter(rng.normal(size=SHAPE), (1.0, 1.0, 1.5))
        band -= ndimage.gaussian_filter1d(band, 3.0, axis=2)
        pair.append(cube + noise * base.std() * band / band.std())
    found = align_cubes(*pair)
    shifts = (found.inline_shift, found.inline_std), (found.crossline_shift, found.crossline_std)
    for (values, spread), true in zip((*shifts, (found.shift, found.shift_std)), truth, strict=True):
        assert (np.abs(values - true) < 2.0 * spread)[INNER].mean() > 0.93
    # noise is no structure along the layers: it tells of no lateral shift
    assert np.median(found.inline_std[INNER]) > 0.8 * TimeLapseSettings().prior[0]
    assert np.sqrt(np.mean((found.shift - truth[2])[INNER] ** 2)) < 0.06 + 0.5 * noise


def test_dead_and_missing_traces_are_bridged(pair: Any) -> None:
    _, _, found = pair
    for place in ((12, 13), (20, 25)):
        assert np.abs(found.shift[place][14:-16] - bump()[place][14:-16]).max() < 0.5
    assert (found.aligned[12, 13] == 0.0).mean() > 0.9  # dead
    assert np.isnan(found.aligned[20, 25]).mean() > 0.9  # missing
    assert np.isfinite(found.aligned[:, :24]).all()


def test_aligned_monitor_is_the_base_at_its_own_strength(pair: Any) -> None:
    base, monitor, found = pair
    known = np.nan_to_num(found.aligned[INNER]) != 0.0
    left = (found.aligned - 1.8 * base)[INNER][known]
    before = np.nan_to_num(monitor - 1.8 * base)[INNER][known]
    assert left.std() < 0.3 * before.std()


def test_lateral_shift_is_found_where_layers_dip(folded: SyntheticCube) -> None:
    base = np.array(folded.seismic)
    found = align_cubes(base, warp(base, [0.8, -1.1, 2.0]))
    for values, truth, limit in ((found.inline_shift, 0.8, 0.25), (found.crossline_shift, -1.1, 0.25)):
        assert abs(np.median(values[INNER]) - truth) < limit
    assert np.abs(np.median(found.shift[INNER]) - 2.0) < 0.1


def test_level_layers_tell_nothing_about_lateral_shifts_and_it_says_so() -> None:
    rng = np.random.default_rng(4)
    trace = ndimage.gaussian_filter1d(rng.normal(size=SHAPE[2] + 20), 2.0)
    base = np.tile(trace[10:-10] / trace.std(), (*SHAPE[:2], 1)).astype(np.float32)
    monitor = np.tile(np.interp(np.arange(SHAPE[2]) - 2.0 + 10.0, np.arange(len(trace)), trace) / trace.std(),
                      (*SHAPE[:2], 1)).astype(np.float32)  # fmt: skip
    found = align_cubes(base, monitor)
    assert abs(np.median(found.shift[INNER]) - 2.0) < 0.1
    assert np.median(found.inline_std[INNER]) > 0.9 * TimeLapseSettings().prior[0]
    assert np.median(found.shift_std[INNER]) < 0.2


def test_same_cube_is_itself_to_its_outer_faces(folded: SyntheticCube) -> None:
    base = np.asarray(folded.seismic)
    # shifts of rounding lead off the outer traces, which are as good as any
    np.testing.assert_allclose(align_cubes(base, base).aligned, base, atol=1e-3 * np.abs(base).max())


def test_same_cube_has_no_shift(folded: SyntheticCube) -> None:
    found = align_cubes(folded.seismic, folded.seismic)
    for values in (found.shift, found.inline_shift, found.crossline_shift):
        assert np.abs(values[INNER]).max() < 0.05


def test_coordinates_and_units_are_those_of_the_base(folded: SyntheticCube) -> None:
    base = folded.to_dataarray()
    monitor = base.copy(data=warp(np.array(folded.seismic), [0.0, 0.0, 2.0]))
    base[3, 4] = np.nan
    monitor[3, 4] = np.nan
    found = align_cubes(base, monitor)
    assert found.shift.dims == base.dims
    assert np.median(found.shift.values[INNER]) == pytest.approx(8.0, abs=0.4)  # two samples of 4 ms
    assert np.isnan(found.shift.values[3, 4]).all()
    assert np.isfinite(np.delete(found.shift.values.reshape(-1, SHAPE[2]), 3 * SHAPE[1] + 4, axis=0)).all()
    axes = time_lapse_section(base, monitor, found, axes=Figure().subplots(1, 4), inline=1020)
    before, after = (np.abs(axes[k].images[0].get_array())[14:-16].mean() for k in (1, 2))
    assert after < 0.4 * before
    with pytest.raises(ShapeError, match=r"^monitor has shape .* and the alignment .*; expected the same"):
        time_lapse_section(base, monitor[:, 1:], found, inline=1020)
    # a monitor that lies deeper has nothing that meets the foot of the base: no difference is shown there
    unknown = np.ma.getmaskarray(axes[2].images[0].get_array())
    assert unknown[-1].all()
    assert unknown[:-3, 5:].mean() < 0.01
    # all shifts are of one sign: no colour has the look of the other
    assert axes[3].images[0].get_cmap().name == "viridis"
    mixed = replace(found, shift=found.shift - 8.0)
    shift = time_lapse_section(base, monitor, mixed, axes=Figure().subplots(1, 4), inline=1020)[3].images[0]
    low, high = shift.get_clim()
    assert (shift.get_cmap().name, low) == ("RdBu_r", -high)
    # what rounding leaves of no shift is not spread over all colours
    still = replace(found, shift=found.shift * 1e-9)
    drawn = time_lapse_section(base, monitor, still, axes=Figure().subplots(1, 4), inline=1020)[3].images[0]
    assert drawn.get_clim() == pytest.approx((-0.04, 0.04))
    assert drawn.get_cmap().name == "RdBu_r"


def test_large_cubes_are_thinned_for_the_coarse_step(folded: SyntheticCube, monkeypatch: pytest.MonkeyPatch) -> None:
    base = np.array(folded.seismic)
    monitor = warp(base, [0.0, 0.0, 4.0])
    seen = []
    register = time_lapse.register
    monkeypatch.setattr(time_lapse, "register", lambda a, b, **k: (seen.append(a.shape), register(a, b, **k))[1])
    found = align_cubes(base, monitor, settings=TimeLapseSettings(largest=40_000))
    assert seen == [(18, 18, 36)]
    assert found.start == pytest.approx((0.0, 0.0, 4.0), abs=0.6)
    assert np.median(found.shift[INNER]) == pytest.approx(4.0, abs=0.1)


def test_without_a_coarse_answer_windows_start_from_the_best_vertical_shift(
    folded: SyntheticCube, monkeypatch: pytest.MonkeyPatch
) -> None:
    register = time_lapse.register

    def lost(a: Any, b: Any, **more: Any) -> Any:
        found = register(a, b, **more)
        assert found.converged
        return replace(found, state="no_overlap", T_target_source=np.eye(4) * 99.0)

    monkeypatch.setattr(time_lapse, "register", lost)
    base = np.array(folded.seismic)
    found = align_cubes(base, warp(base, [0.0, 0.0, 6.0]))
    assert not found.coarse.converged
    assert found.start == pytest.approx((0.0, 0.0, 6.0), abs=0.1)
    assert np.median(found.shift[INNER]) == pytest.approx(6.0, abs=0.1)


def test_refusals(folded: SyntheticCube) -> None:
    base = folded.to_dataarray()
    with pytest.raises(ShapeError, match="two cubes of one shape"):
        align_cubes(base, base[:, :, :-1])
    with pytest.raises(ShapeError, match=r"base has shape \(\d+, 64\); expected a cube"):
        align_cubes(base[:, 0, :64], base[:, 0, :64])
    with pytest.raises(ShapeError, match=r"monitor has shape \(\d+, 64\); expected a cube"):
        align_cubes(base, base[:, 0, :64])
    with pytest.raises(ShapeError, match="at least 8 traces"):
        align_cubes(base[:4], base[:4])
    with pytest.raises(ShapeError, match="monitor has elements of type complex64; expected real"):
        align_cubes(base, base.astype(np.complex64))
    moved = base.assign_coords(inline=base["inline"] + 1)
    with pytest.raises(GeometryError, match="differ in their inline"):
        align_cubes(base, moved)
    with pytest.raises(GeometryError, match="no live trace in common"):
        align_cubes(base, base * 0.0)
    with pytest.raises(ParameterError, match=r"polarity is reversed. Give -monitor"):
        align_cubes(base, -warp(np.array(folded.seismic), [0.0, 0.0, 2.0]))
    with pytest.raises(ParameterError, match=r"monitor has samples up to .*e\+39; expected at most 3.4e\+38"):
        align_cubes(base, base.astype(np.float64) * 1e39)


def test_muted_tops_do_not_count(folded: SyntheticCube) -> None:
    base = np.array(folded.seismic)
    monitor = warp(base, [0.0, 0.0, 3.0])
    base[:, :, :20] = monitor[:, :, :20] = 0.0
    found = align_cubes(base, monitor)
    assert np.median(np.asarray(found.shift)[5:-5, 5:-5, 24:-16]) == pytest.approx(3.0, abs=0.04)


def test_a_spike_does_not_count(folded: SyntheticCube) -> None:
    base = np.array(folded.seismic)
    monitor = warp(base, [0.0, 0.0, 1.0])
    monitor[5, 5, 5] = 1e9
    found = align_cubes(base, monitor)
    assert np.abs(found.shift - 1.0)[INNER].mean() < 0.1
    assert found.aligned[5, 5, 5] != 0.0


def test_cubes_of_other_lines_or_axes_are_refused(folded: SyntheticCube) -> None:
    cube = folded.to_dataarray()
    beside = cube.assign_coords(inline=cube["inline"] + 1_000_000)
    with pytest.raises(GeometryError, match="differ in their inline coordinates"):
        align_cubes(beside, beside.assign_coords(inline=beside["inline"] + 1))
    with pytest.raises(ShapeError, match=r"monitor\.transpose\('inline', 'crossline', 'time'\)"):
        align_cubes(cube, cube.transpose("crossline", "inline", "time"))


def test_a_shift_off_the_survey_is_no_start(folded: SyntheticCube, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing lies on nothing, nothing misfits; the best vertical shift is taken."""
    coarse = time_lapse.register(folded.seismic, folded.seismic, model="translation")
    off = coarse.T_target_source.copy()
    off[0, 3] = 1.2 * SHAPE[0]
    monkeypatch.setattr(time_lapse, "register", lambda *_, **__: replace(coarse, T_target_source=off))
    monitor = np.roll(folded.seismic, 2, axis=2)
    start = align_cubes(folded.seismic, monitor, settings=TimeLapseSettings(levels=(0.0,))).start
    np.testing.assert_allclose(start, [0.0, 0.0, 2.0], atol=0.1)


@pytest.mark.parametrize("dip", [0.0, 0.3])
def test_shifts_hold_to_the_ends_of_the_traces(rng: np.random.Generator, dip: float) -> None:
    """Of a wavelet of eight samples coarse smoothing leaves little but what lies beyond the ends."""
    n, count = 32, 96
    k, fine = np.arange(float(count)), np.arange(-40.0, count + 40.0, 0.125)
    t = np.arange(-160, 161) / 2000.0
    wavelet = (1.0 - 2.0 * (30.0 * np.pi * t) ** 2) * np.exp(-((30.0 * np.pi * t) ** 2))
    trace = np.convolve(rng.normal(size=len(fine)) * (rng.random(len(fine)) < 0.04), wavelet, "same")
    deeper = np.interp(k, [40.0, 60.0], [0.0, 1.0])
    at = k - dip * (np.arange(n)[:, None, None] - n / 2) + np.zeros((n, n, 1))
    base, monitor = (np.interp(place, fine, trace / trace.std()) for place in (at, at - deeper))
    noise = 0.05 * rng.normal(size=(2, *base.shape))
    found = align_cubes(base + noise[0], monitor + noise[1])
    inner = np.asarray(found.shift)[6:-6, 6:-6]
    np.testing.assert_allclose(np.median(inner, axis=(0, 1))[[20, 70, 80, 90]], [0.0, 1.0, 1.0, 1.0], atol=0.2)


def test_another_cube_is_told_and_a_noisy_monitor_is_not(folded: SyntheticCube, rng: np.random.Generator) -> None:
    base = np.array(folded.seismic)
    noise = ndimage.gaussian_filter1d(rng.normal(size=SHAPE), 1.5, axis=2)
    noise *= base.std() / noise.std()
    other = make_cube(recipe_of("folded", shape=SHAPE, population=None, wavelength=(14.0, 14.0)), seed=7).seismic
    for unrelated in (noise, other):
        with pytest.warns(Seismo3dWarning, match="monitor is no more like base than another cube is") as told:
            align_cubes(base, unrelated)
        assert len(told) == 1
    # warnings are errors here
    assert np.median(align_cubes(base, np.roll(base, 2, axis=2) + 3.0 * noise).shift[INNER]) == pytest.approx(2, abs=1)


def test_a_muted_cube_is_as_like_as_a_whole_one(folded: SyntheticCube) -> None:
    base = np.array(folded.seismic)
    base[:, :, :40] = 0.0
    with pytest.raises(ParameterError, match=r"polarity is reversed"):
        align_cubes(base, -base)


def test_a_far_monitor_is_not_told_that_its_polarity_is_reversed() -> None:
    base = make_cube(recipe_of("clean", shape=(24, 24, 64)), seed=1).seismic
    far = np.roll(base, 21, axis=2)
    # within a quarter of the traces it is most like the base with its sign changed
    correlation = time_lapse._correlate_lags(*(time_lapse._prepare(cube, "cube")[0] for cube in (base, far)))
    assert -correlation[1:-1].min() > 0.35 > 1.25 * correlation[1:-1].max()
    found = align_cubes(base, far, settings=TimeLapseSettings(levels=(0.0,)))
    np.testing.assert_allclose(found.start, [0.0, 0.0, 21.0], atol=0.1)


def test_a_monitor_reversed_and_noisy_is_told_so(folded: SyntheticCube, rng: np.random.Generator) -> None:
    base = np.array(folded.seismic)
    noise = ndimage.gaussian_filter1d(rng.normal(size=SHAPE), 1.5, axis=2)
    noise *= 2.0 * base.std() / noise.std()
    with pytest.warns(Seismo3dWarning, match="monitor is more like base with its sign changed, and not much"):
        align_cubes(base, noise - base, settings=TimeLapseSettings(levels=(0.0,)))


@pytest.mark.parametrize(("state", "start"), [("converged", 3.0), ("ambiguous", 3.0), ("poor_fit", 0.0)])
def test_a_shift_of_the_whole_that_is_one_of_several_is_tried(folded, state, start):
    base = np.asarray(folded.seismic, dtype=np.float32)
    monitor = warp(base, [3.0, 0.0, 0.0]).astype(np.float32)
    known = np.ones(SHAPE, dtype=bool)
    coarse = time_lapse.register(base, monitor, model="translation", stages=("local",))
    moved = np.eye(4)
    moved[0, 3] = -3.0
    coarse = replace(coarse, state=state, T_target_source=moved)
    found = time_lapse._choose_start(base, monitor, known, known, coarse, 0.0)
    np.testing.assert_array_equal(found, [start, 0.0, 0.0])
