"""Lines of tracks on sections: drawn where the horizon goes on, broken where it jumps."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np

from seismo3d.plot.track_pictures import track_section
from seismo3d.seismic.tracks import Track

mpl.use("Agg")


def test_a_track_is_not_drawn_across_a_fault() -> None:
    cube = np.random.default_rng(5).normal(size=(6, 20, 60)).astype(np.float32)
    depth = np.full((6, 20), 30.0, np.float32)
    depth[:, 12:] = 41.0
    depth[:, 4] = np.nan
    ax = track_section(cube, [Track(depth, np.ones_like(depth), np.array([[2.0, 3.0, 30.0]]))], inline=2)
    columns, line = (np.asarray(values, float) for values in ax.lines[-1].get_data())
    drawn = np.isfinite(line)
    np.testing.assert_array_equal(columns[drawn], [n for n in range(20) if n != 4])
    steps = np.diff(line)
    assert np.nanmax(np.abs(steps)) == 0.0
    assert np.isnan(steps[(columns[:-1] == 11) | (columns[1:] == 12)]).any()
    # the black line under it ends there too
    np.testing.assert_array_equal(ax.lines[-2].get_data()[1], line)
