from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from seismo3d.seismic._kernels_changeovers import fit_most, settle_points
from seismo3d.seismic.changeovers import part_changeovers


def tell_owners(surfaces, most=10**9):
    """To which surface each point of some belongs then."""
    ends = np.cumsum([0, *map(len, surfaces)])
    members = [np.arange(*pair) for pair in pairwise(ends)]
    positions = np.concatenate([*surfaces, np.empty((0, 3))]).astype(np.float32)
    owner = np.full(len(positions), -1)
    for number, own in enumerate(part_changeovers(positions, members, most=most)):
        assert (np.diff(own) > 0).all()
        assert (owner[own] == -1).all()
        owner[own] = number
    assert (owner >= 0).all()
    return [owner[slice(*pair)] for pair in pairwise(ends)]


def surface(strike_deg, cotangent=0.5, *, bend=0.0, middle=(64.0, 64.0), size=96.0, step=2.0):
    """Points of a surface: its place along the strike and down, and (inline, crossline, sample)."""
    along, down = np.meshgrid(np.arange(-size / 2, size / 2, 1.0), np.arange(-size / 2, size / 2, step), indexing="ij")
    along, down = along.ravel(), down.ravel()
    turn = np.radians(strike_deg)
    across = cotangent * down + bend * along**2
    return along, np.column_stack([
        middle[0] + along * np.cos(turn) - across * np.sin(turn),
        middle[1] + along * np.sin(turn) + across * np.cos(turn),
        64.0 + down,
    ])  # fmt: skip


def crossing(angle_deg=25.0, *, rng=None, **settings):
    """Two surfaces that cross at an angle, and on which side of the line where they meet each point lies."""
    sides, both = [], []
    for turn in (-0.5, 0.5):
        along, points = surface(turn * angle_deg, **settings)
        if rng is not None:
            points = points + rng.normal(0.0, 0.3, points.shape) * [1.0, 1.0, 0.0]
        sides.append(along > 0.0)
        both.append(points)
    return both, sides


def shares(owners, part):
    """Return which share of a part of each surface is told to be of which."""
    return [[float((owner[inside] == number).mean()) for number in range(len(owners))]
            for owner, inside in zip(owners, part, strict=True)]  # fmt: skip


@pytest.mark.parametrize("angle_deg", [15.0, 25.0, 40.0])
def test_a_part_of_another_surface_is_given_back(rng, angle_deg):
    (one, other), (_, beyond) = crossing(angle_deg, rng=rng)
    mixed = [np.concatenate([one, other[beyond]]), other[~beyond]]
    owners = tell_owners(mixed)
    assert (owners[1] == 1).all()
    assert (owners[0][: len(one)] == 0).mean() > 0.99
    # where the two are hardly apart nothing tells them apart
    assert (owners[0][len(one) :] == 1).mean() > 1.0 - 2.5 / (48.0 * np.sin(np.radians(angle_deg)))


def test_a_part_is_given_back_as_far_as_it_goes(rng):
    (one, other), (_, beyond) = crossing(rng=rng, size=300.0)
    mixed = [np.concatenate([one, other[beyond]]), other[~beyond]]
    owners = tell_owners(mixed)
    assert (owners[1] == 1).all()
    assert (owners[0][: len(one)] == 0).mean() > 0.98
    assert (owners[0][len(one) :] == 1).mean() > 0.95


def test_surfaces_that_change_places_where_they_cross_get_their_parts_back(rng):
    (one, other), sides = crossing(rng=rng)
    mixed = [np.concatenate([one[sides[0]], other[~sides[1]]]), np.concatenate([other[sides[1]], one[~sides[0]]])]
    owners = tell_owners(mixed)
    parts = [np.concatenate([owners[0][: sides[0].sum()], owners[1][sides[1].sum() :]]),
             np.concatenate([owners[1][: sides[1].sum()], owners[0][sides[0].sum() :]])]  # fmt: skip
    for part in parts:
        assert np.bincount(part).max() > 0.9 * len(part)
    assert np.bincount(parts[0]).argmax() != np.bincount(parts[1]).argmax()


@pytest.mark.parametrize("settings", [{}, {"bend": 0.004}, {"cotangent": 1.5}, {"cotangent": 0.0}])
def test_surfaces_that_cross_are_left_as_they_are(rng, settings):
    both, _ = crossing(rng=rng, **settings)
    for number, owner in enumerate(tell_owners(both)):
        assert (owner == number).all()


def test_parts_of_an_offset_surface_are_no_others(rng):
    """What a fault has moved aside goes on beside its other part, in its attitude."""
    along, points = surface(0.0)
    points = points + rng.normal(0.0, 0.3, points.shape) * [1.0, 1.0, 0.0]
    aside = points + np.where(along > 0.0, 5.0, 0.0)[:, None] * [0.0, 1.0, 0.0]
    owners = tell_owners([aside[along > -20.0], aside[along <= -20.0]])
    assert (owners[0] == 0).all()
    assert (owners[1] == 1).all()


def test_hardly_any_points_change_nothing(rng):
    (one, other), (_, beyond) = crossing(rng=rng, size=24.0)
    mixed = [np.concatenate([one, other[beyond]]), other[~beyond]]
    assert all((owner == number).all() for number, owner in enumerate(tell_owners(mixed)))
    assert tell_owners([]) == []
    assert tell_owners([one])[0].tolist() == [0] * len(one)


def test_the_larger_part_stays_where_it_is(rng):
    """A surface most of which is another's is that one's, with a part of this."""
    (one, other), (first, _) = crossing(rng=rng)
    mixed = [np.concatenate([one[first], other]), one[~first]]
    owners = tell_owners(mixed)
    assert (owners[0][first.sum() :] == 0).mean() > 0.99
    assert (owners[0][: first.sum()] == 1).mean() > 0.85


def test_order_of_surfaces_does_not_matter(rng):
    (one, other), (_, beyond) = crossing(rng=rng)
    mixed = [np.concatenate([one, other[beyond]]), other[~beyond]]
    there, back = tell_owners(mixed), tell_owners(mixed[::-1])
    assert shares(there, [np.ones(len(part), bool) for part in mixed])[0][1] > 0.3
    for number in range(2):
        assert (there[number] == 1 - back[1 - number]).mean() > 0.999


def terms_at(x, y):
    return np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def test_most_points_tell_a_surface(rng):
    x, y = rng.uniform(-1.0, 1.0, (2, 400))
    height = 1.0 + 2.0 * x - y + 0.5 * x * y
    height[:60] += 20.0
    off = fit_most(terms_at(x, y), height, 1e-6, 30)
    assert off[60:].max() < 0.1
    assert off[:60].min() > 19.0


def test_two_surfaces_settle_on_their_points(rng):
    x, y = rng.uniform(-1.0, 1.0, (2, 600))
    is_second = np.arange(600) >= 300
    height = np.where(is_second, 10.0 * x, -10.0 * x)
    told = is_second ^ (rng.random(600) < 0.2)
    surfaces = np.empty((2, 6))
    left = settle_points(terms_at(x, y), height, told, 1e-6, 0.1, 4.0, 30, 30, surfaces)
    assert left < 1e-3
    np.testing.assert_allclose(surfaces[:, 1], [-10.0, 10.0], atol=1e-2)
    apart = np.abs(x) > 0.01
    np.testing.assert_array_equal(told[apart], is_second[apart])


def test_a_surface_that_is_lost_leaves_all(rng):
    x, y = rng.uniform(-1.0, 1.0, (2, 100))
    surfaces = np.empty((2, 6))
    nothing = np.zeros(100, bool)
    assert settle_points(terms_at(x, y), x, nothing, 0.01, 1.0, 4.0, 30, 10, surfaces) == np.inf


def test_a_bend_counts_beside_what_is_left(rng):
    x, y = rng.uniform(-1.0, 1.0, (2, 600))
    is_second = np.arange(600) >= 300
    height = np.where(is_second, 10.0 + 3.0 * x * x, 0.0)
    surfaces = np.empty((2, 6))
    terms = terms_at(x, y)
    left = settle_points(terms, height, is_second, 0.01, 1.0, 4.0, 30, 10, surfaces)
    off = np.abs(height - surfaces @ terms.T).min(axis=0).mean()
    assert surfaces[1, 3] == pytest.approx(3.0, rel=0.2)
    assert left == pytest.approx(off + 0.01 * (surfaces[:, 3:] ** 2).sum(), rel=1e-9)


def test_it_does_not_matter_how_many_points_are_held(rng):
    (one, other), (_, beyond) = crossing(rng=rng)
    (third, fourth), (_, far) = crossing(rng=rng, middle=(200.0, 64.0))
    mixed = [np.concatenate([one, other[beyond]]), other[~beyond], np.concatenate([third, fourth[far]]), fourth[~far]]
    for few, many in zip(tell_owners(mixed, most=0), tell_owners(mixed), strict=True):
        np.testing.assert_array_equal(few, many)
