from __future__ import annotations

import numpy as np
from scipy import ndimage

from seismo3d.seismic.whole_shift import settle_whole

SHAPE = (40, 36, 50)


def dips(rng: np.random.Generator) -> np.ndarray:
    made = [ndimage.gaussian_filter(rng.normal(size=SHAPE), (6.0, 6.0, 10.0)) for _ in range(2)]
    return np.stack([0.3 * one / one.std() for one in made]).astype(np.float32)


def test_a_wrong_lateral_shift_is_told_by_the_dip_in_vertical_ones(rng: np.random.Generator) -> None:
    dip, known = dips(rng), np.ones(SHAPE, bool)
    known[3:5] = False
    i, j, _ = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in SHAPE), indexing="ij")
    vertical = (2.0 + i - 0.5 * i * j + 0.8 * dip[0] - 0.3 * dip[1]).astype(np.float32)
    vertical[~known] = 99.0
    lateral, covariance = settle_whole(vertical, dip, known, np.array([0.1, -0.2]))
    np.testing.assert_allclose(lateral, [0.9, -0.5], atol=0.01)
    assert np.sqrt(np.diag(covariance)).max() < 0.01


def test_vertical_shifts_that_look_like_dip_make_it_less_sure(rng: np.random.Generator) -> None:
    """Of 24 cubes with vertical shifts of parts, the told standard deviation is that of the errors."""
    errors, told = [], []
    for _ in range(24):
        parts = ndimage.gaussian_filter(rng.normal(size=SHAPE), (6.0, 6.0, 10.0))
        vertical = (0.3 * parts / parts.std()).astype(np.float32)
        lateral, covariance = settle_whole(vertical, dips(rng), np.ones(SHAPE, bool), np.zeros(2))
        errors.append(lateral)
        told.append(np.sqrt(np.diag(covariance)))
    ratio = np.array(errors) / np.array(told)
    assert 0.6 < np.sqrt(np.mean(ratio**2)) < 1.4
    assert (np.abs(ratio) < 2.0).mean() > 0.85


def test_level_layers_tell_nothing() -> None:
    vertical = np.random.default_rng(1).normal(size=SHAPE).astype(np.float32)
    nothing = np.zeros((2, *SHAPE), np.float32)
    lateral, covariance = settle_whole(vertical, nothing, np.ones(SHAPE, bool), np.zeros(2))
    np.testing.assert_allclose(lateral, 0.0, atol=1e-9)
    # of a trace is what is expected before anything is known
    assert np.all(np.sqrt(np.diag(covariance)) <= 1.0)
