from __future__ import annotations

from dataclasses import replace

import matplotlib as mpl
import numpy as np
from fake_faults import make_cube, make_faults
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from seismo3d.io.horizons import HorizonPoints
from seismo3d.plot.pick_pictures import pick_distance_map, picked_faults_map
from seismo3d.seismic.stick_scores import score_sticks
from seismo3d.seismic.sticks import cut_sticks

mpl.use("Agg")


def test_where_track_and_picks_agree_is_seen() -> None:
    lines = np.argwhere(np.ones((6, 7))).astype(np.float64)
    picks = HorizonPoints("top", np.column_stack([lines, np.full(42, 800.0)]), lines)
    ax = pick_distance_map(picks, picks, unit="ms", ax=Figure().add_subplot())
    (drawn,) = ax.collections
    drawn.update_scalarmappable()
    apart = np.abs(drawn.get_facecolors()[:, :3] - np.array(ax.get_facecolor()[:3]))
    assert apart.min() > 0.2
    by_map = HorizonPoints("top", picks.points, np.full((42, 2), np.nan))
    assert pick_distance_map(by_map, by_map, unit="ms", ax=Figure().add_subplot()).get_aspect() == 1.0


def test_sticks_of_faults_outside_the_cube_are_not_drawn() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    own = cut_sticks(faults, cube)
    below = [replace(stick, fault="below", points=stick.points + np.array([0.0, 0.0, 1000.0])) for stick in own]
    ax = picked_faults_map(faults, own + below, score_sticks(faults, own + below), ax=Figure().add_subplot())
    found, missed = ax.collections[-2:]
    assert (len(found.get_paths()), len(missed.get_paths())) == (len(own), 0)


def test_upright_sticks_are_seen_from_above() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    own = cut_sticks(faults, cube)
    points = np.tile(own[0].points[:1], (3, 1)) + np.array([[0.0, 0.0, 8.0 * k] for k in range(3)])
    upright = replace(own[0], fault="upright", points=points)
    figure = Figure(figsize=(6, 5), dpi=80)
    FigureCanvasAgg(figure)
    ax = picked_faults_map(faults, [upright], score_sticks(faults, [upright], tolerance=0.01), ax=figure.add_subplot())
    ax.get_legend().remove()
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)
    red = np.abs(pixels - [0xD6, 0x27, 0x28]).max(axis=2) < 30
    assert red.sum() >= 4
    assert "0 % of the sticks within 0.01 traces and samples" in ax.get_title(loc="left")
