from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from seismo3d.cli import _run
from seismo3d.cli.map import _facts, _states
from seismo3d.graph.poses import read_g2o
from seismo3d.io.elevation import read_elevation
from seismo3d.io.points import read_points
from seismo3d.robot import Mapper, MapperSettings, Occupancy, read_sequence
from seismo3d.synthetic.rgbd import rgbd_sequence


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rgbd") / "room"
    made = rgbd_sequence("room", frames=16, size=(160, 120), period=10.0, seed=3).write(folder)
    camera = json.loads((made / "camera.json").read_text())
    (made / "camera.json").write_text(json.dumps({**camera, "readout": 0.0, "depth_delay": 0.0}))
    return made


def test_run_writes_all_that_it_says(sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert _run(["map", str(sequence), "-o", str(out), "--voxel-size", "0.02"], debug=True) == 0
    assert "located" in capsys.readouterr().out
    names = {path.name for path in out.iterdir()}
    assert names == {
        "trajectory.txt", "states.csv", "mesh.ply", "graph.g2o", "occupancy.npz", "elevation.tif", "map.npz",
        "trajectory.png", "occupancy.png", "map.png", "report.html", "run.json",
    }  # fmt: skip
    found, truth = np.loadtxt(out / "trajectory.txt"), np.loadtxt(sequence / "groundtruth.txt")
    np.testing.assert_allclose(found[:, 0], truth[:, 0], atol=1e-5)  # stamps of colour
    np.testing.assert_allclose(found[0, 1:], [0, 0, 0, 0, 0, 0, 1], atol=1e-9)  # the world is the first camera
    steps = np.linalg.norm(np.diff(truth[:, 1:4], axis=0), axis=1).sum()
    assert np.linalg.norm(found[-1, 1:4]) == pytest.approx(np.linalg.norm(truth[-1, 1:4] - truth[0, 1:4]), abs=0.01)
    record = json.loads((out / "run.json").read_text())
    assert record["located"] == record["frames"] == 16
    assert record["input"]["sha256"]
    assert record["options"]["close_loops"] is True
    assert record["path_m"] == pytest.approx(steps, abs=0.03)
    assert len(read_g2o(out / "graph.g2o").poses) == record["keyframes"]
    assert (Occupancy.load(out / "occupancy.npz").cells != 2).any()
    assert np.isfinite(read_elevation(out / "elevation.tif").values).any()
    assert len(Mapper.load(out / "map.npz").trajectory) == 16
    assert "://" not in (out / "report.html").read_text()
    header = (out / "mesh.ply").read_bytes()[:200].decode("ascii", errors="replace")
    assert "element vertex" in header


def test_frames_of_a_local_map_that_was_given_up_are_dropped(tmp_path: Path, rng: np.random.Generator) -> None:
    import cv2

    folder = rgbd_sequence("room", frames=76, size=(160, 120), period=40.0, seed=2).write(tmp_path / "in")
    camera = json.loads((folder / "camera.json").read_text())
    (folder / "camera.json").write_text(json.dumps({**camera, "readout": 0.0, "depth_delay": 0.0}))
    for path in sorted((folder / "rgb").iterdir())[12:]:
        cv2.imwrite(str(path), np.zeros((120, 160, 3), np.uint8))
    for path in sorted((folder / "depth").iterdir())[12:]:  # no frame shows what another one does
        hills = cv2.resize(rng.uniform(4000, 15000, (6, 8)), (160, 120), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(path), hills.astype(np.uint16))
    opened = read_sequence(folder)
    mapper = Mapper(opened.camera, settings=MapperSettings(voxel_size=0.02))
    found = [mapper.add(frame) for frame in opened]
    states, facts = _states(mapper, found), _facts(mapper, opened, found, None)
    assert facts["located"] == len(mapper.trajectory) == sum(local_map is not None for _, local_map in states)
    assert facts["dropped"] == [state for state, _ in states].count("dropped") > 0
    assert sum(facts[name] for name in ("located", "lost", "empty", "dropped")) == facts["frames"] == 76


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        ("camera", "has no camera.json"),
        ("list", "none within"),
        ("depth", "no frame of"),
        ("far", "2 frames, 1 of them located"),
    ],
)
def test_bad_sequences_end_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], spoil: str, words: str
) -> None:
    import cv2

    folder = rgbd_sequence("room", frames=2, size=(64, 48)).write(tmp_path / "in")
    camera = json.loads((folder / "camera.json").read_text())
    (folder / "camera.json").write_text(json.dumps({**camera, "readout": 0.0, "depth_delay": 0.0}))
    if spoil == "camera":
        (folder / "camera.json").unlink()
    elif spoil == "list":
        (folder / "associations.txt").unlink()
        lines = (folder / "depth.txt").read_text().splitlines()
        (folder / "depth.txt").write_text("\n".join(f"{float(r.split()[0]) + 9} {r.split()[1]}" for r in lines[1:]))
    elif spoil == "far":  # seen once, from afar: too little to be sure of
        first, second = sorted((folder / "depth").iterdir())
        cv2.imwrite(str(first), np.full((48, 64), 3.5 * 5000, np.uint16))
        cv2.imwrite(str(second), np.zeros((48, 64), np.uint16))
    else:
        for path in (folder / "depth").iterdir():
            cv2.imwrite(str(path), np.zeros((48, 64), np.uint16))
    assert _run(["map", str(folder), "-o", str(tmp_path / "out")], debug=False) == 2
    error = capsys.readouterr().err.strip()
    assert words in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_cell_without_a_side_is_refused_before_any_frame_is_read(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Mapper, "add", None)
    assert _run(["map", str(sequence), "-o", str(tmp_path / "out"), "--cell", "0"], debug=False) == 2
    assert "cell is 0" in capsys.readouterr().err


def test_an_up_that_is_no_direction_is_refused_before_any_frame_is_read(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run(["map", str(sequence), "-o", str(tmp_path / "out"), "--up", "0,-1"], debug=False) == 2
    assert "expected three numbers" in capsys.readouterr().err


def test_cells_too_many_to_hold_are_refused_by_their_side(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["map", str(sequence), "-o", str(tmp_path / "out"), "--cell", "1e-6", "--voxel-size", "0.05"]
    assert _run(words, debug=False) == 2
    assert "Choose a larger cell" in capsys.readouterr().err


def test_a_map_begun_by_the_last_frame_does_not_take_the_others_away(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    """Strange hills, each seen once and from afar, at the end of a walk: the new map of the last one has no surface."""
    import cv2

    n_seen, n_strange = 8, MapperSettings().new_map_after
    made = rgbd_sequence("room", frames=n_seen + n_strange, size=(160, 120), period=40.0, seed=2)
    folder = made.write(tmp_path / "in")
    camera = json.loads((folder / "camera.json").read_text())
    (folder / "camera.json").write_text(json.dumps({**camera, "readout": 0.0, "depth_delay": 0.0}))
    for path in sorted((folder / "rgb").iterdir())[n_seen:]:
        cv2.imwrite(str(path), np.zeros((120, 160, 3), np.uint8))
    for path in sorted((folder / "depth").iterdir())[n_seen:]:
        hills = cv2.resize(rng.uniform(15000, 19000, (6, 8)), (160, 120), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(path), hills.astype(np.uint16))
    out = tmp_path / "out"
    assert _run(["map", str(folder), "-o", str(out), "--voxel-size", "0.02", "--json"], debug=True) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["located"], said["local_maps"], said["shown_map"]) == (n_seen + 1, 2, 0)
    assert Mapper.load(out / "map.npz").state.number == 1
    assert len(read_points(out / "mesh.ply").points) > 1000
