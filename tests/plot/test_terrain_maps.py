from __future__ import annotations

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from fake_terrain import make_scarp, place

from seismo3d import plot
from seismo3d.errors import ParameterError
from seismo3d.terrain import compare, lineaments, scarps

mpl.use("Agg")


@pytest.fixture(scope="module")
def drawn():
    dem = place(make_scarp(azimuth_deg=20.0))
    found = lineaments(dem)
    yield dem, found
    plt.close("all")


def test_lines_lie_on_the_map(drawn):
    dem, found = drawn
    ax = plot.terrain(dem, lines=found)
    assert len(ax.lines) == len(found)
    x, y = ax.lines[0].get_data()
    left, right, bottom, top = ax.images[0].get_extent()
    assert left <= x.min() <= x.max() <= right
    assert bottom <= y.min() <= y.max() <= top
    assert ax.images[0].get_array().std() > 0.01


def test_the_rose_points_along_the_longest_strike(drawn):
    ax = plot.lineament_rose(drawn[1])
    petals = {np.degrees(bar.get_x() + 0.5 * bar.get_width()): bar.get_height() for bar in ax.patches}
    assert abs(max(petals, key=petals.get) % 180.0 - 20.0) <= 10.0
    # areas are shares: the squares of the radii of one half add up to one
    assert sum(h**2 for h in petals.values()) == pytest.approx(2.0)
    with pytest.raises(ParameterError, match="bin_deg is 0"):
        plot.lineament_rose(drawn[1], bin_deg=0.0)


def test_change_and_profile(drawn, rng):
    dem, found = drawn
    after = dem.copy(data=(dem.values + rng.normal(0.0, 0.1, dem.shape)).astype("f4"))
    after.values[20:40, 20:40] += 5.0
    ax = plot.change_map(compare(dem, after))
    assert ax.images[1].get_array().count() == pytest.approx(400, rel=0.05)
    profile = plot.scarp_profile(scarps(dem, found)[0])
    z = profile.lines[0].get_ydata()
    assert z[0] - z[-1] > 2.0
