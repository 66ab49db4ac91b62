from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section

from seismo3d import plot
from seismo3d.errors import FileAccessError, ParameterError, RenderError, ShapeError
from seismo3d.plot import rendering
from seismo3d.plot.scene_frame import SceneFrame, far_slices
from seismo3d.plot.scenes import grid_cells
from seismo3d.plot.sketches import sketch_scene


@pytest.fixture
def _renderer() -> None:
    if problem := rendering.find_windowless()[1]:
        pytest.skip(f"no renderer: {problem}")


def coloured(image: np.ndarray) -> int:
    """Pixels that are not grey."""
    return int((np.ptp(image.astype(int), axis=2) > 60).sum())


@pytest.mark.usefixtures("_renderer")
def test_scene_shows_slices_and_faults() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    bare = rendering.render_scene(cube, size=(400, 300))
    assert bare.shape == (300, 400, 3)
    assert len(np.unique(bare.reshape(-1, 3), axis=0)) > 20
    assert coloured(bare) == 0
    for colour in ("throw", "likelihood", "surface"):
        assert coloured(rendering.render_scene(cube, size=(400, 300), faults=faults, colour=colour)) > 2000
    # the scene fits: nothing but white along the picture's edge
    frame = np.concatenate([bare[0], bare[-1], bare[:, 0], bare[:, -1]])
    assert frame.min() == 255


@pytest.mark.usefixtures("_renderer")
def test_tracks_are_drawn_where_they_are_known() -> None:
    cube = make_cube()
    track = np.full(cube.shape[:2], np.nan)
    track[:, :20] = 1100.0
    half = coloured(rendering.render_scene(cube, size=(400, 300), tracks=[track]))
    track[:, 20:] = 1100.0
    assert 500 < half < coloured(rendering.render_scene(cube, size=(400, 300), tracks=[track]))
    with pytest.raises(ShapeError, match="one depth a trace"):
        plot.cube(cube, tracks=[track[:5]], off_screen=True)


@pytest.mark.usefixtures("_renderer")
def test_saved_scene_is_a_picture_and_settings_stay(tmp_path: Path) -> None:
    import pyvista as pv
    from PIL import Image

    before = (pv.OFF_SCREEN, pv.global_theme.to_dict(), dict(os.environ))
    path = plot.save_scene(tmp_path / "scene.png", make_cube().values, faults=None, size=(320, 200))
    with Image.open(path) as image:
        assert image.size == (320, 200)
    assert (pv.OFF_SCREEN, pv.global_theme.to_dict(), dict(os.environ)) == before


def test_a_scene_is_refused_before_it_is_drawn_and_never_half_written(tmp_path: Path, monkeypatch) -> None:
    from PIL import Image

    drawn = []
    monkeypatch.setattr(rendering, "render_scene", lambda *_, **__: drawn.append(1) or np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(ParameterError, match=r"ends in '\.jpg'; expected \.png"):
        plot.save_scene(tmp_path / "a.jpg", make_cube())
    assert not drawn

    def fail(_image, file, **_):
        file.write_bytes(b"half")
        raise OSError(28, "no room")

    plot.save_scene(tmp_path / "a.png", make_cube())
    held = (tmp_path / "a.png").read_bytes()
    monkeypatch.setattr(Image.Image, "save", fail)
    with pytest.raises(FileAccessError, match=r"a\.png cannot be written: no room"):
        plot.save_scene(tmp_path / "a.png", make_cube())
    assert [file.name for file in tmp_path.iterdir()] == ["a.png"]
    assert (tmp_path / "a.png").read_bytes() == held


def test_scene_is_not_mirrored_and_samples_go_down() -> None:
    cube = make_cube()
    frame = SceneFrame.from_cube(cube, height=0.6)
    assert frame.order == (1, 0)  # crosslines clockwise of inlines on the map: to the right, inlines to the back
    origin, inline, crossline, sample = frame.place(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]))
    assert crossline[0] > origin[0]
    assert inline[1] > origin[1]
    assert sample[2] < origin[2]
    assert inline[1] == pytest.approx(2 * crossline[0])  # bins of 25 and 12.5 m
    mirrored = cube.assign_coords(cdp_x=-cube.cdp_x)
    assert SceneFrame.from_cube(mirrored, height=0.6).order == (0, 1)
    assert frame.axis_ranges(cube) == [500, 539, 100, 158, 1196, 1000]
    assert frame.bounds[5] - frame.bounds[4] == pytest.approx(0.6)


def test_walls_avoid_lines_without_data() -> None:
    cube = make_cube()
    live = cube["live"].values.copy()
    live[-2:] = False
    assert far_slices(cube.assign_coords(live=(("inline", "crossline"), live))) == (27, 39, 49)


def test_cells_of_a_map_with_holes() -> None:
    depth = np.zeros((3, 4))
    depth[0, 0] = np.nan
    points, cells = grid_cells(depth)
    assert len(points) == 12
    assert len(cells) == 5  # one of six squares has the hole for a corner


def test_sketch_needs_no_renderer() -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    cube = make_cube()
    figure = sketch_scene(cube, faults=make_faults(cube))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3]
    inside = image[:, : int(0.75 * image.shape[1])]  # without the colour bar
    assert coloured(inside) > 5000


def test_machine_without_a_renderer_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "find_windowless", lambda: ("", "a test scene ended with code -11"))
    with pytest.raises(RenderError, match=r"code -11.*libosmesa6"):
        plot.cube(make_cube(), off_screen=True)
    assert "VTK_DEFAULT_OPENGL_WINDOW" not in os.environ


def test_probe_reports_a_crash(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "_PROBE", "import os; os.abort()")
    assert "ended with code -6" in rendering._try_window("")
    monkeypatch.setattr(rendering, "_PROBE", "raise SystemExit(0)")
    assert rendering._try_window("") == ""


def test_section_is_refused() -> None:
    with pytest.raises(ShapeError, match=r"Use plot\.section"):
        plot.cube(make_section()[0])


def test_import_of_plot_is_light() -> None:
    code = (
        "import sys, seismo3d.plot; print([m for m in ('matplotlib', 'pyvista', 'vtk', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
