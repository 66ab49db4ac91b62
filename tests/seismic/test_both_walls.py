"""Throw where it is, and how far apart what touched lies, where both walls of a fault moved."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from seismo3d.seismic.both_walls import tell_apart, tell_throw

STEP = 2


def throw_at(row, sample):
    return 18.0 * np.exp(-0.5 * ((row - 20.0) / 25.0) ** 2 - 0.5 * ((sample - 60.0) / 40.0) ** 2)


def exact(lift, along):
    """Throw and what lies apart, the latter found place by place, at nodes of a grid."""
    rows, samples = np.mgrid[0:40, 20 : 140 + STEP : STEP].astype(float)
    apart = np.empty(rows.shape)
    for at in np.ndindex(rows.shape):
        row, sample = rows[at], samples[at]
        apart[at] = brentq(
            lambda d, r=row, s=sample: lift * throw_at(r, s) + (1.0 - lift) * throw_at(r - along * d, s - d) - d,
            0.0,
            30.0,
        )
    return throw_at(rows, samples), apart


@pytest.mark.parametrize("lift", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("along", [0.0, 0.4])
def test_one_tells_the_other(lift, along):
    throw, apart = exact(lift, along)
    assert np.abs(throw - apart).max() > 3.0 * (1.0 - lift)
    # clear of the ends, where counterparts lie off the grid
    inner = np.s_[30:, 35:]
    np.testing.assert_allclose(tell_apart(throw, lift, along, STEP)[inner], apart[inner], atol=0.05)
    np.testing.assert_allclose(tell_throw(apart, lift, along, STEP)[inner], throw[inner], atol=0.2)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_reverse_faults_are_told_alike(sign):
    columns = np.arange(161.0)
    throw = np.broadcast_to(sign * (4.0 + 0.1 * columns), (5, 161))
    apart = tell_apart(throw, 0.5, 0.0)
    # the half of the throw there and the half of that higher, or lower, up the fault
    np.testing.assert_allclose(apart[:, 75:86], throw[:, 75:86] / (1.0 + sign * 0.05), atol=1e-3)
    np.testing.assert_allclose(tell_throw(apart, 0.5, 0.0)[:, 75:86], throw[:, 75:86], atol=0.02)


def test_where_one_wall_moved_both_are_the_same_and_what_is_unknown_stays_so():
    throw, _ = exact(0.5, 0.0)
    assert tell_throw(throw, 1.0, 0.3) is throw
    assert tell_apart(throw, 1.0, 0.3) is throw
    torn = throw.copy()
    torn[10:20, :15] = np.nan
    for tell in (tell_throw, tell_apart):
        found = tell(torn, 0.5, 0.0, STEP)
        np.testing.assert_array_equal(np.isnan(found), np.isnan(torn))
        np.testing.assert_allclose(found[25:], tell(throw, 0.5, 0.0, STEP)[25:], atol=1e-9)
        assert np.isnan(tell(np.full((3, 4), np.nan), 0.5, 0.0)).all()
