"""Views from above lie as the map does: turned and scaled, never mirrored or stretched."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from seismo3d import plot
from seismo3d.errors import ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.io.horizons import HorizonPoints
from seismo3d.plot.map_frame import MapFrame
from seismo3d.seismic.flow_paths import flow_path
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.network import fracture_network
from seismo3d.seismic.stick_scores import score_sticks
from seismo3d.seismic.sticks import cut_sticks
from seismo3d.seismic.tracks import Track

CLOSED = LoopClosure(0.0, 0.0, 1200, 1, np.zeros((30, 40), np.float32))


def on_map(azimuth: float, *, left_handed: bool, order: tuple[int, int] = (1, 1)) -> Any:
    """A cube of bins of 12.5 x 25 m whose inlines grow towards an azimuth; its lines in falling order where asked."""
    cube = make_cube()
    along, across = np.radians([azimuth, azimuth + (-90.0 if left_handed else 90.0)])
    i, j = np.meshgrid(12.5 * np.arange(30), 25.0 * np.arange(40), indexing="ij")
    x, y = i * np.sin(along) + j * np.sin(across), i * np.cos(along) + j * np.cos(across)
    lines = ("inline", "crossline")
    return cube.assign_coords(cdp_x=(lines, 5e5 + x), cdp_y=(lines, 6e6 + y))[:: order[0], :: order[1]]


def _draw_track(cube: Any, _: Any, ax: Any) -> None:
    depth = (1020.0 + 2.0 * np.add.outer(np.arange(30), np.arange(40))).astype(np.float32)
    plot.track_map(Track(depth, np.ones_like(depth), np.array([[110.0, 505.0, 1020.0]]), "ms"), cube, ax=ax)


def _draw_picks(cube: Any, faults: Any, ax: Any) -> None:
    sticks = cut_sticks(faults, cube)
    plot.picked_faults_map(faults, sticks, score_sticks(faults, sticks), ax=ax)


def _draw_distances(cube: Any, _: Any, ax: Any) -> None:
    lines = np.stack(np.meshgrid(cube.inline.values, cube.crossline.values), axis=-1).reshape(-1, 2).astype(np.float64)
    picks = HorizonPoints("top", np.column_stack([lines, np.full(len(lines), 1100.0)]), lines)
    plot.pick_distance_map(picks, picks, unit="ms", cube=cube, ax=ax)


def _draw_path(cube: Any, faults: Any, ax: Any) -> None:
    path = flow_path(faults, (130, 510, 1020), (130, 530, 1180))
    plot.flow_path_views(path, faults, cube, axes=[ax, *Figure().subplots(1, 2)])


VIEWS = {
    "time slice": lambda cube, faults, ax: plot.time_slice(cube, time=1100, faults=faults, ax=ax),
    "likelihood": lambda cube, faults, ax: plot.likelihood(cube, time=1100, faults=faults, ax=ax),
    "throw map": lambda cube, faults, ax: plot.throw_map(faults, cube, ax=ax),
    "network map": lambda cube, faults, ax: plot.network_map(fracture_network(faults), faults, cube, ax=ax),
    "density map": lambda cube, faults, ax: plot.density_map(fracture_network(faults), cube, ax=ax),
    "flow path": _draw_path,
    "track map": _draw_track,
    "loop map": lambda cube, _, ax: plot.loop_map(CLOSED, cube, ax=ax),
    "picked faults": _draw_picks,
    "pick distances": _draw_distances,
}


def draw(view: str, cube: Any) -> Any:
    figure = Figure(figsize=(6, 5), dpi=80)
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    VIEWS[view](cube, make_faults(cube), ax)
    figure.canvas.draw()
    return ax


def steps_on_page(ax: Any, cube: Any) -> np.ndarray:
    """Pixels to the right and upwards, by index step along the inline and the crossline axis (the columns)."""
    inlines, crosslines = cube.inline.values, cube.crossline.values
    corners = [(crosslines[0], inlines[0]), (crosslines[0], inlines[1]), (crosslines[1], inlines[0])]
    at = ax.transData.transform(corners)
    return np.asarray(at[1:] - at[0]).T


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("left_handed", [False, True])
@pytest.mark.parametrize("order", [(1, 1), (-1, 1), (1, -1)])
def test_the_page_is_the_map_turned_and_scaled(view: str, left_handed: bool, order: tuple[int, int]) -> None:
    cube = on_map(32.0, left_handed=left_handed, order=order)
    page = steps_on_page(draw(view, cube), cube)
    page_from_map = page @ np.linalg.inv(SurveyGeometry.from_cube(cube).east_north)
    assert np.linalg.det(page_from_map) > 0
    squared = page_from_map.T @ page_from_map
    np.testing.assert_allclose(squared / squared[0, 0], np.eye(2), atol=1e-6)
    # crosslines to the right
    assert page[0, 1] > 0
    assert page[1, 1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("view", VIEWS)
def test_without_a_map_inlines_go_down_and_bins_are_square(view: str) -> None:
    cube = make_cube().drop_vars(["cdp_x", "cdp_y"])
    page = steps_on_page(draw(view, cube), cube)
    np.testing.assert_allclose(page / page[0, 1], [[0.0, 1.0], [-1.0, 0.0]], atol=1e-6)


def test_without_a_grid_lines_are_drawn_by_their_numbers() -> None:
    cube = on_map(32.0, left_handed=False)
    gaps = cube.isel(inline=[0, 1, 2, 5, 9, 10, 20])
    frame = MapFrame.from_cube(gaps)
    assert (frame.inlines_up, frame.bins) == (False, (1.0, 1.0))
    # halfway from 104 to 110
    np.testing.assert_allclose(frame.place([[2.5, 3.0, 0.0]]), [[503.0, 107.0]])


def test_the_whole_survey_is_shown() -> None:
    cube = on_map(32.0, left_handed=False, order=(-1, 1))
    ax = draw("network map", cube)
    assert (ax.get_xlim(), ax.get_ylim()) == ((499.5, 539.5), (99.0, 159.0))


def test_a_section_is_refused() -> None:
    with pytest.raises(ShapeError, match="a section has no map"):
        MapFrame.from_cube(make_section()[0])
