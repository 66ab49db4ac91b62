"""Lines of tracks on sections: drawn where the horizon goes on, broken where it jumps."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from fake_faults import make_cube, make_faults
from matplotlib.figure import Figure

from seismo3d import plot
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


def test_contours_end_where_a_track_jumps() -> None:
    cube = make_cube()
    ramp = np.broadcast_to(np.linspace(1010.0, 1040.0, 40), (30, 40)).astype(np.float32)
    faulted = ramp + np.where(np.arange(30)[:, None] < 15, 0.0, 80.0).astype(np.float32)
    ax = Figure().subplots()
    plot.track_map(Track(faulted, np.ones_like(faulted), np.zeros((0, 3)), "ms"), cube, contours=9, ax=ax)
    drawn = [line for item in ax.collections if hasattr(item, "levels") for line in item.get_paths() if len(line)]
    middle = 0.5 * (cube.inline.values[14] + cube.inline.values[15])
    assert len(drawn) > 2
    for line in drawn:
        assert (line.vertices[:, 1] < middle).all() or (line.vertices[:, 1] > middle).all()


def test_a_legend_names_several_tracks_and_not_one() -> None:
    cube = make_cube()
    flat = np.full(cube.shape[:2], 1100.0, np.float32)
    tracks = [Track(flat + 20 * k, np.ones_like(flat), np.zeros((0, 3)), "ms") for k in range(3)]
    legend = plot.track_section(cube, tracks, ax=Figure().subplots()).get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["track 1", "track 2", "track 3"]
    assert plot.track_section(cube, tracks[:1], ax=Figure().subplots()).get_legend() is None


def test_faults_have_a_look_that_no_track_has() -> None:
    cube = make_cube()
    flat = np.full(cube.shape[:2], 1100.0, np.float32)
    tracks = [Track(flat, np.ones_like(flat), np.zeros((0, 3)), "ms")]
    where = {"inline": float(cube.inline.values[5]), "faults": make_faults(cube)}
    ax = plot.track_section(cube, tracks, ax=Figure().subplots(), **where)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["fault", "track 1"]
    rim, core = (mpl.colors.to_hex(lines.get_color()[0]) for lines in ax.collections[-2:])
    assert (rim, core) == ("#ffffff", "#000000")
    # whoever asks for a colouring gets it
    ax = plot.track_section(cube, tracks, ax=Figure().subplots(), colour="surface", **where)
    assert mpl.colors.to_hex(ax.collections[-1].get_color()[0]) not in ("#000000", "#ffffff")
