from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from seismo3d.seismic.slip_fields import smooth_field
from seismo3d.seismic.throw_bells import carry_on, fit_bell, smooth_about_bell


def bell(*, largest=30.0, middle=(26.0, 34.0), widths=(30.0, 24.0), shape=(60, 64)):
    r, k = np.indices(shape, dtype=np.float64)
    away = ((r - middle[0]) / widths[0]) ** 2 + ((k - middle[1]) / widths[1]) ** 2
    return (largest * np.exp(-0.5 * away)).astype(np.float32)


def seen(shape=(60, 64), *, first=28):
    """Weights of one below the first samples, where the other side is out of view."""
    weight = np.ones(shape, np.float32)
    weight[:, :first] = 0.0
    return weight


@pytest.mark.parametrize("largest", [30.0, -30.0])
def test_a_bell_is_found_from_a_part_of_it(largest):
    truth = bell(largest=largest)
    found = fit_bell(truth, seen())
    np.testing.assert_allclose(found, truth, atol=0.1)


def test_a_few_wrong_throws_do_not_bend_the_bell(rng):
    truth = bell()
    wrong = np.where(rng.random(truth.shape) < 0.1, truth + rng.uniform(5.0, 15.0, truth.shape), truth)
    # smaller throws than half a sample have no logarithm that tells anything
    found = fit_bell(wrong.astype(np.float32), seen() * (truth > 1.0))
    assert np.abs(found - truth)[truth > 1.0].max() < 0.5


def test_a_throw_dies_away_where_a_plate_would_go_on_straight():
    truth, weight = bell(), seen()
    plate = smooth_field(truth, weight, stiffness=30.0)
    carried = carry_on(plate, weight)
    beyond = weight == 0.0
    assert np.abs(plate - truth)[beyond].max() > 6.0
    assert np.abs(carried - truth)[beyond].max() < np.abs(plate - truth)[beyond].max() / 3.0
    np.testing.assert_array_equal(carried[~beyond], plate[~beyond])


def test_a_throw_that_grows_evenly_goes_on_nearly_so():
    r, k = np.indices((60, 64), dtype=np.float64)
    truth = (20.0 + 0.1 * r - 0.08 * k).astype(np.float32)
    carried = carry_on(truth, seen())
    assert np.abs(carried - truth).max() < 0.7


def test_what_the_bell_misses_fades_with_the_distance_from_where_it_is_known():
    truth, weight = bell(), seen()
    r, k = np.indices(truth.shape)
    bump = (1.5 * np.exp(-0.5 * ((r - 30.0) / 6.0) ** 2 - 0.5 * ((k - 30.0) / 2.0) ** 2)).astype(np.float32)
    over = (carry_on(truth + bump, weight) - fit_bell(truth + bump, weight))[30]
    assert over[26] > over[18] > over[8] > over[0] > 0.0
    np.testing.assert_allclose(over[0] / over[20], np.exp(-2.0), rtol=0.05)


def test_bells_never_bend_upwards():
    k = np.indices((60, 64), dtype=np.float64)[1]
    valley = (8.0 + 0.004 * (k - 44.0) ** 2).astype(np.float32)
    found = fit_bell(valley, seen())
    assert np.diff(np.log(found), 2, axis=1).max() <= 1e-9


@pytest.mark.parametrize("throw", [np.zeros((60, 64)), np.where(np.arange(64) < 32, 10.0, -10.0) * np.ones((60, 1))])
def test_without_one_sign_there_is_no_bell(throw):
    throw = throw.astype(np.float32)
    weight = np.ones(throw.shape, np.float32)
    assert fit_bell(throw, weight) is None
    np.testing.assert_array_equal(carry_on(throw, weight), throw)


@pytest.mark.parametrize("shape", [(1, 30), (2, 2), (5, 9)])
def test_too_few_places_tell_no_bell(shape):
    throw = np.full(shape, 7.0, np.float32)
    assert fit_bell(throw, np.ones(shape, np.float32)) is None
    np.testing.assert_array_equal(carry_on(throw, np.ones(shape, np.float32)), throw)


def test_a_section_has_a_bell_too():
    truth = bell(shape=(1, 200), middle=(0.0, 90.0), widths=(1.0, 60.0))
    weight = np.ones_like(truth)
    weight[:, 120:] = 0.0
    np.testing.assert_allclose(fit_bell(truth, weight), truth, atol=0.1)


def test_the_top_of_a_bell_is_not_flattened(rng):
    truth = bell(largest=30.0, widths=(16.0, 16.0))
    weight = np.where(rng.random(truth.shape) < 0.3, truth > 2.0, 0.0).astype(np.float32)
    smooth = partial(smooth_field, weights=weight, stiffness=300.0)
    top = truth > 20.0
    assert np.abs(smooth(truth) - truth)[top].max() > 1.5
    assert np.abs(smooth_about_bell(truth, weight, smooth) - truth)[top].max() < 0.4


def test_without_a_bell_throws_are_smoothed_by_themselves():
    throw = np.where(np.arange(64) < 32, 10.0, -10.0).astype(np.float32) * np.ones((60, 1), np.float32)
    weight = np.ones_like(throw)
    smooth = partial(smooth_field, weights=weight, stiffness=30.0)
    np.testing.assert_array_equal(smooth_about_bell(throw, weight, smooth), smooth(throw))
