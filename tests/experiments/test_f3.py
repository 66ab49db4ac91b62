from __future__ import annotations

import json
from pathlib import Path

import pytest

from seismo3d.cli import _run
from seismo3d.io.segy import write_segy
from seismo3d.synthetic import CubeRecipe, SyntheticFault, fault_section, make_cube


def run(*words: object) -> int:
    return _run([str(word) for word in words], debug=False)


def test_faulted_cube_gets_everything_and_one_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fault = SyntheticFault((24, 24, 32), 20.0, 65.0, 9.0)
    recipe = CubeRecipe(shape=(48, 48, 64), wavelength=(12.0, 12.0), population=None, faults=(fault,))
    write_segy(tmp_path / "block.sgy", make_cube(recipe, seed=2021).to_dataarray())
    out = tmp_path / "out"
    assert run("paper", "f3", tmp_path / "block.sgy", "-o", out) == 0
    record = json.loads((out / "run.json").read_text())
    assert record["found"]["faults"] >= 1
    assert 5.0 < record["found"]["throw_median_samples"] < 13.0
    assert record["found"]["horizons"] >= 1
    names = {path.name for path in out.iterdir()}
    assert {"faults.csv", "faultset.npz", "tracks.csv", "network.graphml", "stereonet.png", "report.html"} <= names
    assert len([name for name in names if name.startswith("unfaulted_")]) == 2
    page = (out / "report.html").read_text()
    for heading in ("Faults", "Tracks", "Connected zones", "Sets"):
        assert f"<h2>{heading}</h2>" in page
    said, took = capsys.readouterr()
    assert str(out / "report.html") in said
    assert took.splitlines()[-1].startswith("time ")
    assert run("paper", "f3", tmp_path / "block.sgy", "-o", out) == 2
    assert "replace it with --overwrite" in capsys.readouterr().err
    (out / "mine.txt").write_text("of nobody's run")
    assert run("paper", "f3", tmp_path / "block.sgy", "-o", out, "--overwrite") == 2
    assert "holds mine.txt, which no run there wrote" in capsys.readouterr().err
    (out / "mine.txt").unlink()
    (out / "network.graphml").write_text("of the earlier run")
    assert run("paper", "f3", tmp_path / "block.sgy", "--out", out, "--overwrite", "--json") == 0
    assert json.loads(capsys.readouterr().out)["found"] == record["found"]
    assert (out / "network.graphml").read_text() != "of the earlier run"
    assert json.loads((out / "run.json").read_text())["command"] == "paper f3"


def test_what_f3_does_not_take_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("paper", "f3") == 2
    assert "f3 is given no cube" in capsys.readouterr().err
    assert run("paper", "f3", "x.sgy", "--images", "3") == 2
    assert "--images" in capsys.readouterr().err
    assert run("paper", "table2", "--json") == 2
    assert "--json is given with table2; it serves f3" in capsys.readouterr().err
    write_segy(tmp_path / "line.sgy", fault_section("clean", seed=2022, shape=(16, 40, 64)).to_dataarray())
    assert run("paper", "f3", tmp_path / "line.sgy", "-o", tmp_path / "out") == 2
    assert "not a 2D line" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_small_piece_of_the_f3_block(real_data: Path, tmp_path: Path) -> None:
    out = tmp_path / "f3"
    assert run("paper", "f3", real_data / "seismic" / "segy" / "F3_very_small.sgy", "-o", out) == 0
    assert (out / "report.html").stat().st_size > 20_000
    found = json.loads((out / "run.json").read_text())["found"]
    assert found["horizons"] >= 3
    assert found["horizon_share_mean"] > 0.8
