from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic._kernels_trends import search_trends, throws_of_trend, trend_cost
from seismo3d.seismic.throw_trends import local_trend, rank_trends


def costs_of(throws, *, n_shifts=81, noise=None):
    """Costs that are least, 0.1, at the given throws; 1 more than two samples off."""
    away = np.abs(np.arange(n_shifts) - n_shifts // 2 - throws[..., None])
    costs = np.minimum(0.1 + 0.45 * away, 1.0)
    return (costs if noise is None else costs + 0.2 * noise.random(costs.shape)).astype(np.float32)


def surface(shape, constant, along, down, bend):
    r, k = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return constant + along * r + down * k + bend * (r * r + k * k)


@pytest.mark.parametrize(
    "terms", [(20.0, 0.0, 0.0, 0.0), (-12.0, 5.0, -3.0, 0.0), (25.0, 0.0, 4.0, -10.0), (0.0, 0.0, 0.0, 0.0)]
)
def test_trend_of_least_cost_is_found(rng, terms):
    truth = surface((40, 44), *terms)
    found = rank_trends(costs_of(truth, noise=rng)[::2, ::2], np.ones(truth.shape, bool), unmatched=0.6)[0]
    assert np.abs(found - truth).mean() < 1.6
    assert np.abs(found - truth).max() < 4.0


def test_a_third_of_wrong_places_does_not_mislead_the_trend(rng):
    truth = surface((40, 44), 18.0, 4.0, -6.0, 0.0)
    wrong = truth.copy()
    wrong[:13] = rng.uniform(-30, 30, (13, 44))
    found = rank_trends(costs_of(wrong)[::2, ::2], np.ones(truth.shape, bool), unmatched=0.6)[0]
    assert np.abs(found - truth)[13:].mean() < 1.0


def test_places_off_the_surface_do_not_count():
    truth = surface((40, 44), 10.0, 0.0, 0.0, 0.0)
    mixed = np.where(np.arange(40)[:, None] < 28, -15.0, truth)
    inside = np.broadcast_to(np.arange(40)[:, None] >= 28, truth.shape)
    found = rank_trends(costs_of(mixed)[::2, ::2], inside, unmatched=0.6)[0]
    np.testing.assert_allclose(found[28:], 10.0, atol=1.2)


@pytest.mark.parametrize("shape", [(1, 30), (2, 2), (30, 1)])
def test_trend_of_a_narrow_surface(shape):
    throws = np.full(shape, 6.0)
    found = rank_trends(costs_of(throws)[::2, ::2], np.ones(shape, bool), unmatched=0.6)[0]
    np.testing.assert_allclose(found, 6.0, atol=1.5)


def repeated_costs(*, true, others, seen):
    """Costs of layers that repeat every ten samples: those at 30 match by `true` where seen, others by chance."""
    costs = np.full((40, 44, 81), others + 0.03, np.float32)
    costs[:, :, 0::10] = others
    costs[:, :, 70] = true
    costs[seen:, :, 60:] = 0.4
    return costs


def test_a_large_throw_that_leads_out_of_view_wins_over_chance():
    costs = repeated_costs(true=0.2, others=0.3, seen=14)
    # over the whole surface chance costs less than what is right in a third of it and unknown elsewhere
    assert 0.3 < (14 * 0.2 + 26 * 0.4) / 40
    found = rank_trends(costs[::2, ::2], np.ones((40, 44), bool), unmatched=0.4)[0]
    np.testing.assert_allclose(found, 30.0, atol=1.2)


@pytest.mark.parametrize(("about", "expected"), [(None, 30.0), (28.0, 30.0), (-12.0, -10.0)])
def test_of_throws_that_match_alike_the_one_expected_is_taken(about, expected):
    costs = repeated_costs(true=0.28, others=0.3, seen=40)
    found = rank_trends(costs[::2, ::2], np.ones((40, 44), bool), unmatched=0.4, about=about)[0]
    np.testing.assert_allclose(found, expected, atol=1.2)


def test_a_throw_that_matches_clearly_is_taken_whatever_was_expected():
    costs = repeated_costs(true=0.1, others=0.3, seen=40)
    found = rank_trends(costs[::2, ::2], np.ones((40, 44), bool), unmatched=0.4, about=-10.0)[0]
    np.testing.assert_allclose(found, 30.0, atol=1.2)


@pytest.mark.parametrize(("true", "expected"), [(0.299, -10.0), (0.2, 30.0)])
def test_a_throw_larger_than_usual_must_match_clearly_better(true, expected):
    costs = repeated_costs(true=true, others=0.3, seen=40)
    costs[:, :, 30] = 0.2995
    found = rank_trends(costs[::2, ::2], np.ones((40, 44), bool), unmatched=0.4, usual=20)
    np.testing.assert_allclose(found[0], expected, atol=1.2)
    # those that are none larger than usual stay alone where none of the others is right
    assert (max(np.abs(trend).max() for trend in found) > 20.0) == (expected == 30.0)


def test_trend_cost_is_the_mean_over_places():
    costs = np.arange(10, dtype=np.float32).reshape(2, 5)
    u, v = np.array([-1.0, 1.0]), np.array([0.0, 1.0])
    # throws: 0 and 1
    terms = np.array([0.5, 0.5, 0.0, 0, 0, 0])
    assert trend_cost(costs, u, v, terms, False, 9.0) == pytest.approx((costs[0, 2] + costs[1, 3]) / 2, abs=1e-3)
    assert trend_cost(costs, u, v, np.array([7.0, 0, 0, 0, 0, 0]), False, 9.0) == 9.0


@pytest.mark.parametrize("bell", [False, True])
def test_trend_cost_of_every_third_place_is_that_of_these_alone(rng, bell):
    costs, (u, v) = rng.random((50, 21)), rng.uniform(-1, 1, (2, 50))
    terms = np.array([6.0, 2.0, -1.0, -3.0, 0.5, -2.0])
    alone = trend_cost(costs[::3].copy(), u[::3].copy(), v[::3].copy(), terms, bell, 9.0)
    assert trend_cost(costs, u, v, terms, bell, 9.0, 3) == pytest.approx(alone)


@pytest.mark.parametrize("first", [24.0, -24.0])
def test_a_bell_has_the_slopes_and_bends_of_its_quadratic_in_the_middle(first):
    terms = np.array([first, 3.0, -5.0, -8.0, 2.0, -12.0]) * [1, 1, 1, np.sign(first), 1, np.sign(first)]
    at = 1e-3 * np.array([[0, 1, -1, 0, 0, 1], [0, 0, 0, 1, -1, 1]])
    straight, bell = np.empty(6), np.empty(6)
    throws_of_trend(*at, terms, False, straight)
    throws_of_trend(*at, terms, True, bell)
    np.testing.assert_allclose(bell[1:3].sum() - 2 * first, straight[1:3].sum() - 2 * first + 9e-6 / first, atol=1e-9)
    np.testing.assert_allclose(bell, straight, atol=2e-6)
    # and dies away where the quadratic changes its sign
    far = np.array([[2.5], [2.5]])
    throws_of_trend(*far, terms, False, straight[:1])
    throws_of_trend(*far, terms, True, bell[:1])
    assert straight[0] * first < 0 < bell[0] * first < 0.1 * first**2


def test_a_bell_without_throw_is_level():
    throws = np.empty(1)
    throws_of_trend(np.ones(1), np.ones(1), np.array([0.0, 5.0, 5.0, 0, 0, 0]), True, throws)
    assert throws[0] == 0.0


def bell_of(shape, largest, width):
    r, k = np.meshgrid(*(np.linspace(-1, 1, n) for n in shape), indexing="ij")
    return largest * np.exp(-((r - 0.1) ** 2 + (k + 0.1) ** 2) / width**2)


@pytest.mark.parametrize("largest", [32.0, -32.0])
def test_a_throw_that_dies_away_on_all_sides_is_found(rng, largest):
    truth = bell_of((48, 44), largest, 0.8)
    costs = costs_of(truth, noise=rng)
    costs[rng.random(truth.shape) < 0.3] = 0.7
    found = rank_trends(costs[::2, ::2], np.ones(truth.shape, bool), unmatched=0.9)[0]
    terms = np.stack([surface(truth.shape, *row) for row in np.eye(4)], axis=-1).reshape(-1, 4)
    quadratic = (terms @ np.linalg.lstsq(terms, truth.ravel(), rcond=None)[0]).reshape(truth.shape)
    assert np.abs(quadratic - truth).mean() > 2.2
    # terms are told to within steps of 1.5 samples
    assert np.abs(found - truth).mean() < 1.15


def test_descent_never_ends_above_its_start(rng):
    costs = rng.random((50, 21)).astype(np.float32)
    u, v = rng.uniform(-1, 1, (2, 50))
    starts = np.array([-5.0, 0.0, 5.0])
    terms, scores = np.zeros((3, 6)), np.zeros(3)
    for bell in (False, True):
        search_trends(costs, u, v, starts, np.zeros(1), np.zeros(1), bell, 1.0, 40, terms, scores)
        for start, term, score in zip(starts, terms, scores, strict=True):
            assert score <= trend_cost(costs, u, v, np.array([start, 0, 0, 0, 0, 0]), bell, 1.0)
            assert score == pytest.approx(trend_cost(costs, u, v, term, bell, 1.0))
        assert not bell or (terms[:, [3, 5]] * terms[:, :1] <= 0.0).all()


def test_plane_is_carried_on_beyond_what_is_known(rng):
    r, k = np.indices((40, 48))
    plane = (12.0 + 0.1 * r - 0.15 * k).astype(np.float32)
    known = (k > 12) & (rng.random(plane.shape) > 0.3)
    found = local_trend(plane, known, width=12.0)
    assert np.abs(found - plane)[known].max() < 0.6
    assert np.abs(found - plane)[:, :6].max() < 1.5


def test_carried_on_values_stay_in_bounds():
    k = np.indices((40, 48))[1]
    steep = (2.0 * k).astype(np.float32)
    found = local_trend(steep, k < 10, width=12.0)
    assert found.max() <= 1.25 * 18 + 1.01


def test_nothing_known_gives_zero():
    assert (local_trend(np.ones((8, 8), np.float32), np.zeros((8, 8), bool), width=6.0) == 0).all()


def test_one_known_place_is_everywhere():
    values, known = np.zeros((20, 20), np.float32), np.zeros((20, 20), bool)
    values[3, 4], known[3, 4] = 7.0, True
    np.testing.assert_allclose(local_trend(values, known, width=6.0), 7.0, atol=1e-3)
