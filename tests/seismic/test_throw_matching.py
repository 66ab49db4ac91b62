"""Throws that die away within a surface, towards its tips."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from seismo3d.seismic.slip_fields import Sides
from seismo3d.seismic.throw import ThrowSettings
from seismo3d.seismic.throw_matching import _follow_steeper, match_throws

SHAPE = (96, 112)
THIN = ThrowSettings().thin


def ellipse(largest: float) -> np.ndarray:
    """A throw that dies away from the middle of a surface to a tip line around it."""
    r, k = np.indices(SHAPE, dtype=np.float64)
    from_middle = ((r - 48.0) / 44.0) ** 2 + ((k - 58.0) / 46.0) ** 2
    return largest * np.clip(1.0 - from_middle, 0.0, None)


def sides_of(rng: np.random.Generator, throw: np.ndarray, *, noise: float = 0.0) -> Sides:
    layers = gaussian_filter1d(rng.normal(size=SHAPE[1] + 80), 1.5)
    layers /= layers.std()
    depth = np.arange(-40.0, SHAPE[1] + 40.0)
    along = 0.05 * np.arange(SHAPE[0])[:, None]
    foot = np.interp(np.arange(SHAPE[1]) - along, depth, layers)
    hanging = np.interp(np.arange(SHAPE[1]) - throw - along, depth, layers)
    hanging, foot = (a + noise * rng.normal(size=SHAPE) for a in (hanging, foot))
    known = np.ones(SHAPE, np.float32)
    return Sides(hanging.astype(np.float32), foot.astype(np.float32), known, known)


def share_right(rng: np.random.Generator, largest: float) -> float:
    """Share of a surface, but for its rim, where the throw is found; on the mean over four sets of layers in noise."""
    throw = ellipse(largest)
    inside = np.abs(throw) > 1.0
    shares = []
    for _ in range(4):
        found, _ = match_throws(sides_of(rng, throw, noise=0.5), inside, about=None, settings=ThrowSettings())
        true = throw[::THIN, ::THIN]
        # what lies above the sides has no counterpart
        place = inside[::THIN, ::THIN] & (np.arange(true.shape[1]) * THIN > true)
        shares.append((np.abs(found - true)[place] < 1.5).mean())
    return float(np.mean(shares))


@pytest.mark.parametrize("largest", [24.0, -24.0])
def test_throws_that_die_away_fast_are_found(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, largest: float
) -> None:
    """By up to one sample from a place to the next, which windows of one throw cannot follow."""
    assert np.abs(np.gradient(ellipse(largest))).max() > 0.9
    followed = share_right(rng, largest)
    monkeypatch.setattr("seismo3d.seismic.throw_matching._follow_steeper", lambda *_: None)
    assert share_right(rng, largest) + 0.1 < followed
    assert followed > 0.7


def test_where_throws_change_little_windows_that_follow_them_change_nothing(rng: np.random.Generator) -> None:
    sides = sides_of(rng, np.full(SHAPE, 9.0) + 0.02 * np.arange(SHAPE[1]))
    told = []

    def follow(*arguments: object) -> object:
        told.append(_follow_steeper(*arguments))  # type: ignore[arg-type]
        return told[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("seismo3d.seismic.throw_matching._follow_steeper", follow)
        match_throws(sides, np.ones(SHAPE, bool), about=None, settings=ThrowSettings())
    assert told == [None]
