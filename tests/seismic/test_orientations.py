from __future__ import annotations

import numpy as np
import pytest
from fake_faults import make_cube, make_faults

from seismo3d.plot.stereonets import _from_net, _great_circle, _to_net
from seismo3d.seismic.index_frame import IndexFrame
from seismo3d.seismic.orientations import (
    Poles,
    find_poles,
    find_sets,
    fisher_kappa,
    kamb_density,
    mean_pole,
    to_strike_dip,
)


def pole_of(strike_deg: float, dip_deg: float) -> np.ndarray:
    azimuth, dip = np.radians(strike_deg + 90.0), np.radians(dip_deg)
    return np.array([np.sin(azimuth) * np.sin(dip), np.cos(azimuth) * np.sin(dip), np.cos(dip)])


def fisher_sample(rng: np.random.Generator, mean: np.ndarray, kappa: float, n: int) -> np.ndarray:
    """Directions of a Fisher distribution, by inverting its cumulative distribution."""
    u = rng.random(n)
    cosine = 1.0 + np.log(u + (1.0 - u) * np.exp(-2.0 * kappa)) / kappa
    turn = rng.random(n) * 2 * np.pi
    sine = np.sqrt(1.0 - cosine**2)
    helper = np.array([1.0, 0.0, 0.0]) if abs(mean[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    e1 = np.cross(mean, helper)
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(mean, e1)
    return cosine[:, None] * mean + sine[:, None] * (np.cos(turn)[:, None] * e1 + np.sin(turn)[:, None] * e2)


@pytest.mark.parametrize(("strike", "dip"), [(30.0, 60.0), (200.0, 85.0), (359.0, 10.0)])
def test_strike_and_dip_come_back(strike: float, dip: float) -> None:
    for sign in (1.0, -1.0):
        assert to_strike_dip(sign * pole_of(strike, dip)) == pytest.approx((strike, dip))


def test_concentration_and_mean_of_a_known_distribution(rng: np.random.Generator) -> None:
    mean = pole_of(40.0, 65.0)
    sample = fisher_sample(rng, mean, 30.0, 4000) * rng.choice([-1.0, 1.0], 4000)[:, None]
    found = mean_pole(sample, np.ones(4000))
    assert np.degrees(np.arccos(found @ mean)) < 0.5
    # the spread of kappa over such samples is kappa / sqrt(n) = 0.5
    assert fisher_kappa(sample, np.ones(4000), found) == pytest.approx(30.0, abs=2.0)
    poles = Poles(sample, np.ones(4000), np.ones(4000, np.int64))
    (entry,) = find_sets(poles)
    angles = np.degrees(np.arccos(np.abs(sample @ found)))
    assert (angles <= entry.spread_deg).mean() == pytest.approx(0.68, abs=0.02)


def test_poles_that_all_agree_are_infinitely_concentrated() -> None:
    directions = np.tile(pole_of(10.0, 50.0), (5, 1))
    assert fisher_kappa(directions, np.ones(5), directions[0]) == np.inf


def test_sets_are_told_apart_and_steep_planes_of_opposite_dip_are_one(rng: np.random.Generator) -> None:
    groups = [(20.0, 88.0), (200.0, 87.0), (110.0, 60.0), (112.0, 64.0)]
    parts = [fisher_sample(rng, pole_of(*group), 200.0, 50) for group in groups]
    poles = Poles(np.concatenate(parts), np.ones(200), np.repeat([1, 2, 3, 4], 50))
    assert sorted(entry.surfaces for entry in find_sets(poles)) == [(1, 2), (3, 4)]
    assert len(find_sets(poles, angle_deg=1.0)) == 4
    assert find_sets(Poles(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))) == ()


def test_kamb_density_is_zero_on_average_for_an_even_spread(rng: np.random.Generator) -> None:
    even = rng.normal(size=(20000, 3))
    even /= np.linalg.norm(even, axis=1, keepdims=True)
    at = rng.normal(size=(200, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    found = kamb_density(even, np.ones(20000), at, count=50)
    assert abs(found.mean()) < 0.05
    # of many samples of 50 each the spread is one standard deviation
    one = [kamb_density(even[k : k + 50], np.ones(50), at[:20], count=50) for k in range(0, 20000, 50)]
    assert np.std(one) == pytest.approx(1.0, abs=0.1)
    cluster = np.tile(pole_of(40.0, 65.0), (50, 1))
    density = kamb_density(cluster, np.ones(50), np.array([cluster[0], -cluster[0], pole_of(130.0, 90.0)]), count=50)
    assert density[0] == density[1] > 10.0
    assert density[2] < 0.0


def test_net_keeps_areas_and_inverts() -> None:
    grid = np.meshgrid(np.linspace(-0.7, 0.7, 9), np.linspace(-0.7, 0.7, 9))
    poles = _from_net(*grid)
    np.testing.assert_allclose(np.linalg.norm(poles, axis=-1), 1.0)
    np.testing.assert_allclose(_to_net(poles.reshape(-1, 3)), np.stack(grid, -1).reshape(-1, 2), atol=1e-12)
    # a plane that dips 60 to the east has its pole in the west, at sqrt(2) sin(30 deg)
    np.testing.assert_allclose(_to_net(pole_of(0.0, 60.0)[None]), [[-np.sqrt(2) * 0.5, 0.0]], atol=1e-12)
    x, y = _great_circle(0.0, 60.0)
    # its lowest line plunges 60 to the east: 30 degrees off straight down
    assert x.max() == pytest.approx(np.sqrt(2) * np.sin(np.radians(15.0)), abs=1e-3)
    assert (x[0], abs(y[0])) == pytest.approx((0.0, 1.0))


def test_poles_of_surfaces_are_weighted_by_area() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    poles = find_poles(faults, IndexFrame.of(cube))
    for label, surface in enumerate(faults.surfaces, start=1):
        own = poles.labels == label
        assert poles.weights[own].sum() == pytest.approx(surface.area, rel=1e-5)
        expected = pole_of(float(surface.strike_deg[0]), float(surface.dip_deg[0]))
        np.testing.assert_allclose(poles.directions[own], np.tile(expected, (own.sum(), 1)), atol=1e-5)
