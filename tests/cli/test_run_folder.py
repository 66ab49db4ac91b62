from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from fake_faults import make_cube, make_faults

from seismo3d.cli import _run
from seismo3d.cli._run_folder import check_run_folder
from seismo3d.errors import FileAccessError


def run(*words: object) -> int:
    return _run([str(word) for word in words], debug=False)


def make_run(folder: Path, record: str, *names: str) -> Path:
    folder.mkdir(parents=True)
    for name in names:
        (folder / name).write_text("x")
    (folder / "run.json").write_text(record)
    return folder


@pytest.fixture
def faults(tmp_path: Path) -> Path:
    out = tmp_path / "faults"
    make_faults(make_cube()).save(out)
    (out / "run.json").write_text('{"command": "faults"}')
    return out


def names_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def test_tracks_do_not_replace_the_faults_that_they_read(faults: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(faults.parent / "cube.npy", np.zeros((8, 8, 30), np.float32))
    before = names_in(faults)
    words = ("tracks", faults.parent / "cube.npy", "--faults", faults, "--overwrite", "-o")
    assert run(*words, faults) == 2
    assert "is or holds the input" in capsys.readouterr().err
    assert names_in(faults) == before
    # neither by another name
    (faults.parent / "link").symlink_to(faults)
    words = ("tracks", faults.parent / "cube.npy", "--faults", faults.parent / "link", "--overwrite", "-o")
    assert run(*words, faults) == 2
    assert names_in(faults) == before


def test_network_and_score_do_not_replace_what_they_read(faults: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("network", "score"):
        picks = make_run(faults.parent / command, json.dumps({"command": command}), "top.xyz")
        reads = ("--from", picks / "top.xyz", "--to", "130,510,1020") if command == "network" else (picks / "top.xyz",)
        assert run(command, faults, *reads, "-o", picks, "--overwrite") == 2
        assert "top.xyz: it is not replaced" in capsys.readouterr().err
        assert names_in(picks) == {"top.xyz", "run.json"}
        out = ("--from", "1,2,3", "--to", "3,2,1") if command == "network" else ("picks.txt",)
        assert run(command, faults, *out, "-o", faults, "--overwrite") == 2
        assert "is or holds the input" in capsys.readouterr().err


def test_links_inside_the_folder_are_inputs_in_it(tmp_path: Path) -> None:
    folder = make_run(tmp_path / "run", '{"command": "faults"}')
    (tmp_path / "cube.sgy").write_text("x")
    (folder / "cube.sgy").symlink_to(tmp_path / "cube.sgy")
    with pytest.raises(FileAccessError, match="holds the input"):
        check_run_folder(folder, command="faults", inputs=[folder / "cube.sgy"], overwrite=True)
    check_run_folder(folder, command="faults", inputs=[tmp_path / "cube.sgy"], overwrite=True)


@pytest.mark.parametrize(
    ("record", "names", "made_by"),
    [
        ('{"command": "faults"}', (), "faults"),
        ("{}", ("faultset.npz",), "faults"),
        ('{"input": {}}', ("tracks.csv",), "tracks"),
        ("{}", ("faultset.npz", "tracks.csv", "network.graphml"), "paper f3"),
        ("{}", ("faultset.npz", "tracks.csv"), "faults"),  # tracks that the viewer saved beside the faults
    ],
)
def test_only_runs_of_the_same_command_are_replaced(
    tmp_path: Path, record: str, names: tuple[str, ...], made_by: str
) -> None:
    folder = make_run(tmp_path / "run", record, *names)
    check_run_folder(folder, command=made_by, inputs=[], overwrite=True)
    with pytest.raises(FileAccessError, match=f"holds a run of seismo3d {made_by}; seismo3d network replaces"):
        check_run_folder(folder, command="network", inputs=[], overwrite=True)


@pytest.mark.parametrize("record", ["{}", "[1]", "no JSON", '{"command": 3}'])
def test_records_of_other_programs_do_not_make_a_run(tmp_path: Path, record: str) -> None:
    folder = make_run(tmp_path / "run", record, "thesis.txt")
    with pytest.raises(FileAccessError, match="no known command"):
        check_run_folder(folder, command="tracks", inputs=[], overwrite=True)


def test_f3_replaces_only_runs_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = make_run(tmp_path / "f3", '{"command": "faults"}')
    np.save(tmp_path / "cube.npy", np.zeros((8, 8, 30), np.float32))
    assert run("paper", "f3", tmp_path / "cube.npy", "-o", folder, "--overwrite") == 2
    assert "holds a run of seismo3d faults" in capsys.readouterr().err
    assert run("paper", "table2", "--overwrite") == 2
    assert "it serves f3" in capsys.readouterr().err
