"""What is drawn of a network, and where."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox, TransformedBbox

from seismo3d import plot
from seismo3d.errors import ShapeError
from seismo3d.seismic.flow_paths import flow_path
from seismo3d.seismic.network import fracture_network


@pytest.fixture
def ax() -> Any:
    return Figure(figsize=(6, 5)).subplots()


def test_intersection_lies_where_it_is_on_the_map(ax: Any) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    plot.network_map(fracture_network(faults), faults, cube, ax=ax)
    (lines,) = (c for c in ax.collections if isinstance(c, LineCollection))
    ends = np.concatenate(lines.get_segments())
    # crossline 500 + j, inline 100 + 2 i, of the line through (15, 20) in the middle
    np.testing.assert_allclose(ends.mean(axis=0), [520.0, 130.0], atol=0.5)
    assert len([c for c in ax.collections if isinstance(c, PolyCollection)]) >= 2


def test_density_map_shows_cells_in_line_numbers(ax: Any) -> None:
    cube = make_cube()
    network = fracture_network(make_faults(cube), cell=(10, 16, 25))
    plot.density_map(network, cube, ax=ax)
    (mesh,) = (c for c in ax.collections if c.get_array() is not None)
    np.testing.assert_allclose(mesh.get_array().reshape(3, 3), network.density.mean(axis=2), rtol=1e-6)
    corners = mesh.get_coordinates()
    assert corners[0, 0].tolist() == [499.5, 99.0]
    assert corners[-1, -1].tolist() == [539.5, 159.0]


def test_stereonet_has_a_dot_a_fault_and_a_circle_a_set(ax: Any) -> None:
    network = fracture_network(make_faults(make_cube()))
    plot.stereonet(network, from_north=True, ax=ax)
    dots = np.concatenate([c.get_offsets() for c in ax.collections if isinstance(c, PathCollection)])
    # the first dips 63 to the east: its pole lies in the west; the second to the north
    west, south = sorted(dots.tolist())
    np.testing.assert_allclose(west, [-np.sqrt(2) * np.sin(np.radians(63.43 / 2)), 0.0], atol=1e-3)
    np.testing.assert_allclose(south, [0.0, -np.sqrt(2) * np.sin(np.radians(37.5))], atol=1e-3)
    assert len(ax.get_legend().get_texts()) == 2


@pytest.mark.parametrize("from_north", [False, True])
def test_names_of_directions_lie_outside_the_net(from_north: bool) -> None:
    figure = Figure(figsize=(5.6, 5.8), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    net = plot.stereonet(fracture_network(make_faults(make_cube())), from_north=from_north, ax=figure.add_subplot())
    figure.canvas.draw()
    circle = TransformedBbox(Bbox([[-1, -1], [1, 1]]), net.transData)
    for text in net.texts:
        box = text.get_window_extent()
        assert not text.get_text() or not box.overlaps(circle), text.get_text()
        assert not text.get_text() or box.x1 <= net.get_window_extent().x1


def test_without_faults_pictures_say_so_and_their_scales_begin_at_0() -> None:
    cube = make_cube()
    known = make_faults(cube)
    none = replace(known, surfaces=(), labels=known.labels.copy(data=np.zeros(cube.shape, np.int32)))
    network = fracture_network(none)
    above, density, net = Figure().subplots(1, 3)
    assert plot.network_map(network, none, cube, ax=above).get_title(loc="left") == "no faults"
    plot.density_map(network, cube, ax=density)
    assert [mesh.get_clim() for mesh in density.collections] == [(0.0, 1.0)]
    plot.stereonet(network, from_north=True, ax=net)
    # no density, and no scale of it
    assert not net.collections
    assert len(net.figure.axes) == 4


def test_path_is_drawn_in_three_views() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    path = flow_path(faults, (130, 510, 1020), (130, 530, 1180))
    axes = plot.flow_path_views(path, faults, cube, axes=Figure().subplots(1, 3))
    lines = [ax.lines[0].get_xydata() for ax in axes]
    assert lines[0][0].tolist() == [510.0, 130.0]
    assert lines[1][-1].tolist() == [530.0, 1180.0]
    assert lines[2][0].tolist() == [130.0, 1020.0]


def test_section_is_refused(ax: Any) -> None:
    section, faults = make_section()
    with pytest.raises(ShapeError, match="no fracture network"):
        plot.network_map(None, faults, section, ax=ax)


def test_numbers_of_faults_that_cross_do_not_lie_on_each_other() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    ax = plot.network_map(fracture_network(faults), faults, cube, ax=Figure(figsize=(6, 6)).subplots())
    places = np.array([text.get_position() for text in ax.texts])
    assert len(places) == len(faults.surfaces)
    for text, surface in zip(ax.texts, faults.surfaces, strict=True):
        top = surface.vertices[surface.vertices[:, 2] <= np.quantile(surface.vertices[:, 2], 0.1)].mean(axis=0)
        row = cube.inline.values[0] + top[0] * (cube.inline.values[1] - cube.inline.values[0])
        assert text.xy[1] == pytest.approx(row, rel=1e-4)
