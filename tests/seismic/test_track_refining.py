"""Where inner traces of a part lead to, at its edge."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.track_refining import TrackSettings, _extend

SHAPE = (30, 24)


def plane(*, level: float = 300.0, down: float = 0.4, along: float = -0.25) -> np.ndarray:
    rows, columns = np.indices(SHAPE)
    return level + down * rows + along * columns


def test_a_plane_is_led_on_exactly() -> None:
    inner = np.zeros(SHAPE, bool)
    inner[:, :16] = True
    edge, led = _extend(plane(), inner, ~inner & (np.indices(SHAPE)[1] < 20), TrackSettings())
    assert edge.sum() == 4 * SHAPE[0]
    # the plane of all inner traces is taken off first: the little that is held back is of it alone
    np.testing.assert_allclose(led, plane()[edge], atol=0.03)


def test_a_bend_is_followed(rng: np.random.Generator) -> None:
    bent = plane() + 0.01 * (np.indices(SHAPE)[0] - 8.0) ** 2 + rng.normal(0.0, 0.02, SHAPE)
    inner = np.zeros(SHAPE, bool)
    inner[:26] = True
    edge, led = _extend(bent, inner, ~inner, TrackSettings())
    assert np.abs(led - bent[edge]).max() < 0.8
    assert np.abs(led[:24] - bent[26]).max() < 0.35


@pytest.mark.parametrize("few", [1, 2, 5])
def test_few_traces_in_line_tell_no_slope_across_it(rng: np.random.Generator, few: int) -> None:
    """Noise of theirs of half a sample must not send the traces beside them off by many."""
    inner = np.zeros(SHAPE, bool)
    inner[10 : 10 + few, 12] = True
    depth = 40.0 + rng.normal(0.0, 0.5, SHAPE)
    wanted = np.zeros(SHAPE, bool)
    wanted[8 : 13 + few, 8:17] = True
    edge, led = _extend(depth, inner, wanted & ~inner, TrackSettings())
    assert edge.sum() == (wanted & ~inner).sum()
    assert np.abs(led - 40.0).max() < 2.5
