from __future__ import annotations

import numpy as np
import pytest

from seismo3d.cli import main
from seismo3d.robot import Occupancy


def run(*words: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    return int(left.value.code or 0)


@pytest.fixture
def folder(tmp_path):
    cells = np.zeros((80, 80), np.uint8)
    cells[:, 40:42] = 1
    cells[50:62, 40:42] = 0
    Occupancy(cells, np.zeros((80, 80)), 0.05).save(tmp_path / "occupancy.npz")
    return tmp_path


def test_plan_writes_path_and_picture(folder, capsys):
    assert run("plan", folder, "--start", "0.8,0.8", "--goal", "3.2,0.8,-90", "--radius", 0.15) == 0
    said = capsys.readouterr().out
    assert "length" in said
    table = np.genfromtxt(folder / "path.csv", delimiter=",", names=True)
    assert np.hypot(table["x"][-1] - 3.2, table["y"][-1] - 0.8) < 1e-3
    assert np.cos(table["heading"][-1] + np.pi / 2) == pytest.approx(1.0, abs=1e-4)
    assert (folder / "path.png").stat().st_size > 5000
    out = folder / "new" / "run"
    assert (
        run("plan", folder / "occupancy.npz", "--start", "0.8,0.8", "--goal", "3.2,0.8", "--radius", 0.15, "-o", out)
        == 0
    )
    assert {path.name for path in out.iterdir()} == {"path.csv", "path.png"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--start", "0.8", "--goal", "3.2,0.8"], "start is '0.8'; expected X,Y"),
        (["--start", "0.8,east", "--goal", "3.2,0.8"], "start is '0.8,east'"),
        (
            ["--start", "0.8,0.8", "--goal", "2.02,0.8"],
            "goal (2.02, 0.8) is where the robot can't stand: it is occupied",
        ),
        (["--start", "0.8,0.8", "--goal", "7,0.8"], "lies outside the map"),
        (["--start", "0.8,0.8", "--goal", "3.2,0.8", "--radius", "0.4"], "there is no way from 0.8,0.8 to 3.2,0.8"),
        (["--start", "0.8,0.8", "--goal", "3.2,0.8", "--turning-radius", "0"], "turning-radius is 0"),
    ],
)
def test_bad_wishes_are_one_clear_line(folder, words, message, capsys):
    assert run("plan", folder, *words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert len(said.splitlines()) == 1
    assert not (folder / "path.csv").exists()
    assert run("plan", folder, *words, "-o", folder / "new") == 2
    assert not (folder / "new").exists()


def test_a_picture_that_cannot_be_written_leaves_the_old_one(folder, capsys, monkeypatch):
    from matplotlib.figure import Figure

    def fail(_figure, file, **_):
        file.write_bytes(b"half")
        raise OSError(28, "no room")

    monkeypatch.setattr(Figure, "savefig", fail)
    (folder / "path.png").write_bytes(b"old")
    assert run("plan", folder, "--start", "0.8,0.8", "--goal", "3.2,0.8", "--radius", 0.15) == 2
    assert "path.png cannot be written: no room" in capsys.readouterr().err
    assert (folder / "path.png").read_bytes() == b"old"
    assert {path.name for path in folder.iterdir()} == {"occupancy.npz", "path.png"}


def test_a_folder_without_a_map(tmp_path, capsys):
    assert run("plan", tmp_path, "--start", "0,0", "--goal", "1,1") == 2
    assert "occupancy.npz does not exist" in capsys.readouterr().err
