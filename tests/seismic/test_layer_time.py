"""Layer time and tracks of small synthetic cubes whose layers are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.errors import ParameterError, Seismo3dWarning, ShapeError
from seismo3d.seismic._kernels_layers import make_increasing, make_runs_increasing
from seismo3d.seismic._kernels_tracks import cross_levels, match_waveforms, read_layers, read_runs
from seismo3d.seismic.fault_links import LinkSettings, SurfaceGrid, doubt_matches
from seismo3d.seismic.horizon_search import find_seeds
from seismo3d.seismic.layer_graph import LayerGraph, LayerTimeSettings, list_rounds, solve_graph, thickness_variance
from seismo3d.seismic.layer_parts import stretched
from seismo3d.seismic.layer_time import LayerModel, model_layers
from seismo3d.seismic.shifts import ShiftField, ShiftSettings, are_measured, judge_misfits
from seismo3d.synthetic import SyntheticCube, SyntheticFault, make_cube, recipe_of

SHAPE = (48, 48, 80)


@pytest.fixture(scope="module")
def folded() -> SyntheticCube:
    recipe = recipe_of("folded", shape=SHAPE, population=None, wavelength=(12.0, 12.0), dead_traces=0.02)
    return make_cube(recipe, seed=4)


@pytest.fixture(scope="module")
def folded_layers(folded: SyntheticCube) -> LayerModel:
    return model_layers(folded.to_dataarray())


@pytest.fixture(scope="module")
def faulted() -> SyntheticCube:
    fault = SyntheticFault((24.0, 24.0, 40.0), 10.0, 65.0, 9.0)
    recipe = replace(recipe_of("clean", shape=SHAPE, wavelength=(12.0, 12.0)), population=None, faults=(fault,))
    return make_cube(recipe, seed=3)


@pytest.fixture(scope="module")
def faults(faulted: SyntheticCube) -> Any:
    return s3.trace_faults(faulted.seismic)


@pytest.fixture(scope="module")
def faulted_layers(faulted: SyntheticCube, faults: Any) -> LayerModel:
    return model_layers(faulted.seismic, faults=faults)


def depth_error(times: np.ndarray, truth: np.ndarray, live: np.ndarray, share: float = 0.5) -> float:
    """Return what a share of the errors, in samples, stays below after one monotone fit for the whole cube."""
    found, wanted = times[live].ravel(), truth[live].ravel()
    order = np.argsort(found)
    bins = np.array_split(order, 100)
    x = np.array([np.median(found[b]) for b in bins])
    y = np.maximum.accumulate([np.median(wanted[b]) for b in bins])
    inside = (found > x[0]) & (found < x[-1])
    return float(np.quantile(np.abs(np.interp(found, x, y) - wanted)[inside], share))


def test_layer_time_follows_folds_past_dead_traces(folded: SyntheticCube) -> None:
    cube = folded.to_dataarray()
    times = s3.layer_time(cube)
    assert times.dims == cube.dims
    assert times.dtype == np.float32
    values = times.values
    assert np.isfinite(values[folded.live]).all()
    assert np.isnan(values[~folded.live]).all()
    assert (np.diff(values[folded.live], axis=1) > 0).all()
    assert depth_error(values, folded.layer_time, folded.live) < 0.5
    assert np.nanmin(np.abs(values[22:26, 22:26, 40] - 40.0)) < 1e-3


def test_layer_time_crosses_a_fault_by_its_throw(
    faulted: SyntheticCube, faulted_layers: LayerModel, faults: Any
) -> None:
    assert len(faults.surfaces) == 1
    assert depth_error(faulted_layers.increasing(), faulted.layer_time, faulted.live, 0.8) < 1.0
    alone = s3.layer_time(faulted.seismic)
    assert depth_error(alone, faulted.layer_time, faulted.live, 0.8) > 2.0  # without the fault the sides do not fit


def test_track_from_one_seed_is_true_on_both_sides(
    faulted: SyntheticCube, faulted_layers: LayerModel, faults: Any
) -> None:
    truth = faulted.horizons[2]
    seed = (10, 8, float(truth[10, 8]))
    (track,) = s3.trace_tracks(faulted.seismic, [seed], faults=faults, layers=faulted_layers)
    known = np.isfinite(truth)
    error = np.abs(track.depth - truth)[known]
    assert (error <= 1.0).mean() > 0.95
    assert np.isfinite(track.depth[~known]).mean() < 0.3  # in the gap that the fault leaves there is no horizon
    found = np.isfinite(track.depth)
    np.testing.assert_array_equal(found, np.isfinite(track.confidence))
    assert ((track.confidence[found] >= 0) & (track.confidence[found] <= 1)).all()


def test_seeds_are_in_coordinates_and_may_be_several(folded: SyntheticCube, folded_layers: LayerModel) -> None:
    cube = folded.to_dataarray()
    truth = folded.horizons[1]
    places = [tuple(p) for p in np.argwhere(np.isfinite(truth) & folded.live)[[100, -100]]]
    seeds = [(1001 + i, 2001 + j, 600.0 + 4.0 * float(truth[i, j])) for i, j in places]
    one, both = s3.trace_tracks(cube, [seeds[0], seeds], layers=folded_layers)
    assert one.sample_unit == "ms"
    assert both.seeds.shape == (2, 3)
    for track in (one, both):
        error = np.abs((track.depth - 600.0) / 4.0 - truth)
        assert (error[np.isfinite(truth) & folded.live] <= 1.0).mean() > 0.95
    for (i, j), (_, _, time) in zip(places, seeds, strict=True):
        assert both.depth[i, j] == pytest.approx(time, abs=4.0)


def test_a_track_near_the_foot_of_the_cube_passes_through_its_seed(
    folded: SyntheticCube, folded_layers: LayerModel
) -> None:
    truth = np.where(folded.live, folded.horizons[-1], np.nan)
    i, j = np.unravel_index(np.nanargmax(truth), truth.shape)
    (track,) = s3.trace_tracks(folded.seismic, [(i, j, float(truth[i, j]))], layers=folded_layers)
    assert track.depth[i, j] == pytest.approx(truth[i, j], abs=1e-3)
    known = np.isfinite(truth)
    assert (np.abs(track.depth - truth)[known] <= 1.0).mean() > 0.95


def test_a_seed_parted_from_all_around_is_held_and_told(folded: SyntheticCube, folded_layers: LayerModel) -> None:
    """The seeds of one track that contradict each other across a trace: the track cannot run through both."""
    first, second = (20, 20, float(folded.horizons[1, 20, 20])), (21, 20, float(folded.horizons[1, 21, 20]) + 9.0)
    with pytest.warns(Seismo3dWarning, match=r"seeds\[0\] \(2\d, 20, [\d.]+\) is parted"):
        track = s3.trace_tracks(folded.seismic, [[first, second]], layers=folded_layers)[0]
    assert track.depth[20, 20] == pytest.approx(first[2], abs=1e-4)
    assert track.depth[21, 20] == pytest.approx(second[2], abs=1e-4)


def test_a_thicker_waveform() -> None:
    wave = np.exp(-0.5 * (np.arange(-20, 21) / 4.0) ** 2).astype(np.float32)
    thin, same, thick = stretched(wave, 10, np.array([-0.2, 0.0, 0.25]))
    t = np.arange(-10, 11)
    np.testing.assert_allclose(same, wave[10:31], atol=1e-6)
    np.testing.assert_allclose(thin, np.exp(-0.5 * (t / 3.2) ** 2), atol=1e-3)
    np.testing.assert_allclose(thick, np.exp(-0.5 * (t / 5.0) ** 2), atol=1e-3)


def test_thicker_layers_are_seen_through_the_same_wavelet(rng: np.random.Generator) -> None:
    places, strengths = rng.uniform(-60.0, 60.0, 60), rng.normal(size=60)
    x = np.arange(-44, 45)[:, None]

    def ricker(t: np.ndarray) -> np.ndarray:
        u = (np.pi * t / 14.0) ** 2
        return (1.0 - 2.0 * u) * np.exp(-u)

    def seen(share: float) -> np.ndarray:
        return (strengths * ricker(x - (1.0 + share) * places)).sum(axis=1).astype(np.float32)

    spectrum = np.abs(np.fft.rfft(ricker(np.arange(-128, 128))))
    shares = np.array([-0.25, -0.1, 0.0, 0.1, 0.25])
    for share, found, without in zip(
        shares, stretched(seen(0.0), 16, shares, spectrum), stretched(seen(0.0), 16, shares), strict=True
    ):
        truth = seen(share)[28:61]
        alike, alike_without = (float(np.corrcoef(truth, wave)[0, 1]) for wave in (found, without))
        assert alike > 0.97
        assert alike > alike_without or share == 0.0


@pytest.mark.parametrize(("event", "sign"), [("peak", 1.0), ("trough", -1.0)])
def test_tracks_snap_to_events(folded: SyntheticCube, folded_layers: LayerModel, event: str, sign: float) -> None:
    i, j = (24, 24) if folded.live[24, 24] else (24, 25)
    wave = sign * folded.seismic[i, j]
    k = 30 + int(wave[30:50].argmax())
    (track,) = s3.trace_tracks(folded.seismic, [(i, j, k)], event=event, layers=folded_layers)
    found = np.argwhere(np.isfinite(track.depth))
    on_event = 0
    for a, b in found:
        z = int(np.rint(track.depth[a, b]))
        near = sign * folded.seismic[a, b, max(z - 1, 0) : z + 2]
        on_event += int(len(near) == 3 and near[1] >= near.max() - 1e-6)
    assert on_event / len(found) > 0.95


def test_horizons_are_found_without_seeds(folded: SyntheticCube, folded_layers: LayerModel) -> None:
    seeds = find_seeds(folded_layers, count=3)
    assert 1 <= len(seeds) <= 3
    assert (np.diff(seeds[:, 2]) > 0).all()
    tracks = s3.trace_tracks(folded.seismic, count=3, layers=folded_layers)
    same = s3.find_horizons(folded.seismic, 3, layers=folded_layers)
    assert len(tracks) == len(same) >= 1
    for track, other in zip(tracks, same, strict=True):
        np.testing.assert_array_equal(track.depth, other.depth)
    assert all(track.share > 0.5 for track in tracks)


def test_correlation_finds_the_lag() -> None:
    wave = np.sin(np.arange(60) * 0.4) * np.exp(-(((np.arange(60) - 33) / 9.0) ** 2))
    row, part, taper = wave[None].astype(np.float32), wave[13:54].astype(np.float32), np.hanning(43)[1:-1]
    whole = np.ones_like(part)[None]
    known, scores = np.ones_like(row), np.empty((1, 20), np.float32)
    match_waveforms(row, known, part[None], whole, taper, 0.5, scores[None])
    assert scores[0].argmax() == 13
    assert scores[0].max() == pytest.approx(1.0, abs=1e-5)
    known[0, 40:] = 0.0  # beyond a fault
    match_waveforms(row, known, part[None], whole, taper, 0.5, scores[None])
    assert scores[0].argmax() == 13
    match_waveforms(row, known, part[None], whole, taper, 0.9, scores[None])
    assert (scores[0, 13:] == -1.0).all()
    # several references at once are each what they are alone
    both, alone = np.empty((2, 1, 20), np.float32), np.empty((1, 1, 20), np.float32)
    references = np.stack([part, part[::-1]])
    match_waveforms(row, known, references, whole, taper, 0.5, both)
    for reference, found in zip(references, both, strict=True):
        match_waveforms(row, known, reference[None], whole, taper, 0.5, alone)
        np.testing.assert_array_equal(found, alone[0])
    # also where less is known of one of them than of the other
    known_of = np.stack([whole[0], np.where(np.arange(41) < 20, whole[0], 0.0)]).astype(np.float32)
    match_waveforms(row, known, references, known_of, taper, 0.2, both)
    for n, found in enumerate(both):
        match_waveforms(row, known, references[n : n + 1], known_of[n : n + 1], taper, 0.2, alone)
        np.testing.assert_array_equal(found, alone[0])
    assert (both[1] != -1.0).all()


def test_layers_repeat_at_a_reverse_fault_and_waveforms_end_at_it() -> None:
    n = 60
    times = np.arange(n, dtype=np.float32)
    times[30:] -= 10.0  # the layers 20 to 30 come twice
    times = np.ascontiguousarray(np.broadcast_to(times, (2, 2, n)))
    cuts = np.zeros(times.shape, np.uint8)
    cuts[:, :, 29] = 4
    crossings = np.empty((3, 2, 2))
    cross_levels(times, cuts, np.full((2, 2), 24.25), np.float32(0.0), crossings)
    np.testing.assert_allclose(crossings[:2, 1, 0], [24.25, 34.25])
    assert np.isnan(crossings[2]).all()
    cross_levels(times, cuts, np.full((2, 2), 15.0), np.float32(0.0), crossings)
    np.testing.assert_allclose(crossings[0], 15.0)
    assert np.isnan(crossings[1:]).all()
    for beyond, expected in ((4.0, [-3.0, np.nan, np.nan]), (2.0, [np.nan] * 3)):
        cross_levels(times, cuts, np.full((2, 2), -3.0), np.float32(beyond), crossings)
        np.testing.assert_allclose(crossings[:, 0, 0], expected)
        cross_levels(times, cuts, np.full((2, 2), 52.0), np.float32(beyond), crossings)
        np.testing.assert_allclose(crossings[:, 1, 1], [62.0 if beyond > 3.0 else np.nan, np.nan, np.nan])
    volume = times.copy()
    valid = np.ones(times.shape, bool)
    for read, before, after, n_known in (
        (read_runs, (), (0,), 11),
        (read_runs, (), (2,), 9),
        (read_layers, (times,), (), 11),
    ):
        waves, known = (np.empty((2, 2, 17), np.float32) for _ in range(2))
        read(volume, valid, *before, cuts, np.full((2, 2), 26.5), 8, *after, waves, known)
        assert known[0, 0].tolist() == [1.0] * n_known + [0.0] * (17 - n_known)
        np.testing.assert_allclose(waves[0, 0, :n_known], 18.5 + np.arange(n_known), rtol=1e-6)
    # an end of the cube is no fault
    waves, known = (np.empty((2, 2, 17), np.float32) for _ in range(2))
    read_runs(volume, valid, cuts, np.full((2, 2), 6.0), 8, 2, waves, known)
    assert known[0, 0].tolist() == [0.0] * 2 + [1.0] * 15


def test_traces_grow_between_faults_alone(rng: np.random.Generator) -> None:
    times = np.cumsum(rng.normal(0.3, 1.0, (1, 1, 80)), axis=2).astype(np.float32)
    cuts = np.zeros(times.shape, np.uint8)
    cuts[0, 0, 39] = 4
    halves = [times[:, :, :40].copy(), times[:, :, 40:].copy()]
    make_runs_increasing(times, cuts, 1e-3)
    for half in halves:
        make_increasing(half, 1e-3)
    np.testing.assert_array_equal(times, np.concatenate(halves, axis=2))


def test_the_nearest_increasing_trace(rng: np.random.Generator) -> None:
    from scipy.optimize import isotonic_regression

    row = np.cumsum(rng.normal(0.3, 1.0, 200)).astype(np.float32)
    times = row.reshape(1, 1, -1).copy()
    make_increasing(times, 0.0)
    np.testing.assert_allclose(times[0, 0], isotonic_regression(row).x, atol=1e-4)
    make_increasing(times, 1e-3)
    assert (np.diff(times[0, 0].astype(np.float64)) > 0.9e-3).all()


def test_refusals(folded: SyntheticCube, folded_layers: LayerModel, faults: Any) -> None:
    with pytest.raises(ShapeError, match="Give a cube"):
        s3.layer_time(folded.seismic[0])
    with pytest.raises(ShapeError, match="traced in"):
        s3.layer_time(folded.seismic[:40], faults=faults)
    with pytest.raises(ShapeError, match="live"):
        s3.layer_time(np.zeros((20, 20, 40), np.float32))
    with pytest.raises(ParameterError, match="outside"):
        s3.trace_tracks(folded.seismic, [(500, 2, 3)], layers=folded_layers)
    with pytest.raises(ShapeError, match=r"seeds\[0\]"):
        s3.trace_tracks(folded.seismic, [(1, 2)], layers=folded_layers)
    with pytest.raises(ParameterError, match="peak, trough, zero"):
        s3.trace_tracks(folded.seismic, [(1, 2, 3)], event="top", layers=folded_layers)
    i, j = np.argwhere(~folded.live)[0]
    with pytest.raises(ParameterError, match="without data"):
        s3.trace_tracks(folded.seismic, [(i, j, 30)], layers=folded_layers)


def test_ties_grow_with_the_share_of_noise() -> None:
    settings = LayerTimeSettings(thickness=0.3, noisy=10.0)
    assert thickness_variance([0.0, 0.0, 0.9, 0.9], settings) == pytest.approx(0.09)
    assert thickness_variance([0.02, 0.06], settings) == pytest.approx(0.09 + 0.4**2)


def test_doubtful_matches_count_for_little_and_noise_makes_fewer_of_them_doubtful() -> None:
    settings = LinkSettings(doubtful=0.125)
    variance = np.array([0.09, 0.25, 4.0, np.inf])
    np.testing.assert_allclose(doubt_matches(variance, 0.0, settings), variance * [1.1296, 2.0, 257.0, 1.0])
    np.testing.assert_allclose(doubt_matches(variance, 0.1875, settings), variance * [1.0005, 1.0039, 2.0, 1.0], 1e-3)


def test_shifts_count_less_the_noisier_they_are() -> None:
    ratio = np.array([0.0, 0.1, 0.2, 0.4], np.float32).reshape(1, 2, 2)
    found = ShiftField(0, 1, np.zeros_like(ratio), np.full_like(ratio, 0.01), ratio.copy())
    judged = judge_misfits(found, 0.5, ShiftSettings(noisy=0.2, misfit=0.0))
    np.testing.assert_allclose(judged.misfit, ratio, rtol=1e-6)
    assert are_measured(judged, ShiftSettings(noisy=0.2, misfit=0.0, most=0.01 * 1.03)).all()
    assert not are_measured(judged, ShiftSettings(noisy=0.2, misfit=0.0, most=0.01)).any()
    noisy, doubtful = np.array([1.0, 1.0625, 2.0, 17.0]), 1.0 + ratio.ravel() ** 4
    np.testing.assert_allclose(judged.variance.ravel(), 0.01 * noisy * doubtful, rtol=1e-5)


def test_rounds_of_finer_graphs_go_by_the_noise() -> None:
    settings = LayerTimeSettings(strides=(2, 1), first_cutoffs=(np.inf, 8.0, 3.0, 3.0, 3.0), cutoffs=(30.0, 3.0))
    assert list_rounds(settings, 2, [0.2, 0.2]) == [(1e4, np.inf), (1e4, 8.0), *[(1.0, 3.0)] * 3]
    assert list_rounds(settings, 1, [0.0, 0.0]) == [(1.0, 30.0), (1.0, 3.0)]
    assert list_rounds(settings, 1, [0.02, 0.06, 0.9, 0.9])[0] == pytest.approx((1e4**0.4, 7.5))
    assert list_rounds(settings, 1, [0.25, 0.25]) == [(1e4, 3.0), (1.0, 3.0)]


@pytest.mark.parametrize("noise", [0.001, 0.13])
def test_shifts_that_leak_past_a_fault_do_not_join_its_sides(noise: float) -> None:
    """Flat layers, a throw of nine samples, and every ninth line on which the fault is not cut."""
    n, m, throw, spread = 32, 24, 9.0, 1.0 if noise > 0.1 else 0.1
    cuts = np.zeros((n, n, 4 * m), np.uint8)
    cuts[:, 15] = 2
    cuts[5::9, 15] = 0
    none = np.zeros((n, n, m), np.float32)
    fields = [
        ShiftField(axis, length, none, np.full_like(none, noise), none + np.float32(0.5), noise)
        for length in (1, 2, 4)
        for axis in (0, 1)
    ]
    shape = (n, 4 * m)
    throws = np.full(shape, throw)
    grid = SurfaceGrid(np.array([0.0, 1.0]), (1 - n, 0), np.full(shape, 15.5), np.ones(shape, bool), throws)
    links = [(grid, throws, np.full(shape, spread**2))]
    values, rejected = solve_graph(LayerGraph(fields, cuts, np.zeros((n, n, m), np.uint8), links, LayerTimeSettings()))
    found = np.median(values[:, :12, 8:16]) - np.median(values[:, 20:, 8:16])
    assert found == pytest.approx(throw, abs=0.3)
    assert 0.0 < rejected < 0.03
