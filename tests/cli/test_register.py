"""seismo3d register, run as a user runs it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import ndimage
from typer.testing import CliRunner

from seismo3d.cli import main
from seismo3d.cli.app import app
from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.io.elevation import make_elevation, write_elevation
from seismo3d.io.points import read_points, write_points


@pytest.fixture
def files(tmp_path, rng):
    u, v = rng.uniform(-1, 1, size=(2, 3000))
    hill = np.column_stack([u, v, 0.3 * np.sin(4 * u) * np.cos(3 * v)])
    T = make_transform(exp_rotation([0.0, 0.1, 0.2]), [0.1, 0.0, 0.05])
    target = write_points(tmp_path / "target.ply", transform_points(T, hill))
    source = write_points(tmp_path / "source.xyz", hill)
    return target, source, T


def test_prints_the_matrix_and_writes_the_moved_scan(files, tmp_path):
    target, source, T = files
    done = CliRunner().invoke(app, ["register", str(target), str(source), "-o", str(tmp_path / "moved.ply")])
    assert done.exit_code == 0, done.output
    rows = [line for line in done.stdout.splitlines() if not line.startswith("#")]
    np.testing.assert_allclose(np.array([row.split() for row in rows], dtype=float), T, atol=1e-6)
    np.testing.assert_allclose(read_points(tmp_path / "moved.ply").points, read_points(target).points, atol=1e-5)


def test_json_is_valid_and_whole(files):
    target, source, T = files
    done = CliRunner().invoke(app, ["register", str(target), str(source), "--json", "--model", "similarity"])
    answer = json.loads(done.stdout)
    np.testing.assert_allclose(answer["T_target_source"], T, atol=1e-6)
    assert answer["state"] == "converged"
    assert answer["certificate"] is None


def test_bad_input_is_one_line_and_exit_code_2(files, tmp_path, capsys):
    target, _, _ = files
    broken = tmp_path / "broken.ply"
    broken.write_text("no header")
    with pytest.raises(SystemExit) as left:
        main(["register", str(target), str(broken)])
    assert left.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "PLY header" in lines[0]


def refused(capsys, *words):
    with pytest.raises(SystemExit) as left:
        main(["register", *map(str, words)])
    assert left.value.code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]


@pytest.fixture
def maps(tmp_path):
    rows, columns = np.mgrid[:20, :20]
    for name in ("a.npz", "b.npz"):
        np.savez(tmp_path / name, elevation=np.sin(rows / 3.0) + np.cos(columns / 4.0))
    return tmp_path / "a.npz", tmp_path / "b.npz"


def test_json_of_maps_that_do_not_meet_as_they_lie_is_valid(tmp_path, rng):
    """How far off they were before is not known: null, for JSON has no NaN."""
    hills = 20.0 * ndimage.gaussian_filter(rng.normal(size=(140, 140)), 3.0)
    unknown = np.full(hills.shape, np.nan)
    write_elevation(tmp_path / "target.npz", make_elevation(np.hstack([hills, unknown])))
    write_elevation(tmp_path / "source.npz", make_elevation(np.hstack([unknown, hills])))
    names = (str(tmp_path / "target.npz"), str(tmp_path / "source.npz"))
    done = CliRunner().invoke(app, ["register", *names, "--json"])
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout, parse_constant=pytest.fail)
    assert answer["nmad_before"] is None
    np.testing.assert_allclose(np.abs(answer["shift"]), [140.0, 0.0, 0.0], atol=0.01)


def test_outputs_are_refused_before_there_is_work(files, maps, tmp_path, capsys, monkeypatch):
    def fail(*_, **__):
        raise AssertionError("work was done")

    monkeypatch.setattr("seismo3d.registration.register.register", fail)
    monkeypatch.setattr("seismo3d.terrain.alignment.register", fail)
    target, source, T = files
    held = source.read_bytes()
    np.savetxt(tmp_path / "start.xyz", T)
    assert "ends in '.las'; expected .ply, .xyz or .npy" in refused(capsys, target, source, "-o", tmp_path / "m.las")
    assert "is an input too" in refused(capsys, target, source, "--out", source)
    with_start = (target, source, "--start", tmp_path / "start.xyz")
    assert "is an input too" in refused(capsys, *with_start, "--output", tmp_path / "start.xyz")
    assert "is not a folder" in refused(capsys, target, source, "-o", tmp_path / "none" / "m.ply")
    assert source.read_bytes() == held
    assert "expected .tif, .tiff, .asc or .npz" in refused(capsys, *maps, "-o", tmp_path / "m.ply")
    assert "is an input too" in refused(capsys, *maps, "-o", maps[1])


def test_a_map_and_points_are_no_pair(files, maps, capsys):
    said = "a.npz is an elevation map and source.xyz is none; expected two maps, or two point files"
    assert said in refused(capsys, maps[0], files[1])
    assert said in refused(capsys, files[1], maps[0])


def test_options_that_do_not_serve_the_input_are_refused(files, maps, capsys):
    for words in (("--start", "m.txt"), ("--stages", "local"), ("--voxel-size", "1.0")):
        said = refused(capsys, *maps, *words)
        assert f"{words[0]} is {words[1]!r}; expected none with two maps" in said
    assert "--vertical is 'tilt'; expected none with points" in refused(capsys, *files[:2], "--vertical", "tilt")
