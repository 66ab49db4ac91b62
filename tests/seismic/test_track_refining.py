"""A track is as stiff as its matches scatter."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from laid_out_layers import SHAPE as LAID_OUT
from laid_out_layers import lay_out
from scipy.ndimage import gaussian_filter

from seismo3d.seismic import track_refining
from seismo3d.seismic.track_fitting import fit_track
from seismo3d.seismic.track_refining import TrackSettings, _Found, _lay_matched

SHAPE = (50, 60)


def bent_layer() -> np.ndarray:
    rows, columns = np.indices(SHAPE)
    return 40.0 + 0.3 * rows + 0.004 * (columns - 30.0) ** 2


def smoothed(depth: np.ndarray, **settings: float) -> np.ndarray:
    layers: Any = SimpleNamespace(
        cuts=np.zeros((*SHAPE, 80), np.uint8), times=np.zeros((*SHAPE, 80), np.float32), live=np.ones(SHAPE, bool)
    )
    every = np.ones(SHAPE, bool)
    found = _Found(depth, np.ones(SHAPE, np.float32), every, np.ones(SHAPE), 0.0, every)
    return _lay_matched(layers, found, np.zeros(SHAPE, np.int64), TrackSettings(**settings))[0]


def test_noise_is_smoothed_out(rng: np.random.Generator) -> None:
    """Waveforms are averaged over neighbours before they are matched, so that what they are off by is alike, too."""
    noise = gaussian_filter(rng.normal(0.0, 1.0, SHAPE), 1.2)
    noisy = bent_layer() + 0.6 * noise / noise.std()
    off = {bent: np.std(smoothed(noisy, bent=bent) - bent_layer()) for bent in (0.016, 1e3)}
    assert off[0.016] < 0.6 * off[1e3]


def test_what_noise_leaves_alone_keeps_its_shape() -> None:
    np.testing.assert_allclose(smoothed(bent_layer())[2:-2, 2:-2], bent_layer()[2:-2, 2:-2], atol=0.02)


def test_in_noise_traces_are_matched_again_from_the_surface_through_the_first_matches(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first matches reach no farther than two samples; layer time is off by more."""
    every = np.arange(LAID_OUT[1])
    shift, off = 3.0 * np.sin(every / 8.0), 2.5 * np.sin(every / 5.0)
    times = np.arange(LAID_OUT[2]) - (shift + off)[:, None]
    layers = lay_out(rng, shift, times, cut=False, noise=1.0)
    seed = np.array([[20.0, 24.0, 60.0 + shift[24]]])

    def scatter() -> float:
        miss = fit_track(layers, seed, TrackSettings())[0] - 60.0 - shift
        return float(np.nanstd(miss - np.nanmedian(miss)))

    twice = scatter()
    lay = track_refining._lay_matched
    monkeypatch.setattr(track_refining, "_lay_matched", lambda *a: (lay(*a)[0], TrackSettings().stiffness))
    assert twice < 0.25 < scatter()


@pytest.mark.parametrize(("columns", "alone"), [(slice(20, 24), False), (slice(20, 22), False), (slice(10, 30), True)])
def test_the_waveform_is_that_of_the_seeds_where_enough_of_it_is_seen(
    rng: np.random.Generator, columns: slice, alone: bool
) -> None:
    """Between close faults it is that of all parts that were surely placed, too."""
    layers = lay_out(rng, np.zeros(LAID_OUT[1]), np.arange(LAID_OUT[2], dtype=np.float64), cut=False)
    layers.cuts[:, 20:24, 66] |= 4
    parts = np.zeros(LAID_OUT[:2], np.int64)
    parts[:, columns], parts[:, 40:], parts[:, :2] = 1, 2, -1
    scores = np.array([0.95, 1.0, 0.7], np.float32)
    depth = np.where(parts >= 0, 60.0, np.nan)
    of_seeds = parts == 1
    chosen = track_refining._choose_reference(layers, depth, parts, of_seeds, scores, TrackSettings())
    np.testing.assert_array_equal(chosen, of_seeds if alone else of_seeds | (parts == 0))
    nothing = np.zeros(of_seeds.shape, bool)
    everywhere = track_refining._choose_reference(layers, depth, parts, nothing, scores, TrackSettings())
    np.testing.assert_array_equal(everywhere, parts >= 0)
