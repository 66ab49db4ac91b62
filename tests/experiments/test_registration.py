"""The registration experiments on small problems: their answers are known beforehand."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from seismo3d.cli.app import app
from seismo3d.errors import FileAccessError
from seismo3d.experiments import registration_degenerate, registration_solves, registration_table
from seismo3d.experiments.matching_tables import TABLES
from seismo3d.experiments.registration import main
from seismo3d.experiments.registration_covariance import repeat_scans
from seismo3d.experiments.registration_table import accuracy, draw_figure, format_table, make_table, mean_square_error
from seismo3d.experiments.rotated_frames import draw_room, read_frames, rotate_frame


@pytest.fixture(scope="module")
def room():
    return draw_room(size=(180, 240))


def test_rotated_frames_fit_under_the_true_rotation(room, rng):
    pair = rotate_frame(room, 30.0, rng)
    assert accuracy(pair.T_target_source, pair) == 1.0
    assert mean_square_error(np.eye(4), pair) > 0.05
    from scipy.spatial import cKDTree

    near, _ = cKDTree(pair.target.points).query(pair.source.points[::50] @ pair.T_target_source[:3, :3].T)
    assert np.median(near) < 0.02  # a pixel is about 1 cm wide
    assert (near > 0.1).mean() > 0.05  # the frames overlap in part only


def test_fusion_wins_at_every_angle(room, tmp_path):
    table = make_table([room], angles_deg=(10, 75), figure_angle_deg=10)
    assert table.accuracy["fusion, by variance"] == [100.0, 100.0]
    for method in ("Fast ICP", "ICP, point to point", "ICP, point to plane"):
        assert table.accuracy[method][1] < 50.0
    curve = table.errors["fusion, by variance"][0]
    assert curve[-1] < 1e-4 < curve[0]
    assert draw_figure(table, tmp_path / "figure3.png").stat().st_size > 10_000
    assert len(format_table(table).splitlines()) == 1 + len(table.accuracy)


def test_solves_are_global_and_certified():
    figures = registration_solves.measure("few pairs", "rigid", n_problems=40)
    assert figures.global_share == 1.0
    assert figures.certified_share == 1.0
    assert registration_solves.measure("generic", "scaled", n_problems=4).global_share == 1.0


def test_scaled_is_not_observable_from_seven_planes():
    assert registration_solves.measure("few pairs", "scaled", n_problems=3).observable_share == 0.0


@pytest.mark.parametrize(("scene", "n_unseen"), [("plane", 3.0), ("corridor", 1.0), ("layers", 3.0)])
def test_degenerate_scenes_say_so_and_features_settle_them(scene, n_unseen):
    figures = registration_degenerate.run_scene(scene, n_repeats=3)
    assert figures.n_unobservable == pytest.approx(n_unseen, abs=0.4)
    assert figures.displacement["fused"] < 0.1 * figures.displacement["planes"]
    assert figures.displacement["fused"] < figures.displacement["features"]


def test_main_prints_the_parts_that_are_asked_for(capsys):
    main(["degenerate", "--n", "40"])
    assert "corridor" in capsys.readouterr().out


def test_paper_command_prints_the_table(room, tmp_path, monkeypatch):
    monkeypatch.setattr(registration_table, "load_frames", lambda _, *, n_frames: [room] * n_frames)
    done = CliRunner().invoke(app, ["paper", "table1", "--frames", "1", "--angles", "20", "-o", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "fusion, by variance" in done.stdout
    assert (tmp_path / "figure3.png").exists()
    refused = CliRunner().invoke(app, ["paper", "table9"])
    assert "table1, figure3" in str(refused.exception)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("table1", "--images", "2"), "--images is '2'; expected none with table1"),
        (("table2", "--frames", "2"), "--frames is '2'; expected none with table2"),
        (("table3", "somewhere"), "data is 'somewhere'; expected none with table3"),
        (("figure3", "--angles", "5"), "--angles is '5'; expected none with figure3"),
        (("table1", "--angles", "5,ten"), "--angles is '5,ten'; expected whole degrees"),
    ],
)
def test_paper_command_refuses_options_that_the_experiment_does_not_use(words, message):
    refused = CliRunner().invoke(app, ["paper", *words])
    assert message in str(refused.exception)


def test_paper_command_writes_a_table_of_matching(tmp_path, monkeypatch):
    monkeypatch.setitem(TABLES, "table4", lambda *, n_images, **_: f"Table 4 of {n_images} images")
    done = CliRunner().invoke(app, ["paper", "table4", "--images", "3", "-o", str(tmp_path / "new")])
    assert done.exit_code == 0, done.output
    assert done.stdout == "Table 4 of 3 images\n\n"
    assert (tmp_path / "new" / "table4.txt").read_text() == "Table 4 of 3 images\n"


def test_a_folder_that_is_no_sequence_is_refused(tmp_path):
    with pytest.raises(FileAccessError, match="no sequence"):
        read_frames(tmp_path, n_frames=1)


@pytest.mark.parametrize("shape", ["hill", "corner", "ellipsoid"])
def test_covariance_of_whole_registrations_is_honest(shape):
    error = repeat_scans(shape, n_points=5000, noise=0.003, n_repeats=30)
    assert error == pytest.approx(1.0, abs=0.35)  # 30 repeats of 6 degrees of freedom: standard error 0.1
