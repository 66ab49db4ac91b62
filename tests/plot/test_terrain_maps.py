from __future__ import annotations

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from fake_terrain import make_scarp, place
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from seismo3d import plot
from seismo3d.errors import ParameterError
from seismo3d.geometry.map_grid import MapGrid
from seismo3d.io.elevation import make_elevation
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


def test_a_turned_map_is_drawn_where_it_lies(rng):
    dem = make_elevation(rng.normal(size=(20, 30)), (7.0, -7.0, 400_000.0, -7.0, -7.0, 3_800_000.0))
    grid = MapGrid.from_elevation(dem)
    ax = plot.terrain(dem)
    drawn = ax.images[0]
    assert drawn.get_extent() == [0, 30, 20, 0]  # columns and rows
    places = np.array([[0.0, 0.0], [29.0, 19.0], [3.0, 17.0]])
    laid = (drawn.get_transform() - ax.transData).transform(places + 0.5)
    np.testing.assert_allclose(laid, grid.to_map(places), rtol=1e-12)
    corners = grid.to_map([[-0.5, -0.5], [29.5, -0.5], [-0.5, 19.5], [29.5, 19.5]])
    np.testing.assert_allclose([ax.get_xlim(), ax.get_ylim()], np.array([corners.min(0), corners.max(0)]).T)


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
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["not significant at 95 %"]
    profile = plot.scarp_profile(scarps(dem, found)[0])
    z = profile.lines[0].get_ydata()
    assert z[0] - z[-1] > 2.0


def test_the_key_of_a_change_map_tells_no_change_from_no_data(drawn, rng):
    dem, _ = drawn
    after = dem.copy(data=(dem.values + rng.normal(0.0, 0.1, dem.shape)).astype("f4"))
    after.values[20:40, 20:40] += 5.0
    after.values[:30, -30:] = np.nan
    figure = Figure(figsize=(6, 6), dpi=80)
    FigureCanvasAgg(figure)
    ax = plot.change_map(compare(dem, after, confidence=0.9), ax=figure.add_subplot())
    key = dict(
        zip([text.get_text() for text in ax.get_legend().get_texts()], ax.get_legend().get_patches(), strict=True)
    )
    assert list(key) == ["not significant at 90 %", "no data"]
    figure.canvas.draw()
    seen = np.asarray(figure.canvas.buffer_rgba())[..., :3] / 255.0
    grid = MapGrid.from_elevation(dem)
    for (column, row), name in (((100.0, 100.0), "not significant at 90 %"), ((185.0, 15.0), "no data")):
        x, y = np.rint(ax.transData.transform(grid.to_map([[column, row]])[0])).astype(int)
        place = seen[seen.shape[0] - 1 - y - 4 : seen.shape[0] - y + 4, x - 4 : x + 5].reshape(-1, 3)
        colours, counts = np.unique(place, axis=0, return_counts=True)
        # the hatch goes over some of it
        np.testing.assert_allclose(colours[counts.argmax()], key[name].get_facecolor()[:3], atol=0.01)
        # white is what has changed by about nothing
        assert colours[counts.argmax()].max() < 0.96
