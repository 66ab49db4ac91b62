"""Tracks on peaks, troughs and zero crossings of a cube whose layers lie one above the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import seismo3d as s3
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.seismic._kernels_tracks import read_known
from seismo3d.seismic.layer_time import LayerModel
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.track_events import _nearest, snap_to_events
from seismo3d.synthetic import fault_cube

PERIOD, SHAPE = 16.0, (12, 14, 96)
PEAK, TROUGH, RISE, FALL = 32.0, 40.0, 28.0, 36.0


def wave(samples: np.ndarray) -> np.ndarray:
    return np.cos(2.0 * np.pi * samples / PERIOD) * np.exp(-(((samples - 48.0) / 40.0) ** 2))


@pytest.fixture(scope="module")
def level() -> tuple[np.ndarray, LayerModel]:
    """Layers that dip by a tenth of a sample from crossline to crossline."""
    deeper = 0.1 * np.arange(SHAPE[1])[:, None]
    rows = wave(np.arange(SHAPE[2]) - deeper).astype(np.float32)
    volume = np.broadcast_to(rows, SHAPE).copy()
    times = np.broadcast_to((np.arange(SHAPE[2]) - deeper).astype(np.float32), SHAPE).copy()
    whole, cuts, closure = (
        np.ones(SHAPE, bool),
        np.zeros(SHAPE, np.uint8),
        LoopClosure(0.0, 0.0, 0, 1, np.zeros((12, 14))),
    )
    model = LayerModel(times, cuts, volume, whole, whole[..., 0], "samples", 0.0, closure)
    return volume, model


@pytest.mark.parametrize(("seed", "event", "found"), [
    (30.0, "peak", PEAK), (37.0, "peak", PEAK), (41.5, "trough", TROUGH), (33.0, "trough", TROUGH),
    (30.0, "zero", RISE), (34.5, "zero", FALL), (37.5, "zero", FALL),
])  # fmt: skip
def test_all_of_a_track_is_on_the_event_next_to_its_seed(
    level: tuple[np.ndarray, LayerModel], seed: float, event: str, found: float
) -> None:
    volume, layers = level
    (track,) = s3.trace_tracks(volume, [(5, 0, seed)], event=event, layers=layers)
    known = np.isfinite(track.depth)
    assert known.mean() > 0.95
    expected = np.broadcast_to(found + 0.1 * np.arange(SHAPE[1]), SHAPE[:2])
    np.testing.assert_allclose(track.depth[known], expected[known], atol=0.35)


def interfering(samples: np.ndarray) -> np.ndarray:
    """Wavelets of some eight samples a period, so close that they interfere."""
    total = np.zeros(samples.shape)
    for place, strength in ((40.0, 1.0), (44.3, -0.7), (47.1, 0.9), (52.6, 0.8), (55.0, -1.1)):
        x = (np.pi * (samples - place) / 8.0) ** 2
        total += strength * (1.0 - 2.0 * x) * np.exp(-x)
    return total


@pytest.mark.parametrize(("event", "near"), [("peak", 40.0), ("peak", 48.0), ("trough", 44.0), ("zero", 42.0)])
def test_events_are_those_of_the_trace_between_its_samples(
    level: tuple[np.ndarray, LayerModel], event: str, near: float
) -> None:
    deeper = 0.1 * np.arange(SHAPE[1])[:, None]
    rows = interfering(np.arange(SHAPE[2]) - deeper).astype(np.float32)
    volume = np.broadcast_to(rows, SHAPE).copy()
    fine = np.arange(near - 3.0, near + 3.0, 1e-3)
    values = interfering(fine)
    place = float(fine[{"peak": values.argmax(), "trough": values.argmin(), "zero": np.abs(values).argmin()}[event]])
    start = np.broadcast_to(near + deeper.T, SHAPE[:2]).copy()
    slope = float(np.sign(interfering(np.array([place + 0.1]))[0])) if event == "zero" else 0.0
    found = snap_to_events(volume, level[1], start, event, slope)
    np.testing.assert_allclose(found, np.broadcast_to(place + deeper.T, SHAPE[:2]), atol=0.02)


@pytest.mark.parametrize("event", ["peak", "trough", "zero"])
def test_events_lie_about_the_level_of_the_amplitudes(level: tuple[np.ndarray, LayerModel], event: str) -> None:
    """Of unsigned bytes no sample is below zero, and troughs lie below 128."""
    volume, layers = level
    (expected,) = s3.trace_tracks(volume, [(5, 0, 37.0)], event=event, layers=layers)
    raised = replace(layers, level=128.0)
    (found,) = s3.trace_tracks(50.0 * volume + 128.0, [(5, 0, 37.0)], event=event, layers=raised)
    np.testing.assert_allclose(found.depth, expected.depth, atol=1e-3)


def test_unsigned_bytes_have_troughs() -> None:
    cube = fault_cube("clean", shape=(24, 24, 64), seed=3, population=None)
    amplitudes = cube.seismic / np.abs(cube.seismic).max()
    seeds = [(12, 12, 30.0)]
    (expected,) = s3.trace_tracks(amplitudes, seeds, event="trough")
    (found,) = s3.trace_tracks(np.rint(127.0 * amplitudes + 128.0).astype(np.uint8), seeds, event="trough")
    both = np.isfinite(found.depth) & np.isfinite(expected.depth)
    assert both.mean() > 0.9
    assert np.abs(found.depth - expected.depth)[both].max() < 0.5


@pytest.mark.parametrize(("kind", "middle"), [(np.uint8, 128), (np.uint16, 32768)])
def test_unsigned_numbers_cross_zero_in_their_middle(kind: type, middle: int) -> None:
    cube = fault_cube("clean", shape=(24, 24, 64), seed=3, population=None)
    # more of it is low than high: the median lies below the middle
    amplitudes = cube.seismic / np.abs(cube.seismic).max()
    amplitudes = np.rint((middle - 1) * (amplitudes**3 + 0.5 * amplitudes - 0.02) / 1.6)
    seeds = [(12, 12, 30.0)]
    (expected,) = s3.trace_tracks(amplitudes.astype(np.float32), seeds, event="zero")
    (found,) = s3.trace_tracks((amplitudes + middle).astype(kind), seeds, event="zero")
    both = np.isfinite(found.depth) & np.isfinite(expected.depth)
    assert both.mean() > 0.9
    assert np.abs(found.depth - expected.depth)[both].max() < 0.02


@pytest.mark.parametrize("bottom", [False, True])
def test_a_track_ends_where_it_leaves_the_cube(level: tuple[np.ndarray, LayerModel], bottom: bool) -> None:
    volume, layers = level
    last = SHAPE[2] - 1
    seed = (5, 2, last - 0.2) if bottom else (5, 11, 0.4)
    expected = seed[2] + 0.1 * (np.arange(SHAPE[1]) - seed[1])
    (track,) = s3.trace_tracks(volume, [seed], layers=layers)
    outside = (expected < -0.4) | (expected > last + 0.4)
    assert outside.any()
    assert np.isnan(track.depth[:, outside]).all()
    assert np.isnan(track.confidence[:, outside]).all()
    known = np.isfinite(track.depth)
    assert known[seed[:2]]
    assert track.depth[known].min() >= 0.0
    assert track.depth[known].max() <= last


def test_traces_without_the_event_are_left_out(level: tuple[np.ndarray, LayerModel]) -> None:
    volume, layers = level
    silent = volume.copy()
    silent[8:, :, 26:44] = -0.5  # no peak there
    (track,) = s3.trace_tracks(silent, [(3, 3, 32.3)], event="peak", layers=layers)
    assert np.isnan(track.depth[8:]).all()
    assert np.isnan(track.confidence[8:]).all()
    assert np.isfinite(track.depth[:8]).all()


def with_data_from(first: int, last: int, trough: float) -> tuple[np.ndarray, LayerModel]:
    """A cosine of 20 samples a period, and its model, in level layers between two samples."""
    k = np.arange(64.0)
    valid = np.zeros((8, 8, 64), bool)
    valid[..., first : last + 1] = True
    volume = np.where(valid, -np.cos(2.0 * np.pi * (k - trough) / 20.0), 0.0).astype(np.float32)
    times, cuts = np.broadcast_to(k.astype(np.float32), valid.shape).copy(), np.zeros(valid.shape, np.uint8)
    closure = LoopClosure(0.0, 0.0, 0, 1, np.zeros((8, 8)))
    return volume, LayerModel(times, cuts, volume, valid, valid.any(axis=2), "samples", 0.0, closure)


@pytest.mark.parametrize(("first", "last"), [(0, 63), (12, 50)], ids=["cube", "mute"])
@pytest.mark.parametrize(("event", "trough", "seed", "found"), [
    ("peak", -13.0, 3.0, 17.0), ("trough", -3.0, 2.5, 17.0), ("zero", -6.0, 1.5, 9.0), ("peak", 5.0, 1.0, 15.0),
    ("trough", 1.6, 3.0, 1.6), ("peak", -7.5, 3.0, 2.5), ("zero", -3.0, 3.0, 2.0),
])  # fmt: skip
def test_the_ends_of_the_data_are_no_events(
    first: int, last: int, event: str, trough: float, seed: float, found: float
) -> None:
    for down in (False, True):
        place, at, expected = (last - x if down else first + x for x in (trough, seed, found))
        volume, layers = with_data_from(first, last, place)
        (track,) = s3.trace_tracks(volume, [(4, 4, at)], event=event, layers=layers)
        # so near the end as much as a third of a sample: half of the sinc's taps are missing
        np.testing.assert_allclose(track.depth, expected, atol=0.4)


@pytest.mark.parametrize("event", ["peak", "trough", "zero"])
def test_traces_whose_event_lies_beyond_the_data_are_left_out(level: tuple[np.ndarray, LayerModel], event: str) -> None:
    volume, layers = level
    place = {"peak": PEAK, "trough": TROUGH, "zero": RISE}[event] + 0.1 * np.arange(SHAPE[1])
    valid = layers.valid.copy()
    valid[6:, :, : int(place[0]) + 2] = False
    muted = np.where(valid, volume, np.float32(0.0))
    known = replace(layers, valid=valid, volume=muted)
    depth = np.broadcast_to(place, SHAPE[:2]).copy()
    slope = 1.0 if event == "zero" else 0.0
    found = snap_to_events(muted, known, depth + 0.3, event, slope)
    np.testing.assert_allclose(found[:6], depth[:6], atol=0.4)
    assert np.isnan(found[6:]).all()


def test_waveforms_are_those_of_the_data_alone() -> None:
    rng = np.random.default_rng(3)
    volume = rng.normal(size=(1, 1, 20)).astype(np.float32)
    valid = np.ones((1, 1, 20), bool)
    valid[..., [0, 1, 2, 13]] = False
    places = np.arange(-2.0, 22.0, 0.25)
    waves = np.empty((len(places), 1), np.float32)
    for n, place in enumerate(places):
        read_known(volume, valid, np.full((1, 1), place), 0, waves[None, None, n, :])
    expected = np.full(len(places), np.nan)
    for first, last in ((3, 12), (14, 19)):
        row = volume[0, 0, first : last + 1].astype(float)
        # a run goes on in a straight line beyond its ends
        row = np.concatenate([[2 * row[0] - row[1]], row, [2 * row[-1] - row[-2]]])
        for n in np.flatnonzero((places >= first) & (places <= last)):
            b = min(int(places[n]), last - 1)
            f = places[n] - b
            y = row[b - first : b - first + 4]
            slope = 0.5 * (y[2:] - y[:2])
            expected[n] = CubicHermiteSpline([0.0, 1.0], y[1:3], slope)(f)
    np.testing.assert_allclose(waves[:, 0], expected, atol=1e-5)


def test_seeds_with_no_event_but_the_end_of_the_data_are_refused() -> None:
    volume, layers = with_data_from(0, 63, 10.0)
    layers.valid[..., 6:] = False
    with pytest.raises(ParameterError, match=r"seeds\[0\] \(4, 4, 2\) has no peak near it"):
        s3.trace_tracks(volume, [(4, 4, 2)], event="peak", layers=layers)


def test_seeds_in_a_mute_are_refused(level: tuple[np.ndarray, LayerModel]) -> None:
    volume, layers = level
    valid = layers.valid.copy()
    valid[..., :40] = False
    muted = replace(layers, valid=valid)
    with pytest.raises(ParameterError, match=r"seeds\[1\] \(5, 3, 20\) lies where its trace is muted or has a gap"):
        s3.trace_tracks(volume, [(5, 3, 60.0), (5, 3, 20.0)], layers=muted)


def test_seeds_without_an_event_are_refused(level: tuple[np.ndarray, LayerModel]) -> None:
    volume, layers = level
    with pytest.raises(ParameterError, match=r"seeds\[0\] \(3, 3, 32\) has no peak near it"):
        s3.trace_tracks(-np.abs(volume) - 1.0, [(3, 3, 32)], event="peak", layers=layers)


@pytest.mark.parametrize(("event", "rest"), [("peak", 0.0), ("trough", 8.0), ("zero", 4.0)])
def test_horizons_are_found_on_the_event(level: tuple[np.ndarray, LayerModel], event: str, rest: float) -> None:
    volume, layers = level
    tracks = s3.find_horizons(volume, 3, event=event, layers=layers)
    assert len(tracks) == 3
    for track in tracks:
        off = (track.depth - 0.1 * np.arange(SHAPE[1]) - rest) % (PERIOD / 2.0 if event == "zero" else PERIOD)
        off = np.minimum(off, (PERIOD / 2.0 if event == "zero" else PERIOD) - off)
        assert np.nanmax(off) < 0.5


def test_two_seeds_of_one_track_on_one_trace_are_refused(level: tuple[np.ndarray, LayerModel]) -> None:
    volume, layers = level
    with pytest.raises(ParameterError, match=r"seeds\[1\] has \(4, 4, 30\) and \(4, 4, 50\) on one trace"):
        s3.trace_tracks(volume, [(4, 4, 30), [(2, 2, 31), (4, 4, 50), (4, 4, 30)]], layers=layers)
    s3.trace_tracks(volume, [[(4, 4, 30), (4, 4, 30.5)]], layers=layers)


def test_bad_seeds_are_refused_before_any_work() -> None:
    cube = np.zeros((8, 8, 16), np.float32)  # layer time would refuse it
    with pytest.raises(ParameterError, match="lies outside the cube"):
        s3.trace_tracks(cube, [(1, 2, 3), (1, 2, 300)])
    with pytest.raises(ShapeError, match="seeds is 5; expected a list, one entry a track"):
        s3.trace_tracks(cube, 5)
    with pytest.raises(ShapeError, match=r"seeds\[0\] is 'a'"):
        s3.trace_tracks(cube, ["a"])
    with pytest.raises(ParameterError, match="event is 'max'"):
        s3.trace_tracks(cube, [(1, 2, 3)], event="max")


def test_the_nearest_event_of_a_waveform() -> None:
    samples = np.arange(-9, 10, dtype=np.float64)
    waves = np.stack([np.cos((samples - 1.25) / 3.0), np.sin((samples + 0.5) / 3.0), np.ones(19)]).astype(np.float32)
    np.testing.assert_allclose(_nearest(waves, "peak", 0.0)[0], [1.25, 1.5 * np.pi - 0.5, np.nan], atol=0.05)
    place, slope = _nearest(waves, "zero", 0.0)
    np.testing.assert_allclose(place, [1.25 - 1.5 * np.pi, -0.5, np.nan], atol=0.05)
    assert slope[:2].tolist() == [1.0, 1.0]
    np.testing.assert_allclose(_nearest(waves, "zero", -1.0)[0][0], 1.25 + 1.5 * np.pi, atol=0.05)
