"""Pictures are judged by their pixels: what is drawn, and where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from seismo3d import plot
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.plot.drawing import bar_ends
from seismo3d.plot.sections import most_faulted_lines
from seismo3d.seismic.faultset import FaultSet


@pytest.fixture
def ax() -> Any:
    figure = Figure(figsize=(6, 5), dpi=80)
    FigureCanvasAgg(figure)
    return figure.subplots()


@pytest.fixture(autouse=True)
def _settings_stay() -> Iterator[None]:
    before = dict(mpl.rcParams)
    yield
    assert dict(mpl.rcParams) == before


def pixels(ax: Any) -> np.ndarray:
    ax.figure.canvas.draw()
    return np.asarray(ax.figure.canvas.buffer_rgba())[..., :3].astype(int)


def pixel_at(ax: Any, x: float, y: float) -> np.ndarray:
    image = pixels(ax)
    column, row = ax.transData.transform((x, y))
    return image[image.shape[0] - 1 - round(row), round(column)]


def saturation(colour: np.ndarray) -> int:
    return int(np.max(colour) - np.min(colour))


def test_section_is_grey_and_faults_are_coloured_where_they_are(ax: Any) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    plot.section(cube, inline=120, ax=ax, faults=faults)
    time = 1100.0
    on_fault = 520 + ((time - 1000) / 4 - 24.5) * 0.5
    assert saturation(pixel_at(ax, on_fault, time)) > 80
    assert saturation(pixel_at(ax, on_fault - 6, time)) < 10
    assert ax.get_xlabel() == "Crossline"
    assert ax.get_ylabel() == "Time (ms)"
    low, high = ax.get_ylim()
    assert low > high  # time grows downwards
    assert (ax.get_xlim(), (low, high)) == ((499.5, 539.5), (1198.0, 998.0))


def test_amplitudes_have_the_right_sign_and_place(ax: Any) -> None:
    cube = make_cube().copy(deep=True)
    cube.values[:] = 0.0
    cube.values[10, 7, 30] = 5.0
    cube.values[10, 30, 10] = -5.0
    plot.section(cube, inline=120, ax=ax, clip=100)
    assert pixel_at(ax, 507, 1120).min() > 240
    assert pixel_at(ax, 530, 1040).max() < 15
    assert 110 < pixel_at(ax, 520, 1100).mean() < 145


def test_traces_without_data_are_marked(ax: Any) -> None:
    plot.section(make_cube(), inline=106, ax=ax)  # missing traces at crosslines 503 and 504
    marked = pixel_at(ax, 503.5, 1100)
    np.testing.assert_allclose(marked, [0xE9, 0xED, 0xF2], atol=2)
    assert "no data (5 %)" in [text.get_text() for text in ax.get_legend().get_texts()]


def test_throw_colours_tell_signs_apart(ax: Any) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    plot.section(cube, sample=20, ax=ax, faults=faults, colour="throw")
    normal = pixel_at(ax, 520 + (20 - 24.5) * 0.5, 145)  # inline 145: large positive throw
    reverse = pixel_at(ax, 535, 100 + 2 * (15 + (20 - 24.5) / np.tan(np.radians(75))))
    assert normal[0] > normal[2] + 50  # red
    assert reverse[2] > reverse[0]  # blue
    assert [a.get_ylabel() for a in ax.figure.axes[1:]] == ["Throw (ms)"]


def test_time_slice_and_throw_map_show_bins_true(ax: Any) -> None:
    cube = make_cube()
    plot.time_slice(cube, time=1100, ax=ax)
    box = ax.get_window_extent()
    # 30 inlines of 25 m and 40 crosslines of 12.5 m: 750 by 500 m
    ax.figure.canvas.draw()
    assert ax.get_window_extent().height / ax.get_window_extent().width == pytest.approx(1.5, rel=0.02)
    assert box.width > 0


def test_throw_map_has_faults_only_where_they_are(ax: Any) -> None:
    cube = make_cube()
    plot.throw_map(make_faults(cube), cube, ax=ax)
    assert saturation(pixel_at(ax, 520, 150)) > 60
    assert pixel_at(ax, 502, 150).min() > 250


def test_likelihood_is_transparent_off_the_faults(ax: Any) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    plot.likelihood(cube, faults=faults, inline=120, ax=ax)
    j, k = np.argwhere(faults.likelihood.values[10] > 0)[50]
    assert saturation(pixel_at(ax, 500 + j, 1000 + 4 * k)) > 60
    assert saturation(pixel_at(ax, 538, 1010)) < 10


def test_section_of_a_line(ax: Any) -> None:
    section, faults = make_section()
    plot.section(section, faults=faults, ax=ax, colour="likelihood")
    assert saturation(pixel_at(ax, 1 + 30, 50.0)) > 60
    assert ax.get_xlabel() == "Trace"


def test_without_axes_a_pyplot_figure_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    plt = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setitem(mpl.rcParams, "backend", mpl.rcParams["backend"])
    plt.switch_backend("agg")
    ax = plot.section(make_cube().values, crossline=3)
    assert ax.figure.number in plt.get_fignums()
    plt.close(ax.figure)


def test_cube_of_nothing_draws(ax: Any) -> None:
    plot.section(np.full((5, 6, 7), np.nan, np.float32), inline=2, ax=ax)
    plot.section(np.zeros((5, 6, 7), np.float32), inline=2, ax=ax)
    assert len(np.unique(pixels(ax).reshape(-1, 3), axis=0)) > 2


def test_rose_points_along_the_strikes() -> None:
    figure = Figure(figsize=(4, 4))
    ax = figure.add_subplot(projection="polar")
    plot.strike_rose(make_faults(make_cube()), from_north=True, ax=ax)
    angles = np.degrees([p.get_x() + p.get_width() / 2 for p in ax.patches])
    heights = np.array([p.get_height() for p in ax.patches])
    assert sorted(angles[heights > 0].round()) == [
        5,
        95,
        185,
        275,
    ]  # strikes 0 and 270, both ways
    assert (heights[heights > 0] ** 2).sum() == pytest.approx(2.0)
    with pytest.raises(ParameterError, match="bin_deg is 0"):
        plot.strike_rose(make_faults(make_cube()), from_north=True, bin_deg=0.0)


def test_throw_histogram_is_weighted_by_area(ax: Any) -> None:
    plot.throw_histogram(make_faults(make_cube()), ax=ax)
    heights = np.array([p.get_height() for p in ax.patches])
    centres = np.array([p.get_x() + p.get_width() / 2 for p in ax.patches])
    assert heights.sum() == pytest.approx(100.0)
    assert heights[centres < 0].sum() == pytest.approx(100 * 1413 / (1413 + 1090), abs=1.0)


@pytest.mark.parametrize("from_north", [False, True])
def test_names_of_directions_lie_outside_the_rose(from_north: bool) -> None:
    figure = Figure(figsize=(5.2, 4.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    rose = figure.add_subplot(projection="polar")
    plot.strike_rose(make_faults(make_cube()), from_north=from_north, ax=rose)
    figure.canvas.draw()
    circle = rose.get_window_extent()
    for label in rose.get_xticklabels():
        if label.get_text():
            box = label.get_window_extent()
            assert not box.overlaps(circle), label.get_text()
            assert box.x1 <= figure.bbox.x1


@pytest.mark.parametrize(("throw", "spread"), [(24.0, 0.2), (-24.0, 0.0), (0.0, 0.0)])
def test_bars_of_throws_that_are_alike_are_wide_enough_to_be_seen(ax: Any, throw: float, spread: float) -> None:
    faults = make_faults(make_cube())
    surface = faults.surfaces[0]
    throws = (np.linspace(throw - spread, throw + spread, len(surface.throw)) / 4.0).astype(np.float32)
    plot.throw_histogram(replace(faults, surfaces=(replace(surface, throw=throws),)), ax=ax)
    assert sum(bar.get_height() for bar in ax.patches) == pytest.approx(100.0)
    left, right = ax.get_xlim()
    # of an axis some 400 pixels wide, with an edge of half a point on both sides
    assert min(bar.get_width() for bar in ax.patches) > (right - left) / 80
    drawn = [bar.get_x() + bar.get_width() / 2 for bar in ax.patches if bar.get_height() > 0]
    np.testing.assert_allclose(drawn, throw, atol=0.3)


def test_empty_fault_set_draws_everywhere(ax: Any) -> None:
    cube = make_cube()
    empty = FaultSet((), cube.copy(data=np.zeros(cube.shape)), cube.copy(data=np.zeros(cube.shape, int)), cube)
    bare = plot.section(cube, ax=Figure().subplots())
    assert len(plot.section(cube, faults=empty, ax=ax).get_children()) == len(bare.get_children())
    seen = plot.throw_map(empty, cube, ax=Figure().subplots())
    assert not [entry for entry in seen.collections if isinstance(entry, PolyCollection)]
    bars = plot.throw_histogram(empty, ax=Figure().subplots()).patches
    petals = plot.strike_rose(empty, from_north=False, ax=Figure().add_subplot(projection="polar")).patches
    assert not any(bar.get_height() for bar in (*bars, *petals))


def test_most_faulted_lines_are_found() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    lines = most_faulted_lines(faults, cube)
    counts = (faults.labels.values > 0).sum(axis=(1, 2))
    assert counts[(int(lines["inline"]) - 100) // 2] == counts.max()
    assert 1020 <= lines["time"] <= 1176


def test_refusals(ax: Any) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    with pytest.raises(ParameterError, match="colour is 'dip'; expected"):
        plot.section(cube, faults=faults, colour="dip", ax=ax)
    with pytest.raises(ShapeError, match="Give the cube that they were traced in"):
        plot.section(cube[:5], faults=faults, ax=ax)
    with pytest.raises(ShapeError, match="a section has no time slice"):
        plot.time_slice(make_section()[0], ax=ax)
    with pytest.raises(ParameterError, match=r"inline is 104; expected the time, .* Use plot\.section"):
        plot.time_slice(cube, inline=104, ax=ax)
    with pytest.raises(ParameterError, match="time and inline are given; expected one"):
        plot.section(cube, inline=104, time=1100, ax=ax)
    with pytest.raises(ParameterError, match="clip is 150"):
        plot.section(cube, clip=150, ax=ax)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = plot.nothing


def test_unsigned_bytes_are_drawn_about_their_level() -> None:
    amplitudes = np.rint(np.random.default_rng(3).normal(0.0, 30.0, (24, 40, 60))).clip(-127, 127)
    drawn = []
    for values in (amplitudes, (amplitudes + 128.0).astype(np.uint8)):
        ax = plot.section(values, inline=12)
        drawn.append(np.array(ax.images[0].get_clim()))
    np.testing.assert_allclose(drawn[0], [-77.0, 77.0], atol=4.0)
    np.testing.assert_allclose(drawn[1] - 128.0, drawn[0], atol=2.0)


def test_line_numbers_of_seven_digits_are_written_in_full(ax: Any) -> None:
    cube = make_cube()
    cube = cube.assign_coords(inline=cube.inline.values + 1_234_000, crossline=cube.crossline.values + 7_654_000)
    plot.section(cube, inline=1_234_130, ax=ax)
    assert ax.get_title(loc="left") == "Inline 1234130"
    for ax_from_above in (ax, plot.throw_map(make_faults(cube), cube, ax=Figure().subplots())):
        ax_from_above.figure.canvas.draw()
        assert "7654500" in [text.get_text() for text in ax_from_above.get_xticklabels()]
    with pytest.raises(ParameterError, match="inline is 1234099; expected 1234100 to 1234158"):
        plot.section(cube, inline=1_234_099, ax=ax)


@pytest.mark.parametrize(
    ("values", "ends"),
    [([0.0, np.nan, 1], "neither"), ([-2.0, 0.5], "min"), ([0.5, 2.0], "max"), ([-2.0, 2.0], "both"), ([], "neither")],
)
def test_ends_of_a_colour_bar_that_hold_more_are_named(values: list[float], ends: str) -> None:
    assert bar_ends(np.array(values), -1.0, 1.0) == ends


def test_colour_bars_of_throw_are_pointed_where_throws_go_beyond_them(ax: Any) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    plot.throw_map(faults, cube, ax=ax)
    (bar,) = [other for other in ax.figure.axes if other is not ax]
    throws = np.concatenate([s.throw * s.sample_interval for s in faults.surfaces])
    low, high = bar.get_ylim()
    assert np.nanmax(throws) > high
    assert bar._colorbar.extend == ("both" if np.nanmin(throws) < low else "max")
