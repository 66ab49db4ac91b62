from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from fake_faults import make_cube, make_faults

from seismo3d.cli import _run
from seismo3d.seismic.exports import write_faults

FILES = {
    "network.graphml", "network_faults.csv", "intersections.csv", "zones.csv", "sets.csv", "density.csv", "map.png",
    "density.png", "stereonet.png", "rose.png", "report.html", "run.json",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A faults run."""
    cube = make_cube()
    faults = make_faults(cube)
    out = tmp_path / "faults"
    faults.save(out)
    write_faults(faults, cube, directory=out)
    (out / "run.json").write_text("{}")
    return out


def run(*words: object) -> int:
    return _run([str(word) for word in words], debug=False)


def test_network_is_written_beside_the_faults(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("network", folder) == 0
    assert {path.name for path in (folder / "network").iterdir()} == FILES
    said = capsys.readouterr().out
    assert said.splitlines()[0].startswith("2 faults in 1 connected zone; 1 intersection (1 cross")
    record = json.loads((folder / "network" / "run.json").read_text())
    assert record["network"]["intersections"] == 1
    assert record["input"]["file"] == "faultset.npz"
    assert run("network", folder) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert run("network", folder, "--overwrite", "--cell", "8") == 0
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    page = (folder / "network" / "report.html").read_text()
    assert page.count("data:image/png;base64") == 4
    assert "Connected zones" in page
    assert "http://" not in page.replace("http://www.w3.org", "")


def test_flow_path_from_a_point_to_a_horizon(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cube = make_cube()
    x, y = cube["cdp_x"].values.ravel(), cube["cdp_y"].values.ravel()
    np.savetxt(tmp_path / "foot.xyz", np.column_stack([x, y, np.full(x.size, 1180.0)]), fmt="%.3f")
    words = ("--from", "130,510,1020", "--to", tmp_path / "foot.xyz")
    assert run("network", folder, "-o", tmp_path / "out", *words, "--json") == 0
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert said.err.splitlines()[-1].startswith("time ")
    path = np.loadtxt(tmp_path / "out" / "flow_path.csv", delimiter=",", skiprows=1)
    assert path[0, 2] == 1020.0
    assert path[-1, 2] == 1180.0
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert set(record["flow_path"]["surfaces"]) <= {1, 2}
    assert record["flow_path"]["straight"] > 1.0
    assert (told["flow_path"], told["network"]) == (record["flow_path"], record["network"])
    assert (tmp_path / "out" / "flow_path.png").stat().st_size > 5000


def test_flow_path_between_horizons_of_many_columns(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cube = make_cube()
    x, y = cube["cdp_x"].values.ravel(), cube["cdp_y"].values.ravel()
    for name, depth in (("head", 1020.0), ("foot", 1180.0)):
        table = np.column_stack([np.arange(x.size), np.arange(x.size), x, y, np.full(x.size, depth)])
        np.savetxt(tmp_path / f"{name}.xyz", table, fmt="%.3f")
    words = ("--from", tmp_path / "head.xyz", "--to", tmp_path / "foot.xyz", "-o", tmp_path / "out")
    assert run("network", folder, *words) == 2
    assert "which of the 5 these are" in capsys.readouterr().err
    assert run("network", folder, *words, "--columns", "3,4,5") == 0
    path = np.loadtxt(tmp_path / "out" / "flow_path.csv", delimiter=",", skiprows=1)
    assert (path[0, 2], path[-1, 2]) == (1020.0, 1180.0)
    assert json.loads((tmp_path / "out" / "run.json").read_text())["options"]["columns"] == "3,4,5"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--columns", "1,2,3"), "without a horizon's file"),
        (("--columns", "1,2,3", "--from", "130,510,1020", "--to", "130,510,1180"), "without a horizon's file"),
        (("--columns", "1,b"), "--columns is '1,b'"),
        (("--from", "1,2,3"), "Give both or neither"),
        (("--from", "1,2", "--to", "1,2,3"), "expected INLINE,CROSSLINE,TIME"),
        (("--from", "no.xyz", "--to", "1,2,3"), "does not exist"),
        (("--from", "1,2,3", "--to", "130,510,1020"), "lies outside the cube"),
        (("--set-angle", "120"), "set-angle"),
        (("--contrast", "0.5"), "contrast"),
    ],
)
def test_bad_input_leaves_nothing(
    folder: Path, words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("network", folder, *words) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "network").exists()


def test_folder_without_faults_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("network", tmp_path) == 2
    assert "Give the folder of a faults run" in capsys.readouterr().err
    assert run("score", tmp_path, "x.txt") == 2
    assert "neither faults nor tracks" in capsys.readouterr().err


def test_sticks_are_scored(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (folder / "sticks_opendtect.txt").read_text().splitlines()
    picks = folder.parent / "picks.txt"
    picks.write_text("\n".join(line for line in lines if line.startswith("fault_001")) + "\n")
    assert run("score", folder, picks) == 0
    said = capsys.readouterr().out
    assert "fault_001" in said
    assert "missed 0 of 1; new: 2" in said
    assert {path.name for path in (folder / "score").iterdir()} == {"score.json", "score_01.png", "run.json"}
    (score,) = json.loads((folder / "score" / "score.json").read_text())["scores"]
    assert score["new"] == [2]
    assert score["within"] == 1.0
    assert run("score", folder, picks, "--json", "--overwrite", "--tolerance", "2") == 0
    assert json.loads(capsys.readouterr().out.rsplit("}", 1)[0] + "}")["scores"][0]["tolerance"] == 2.0
    picks.write_text(picks.read_text() + "far 1 2 3 1 1\nfar 1 2 9 1 2\n")
    assert run("score", folder, picks, "--overwrite") == 0
    assert re.search(r"not counted: \d+\.\d % of the nodes lie outside the cube, all of far\n", capsys.readouterr().out)
    assert json.loads((folder / "score" / "score.json").read_text())["scores"][0]["elsewhere"] == ["far"]
    picks.write_text("F1 1 2 3 1 1\nF1 1 2 3 1 one\n")
    assert run("score", folder, picks, "--overwrite") == 2
    assert "line 2" in capsys.readouterr().err
    assert run("score", folder, picks, "--columns", "1,2,3", "--overwrite") == 2
    assert "for XYZ horizons" in capsys.readouterr().err


def test_horizons_are_scored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "tracks"
    folder.mkdir()
    rows = [f"INLINE : {i} XLINE : {j} {25 * i} {10 * j} {800 + i + j}" for i in range(8) for j in range(9)]
    (folder / "track_01.charisma.txt").write_text("\n".join(rows) + "\n")
    (folder / "tracks.csv").write_text("track,unit\n1,ms\n")
    (folder / "run.json").write_text("{}")
    picks = tmp_path / "top.xyz"
    picks.write_text("\n".join(f"{i} {j} {25 * i} {10 * j} {801 + i + j}" for i in range(8) for j in range(12)) + "\n")
    assert run("score", folder, picks) == 2
    assert "columns" in capsys.readouterr().err
    assert run("score", folder, picks, "--columns", "3,4,5") == 0
    said = capsys.readouterr().out
    assert "track_01  median 1.00  90 % 1.00 ms  within 4: 100 %  missed 25 % of 96 picks  new at 0 places" in said
    (score,) = json.loads((folder / "score" / "score.json").read_text())["scores"]
    assert score["bias"] == -1.0


def test_picks_between_the_traces_meet_the_nearest_one(tmp_path: Path) -> None:
    folder = tmp_path / "tracks"
    folder.mkdir()
    # inlines of steps of 2, 25 x 12.5 m, on a map turned by 33 degrees, every other inline traced
    c, s = np.cos(np.radians(33.0)), np.sin(np.radians(33.0))
    i, j = (a.ravel() for a in np.meshgrid(np.arange(30), np.arange(40), indexing="ij"))
    x, y = 4.5e5 + 25.0 * i * s + 12.5 * j * c, 6.7e6 + 25.0 * i * c - 12.5 * j * s
    rows = [
        f"INLINE : {900 - 2 * a} XLINE : {1300 + 3 * b} {e:.2f} {n:.2f} {800 + a}"
        for a, b, e, n in zip(i, j, x, y, strict=True)
        if a % 2 == 0
    ]
    (folder / "track_01.charisma.txt").write_text("\n".join(rows) + "\n")
    (folder / "tracks.csv").write_text("track,unit\n1,ms\n")
    fit = {"origin": [4.5e5, 6.7e6], "inline_step": [25 * s, 25 * c], "crossline_step": [12.5 * c, -12.5 * s]}
    axes = {"inline": [900, -2, 30], "crossline": [1300, 3, 40], "sample": [0, 4, 500]}
    # a grid of its own, 20 m from north to south
    a, b = (v.ravel() for v in np.meshgrid(np.arange(x.min(), x.max(), 20.0), np.arange(y.min(), y.max(), 20.0)))
    u, v = ((a - 4.5e5) * s + (b - 6.7e6) * c) / 25.0, ((a - 4.5e5) * c - (b - 6.7e6) * s) / 12.5
    inside = (np.rint(u) >= 0) & (np.rint(u) < 30) & (np.rint(v) >= 0) & (np.rint(v) < 40)
    picks = tmp_path / "top.xyz"
    picks.write_text("".join(f"{p:.2f} {q:.2f} {803 + r:.3f}\n" for p, q, r in zip(a, b, u, strict=True)))
    traced = inside & (np.rint(u) % 2 == 0)
    for rms, missed in ((0.0, 1.0 - traced.mean()), (9.0, None)):
        record = {
            "extent": [-2, 1998],
            "survey": {**axes, "unit": "ms", "length_unit": "m", "map": {**fit, "rms": rms}},
        }
        (folder / "run.json").write_text(json.dumps(record))
        assert run("score", folder, picks, "--overwrite") == 0
        (score,) = json.loads((folder / "score" / "score.json").read_text())["scores"]
        if missed is None:
            # traces off their map are met by x and y alone
            assert score["missed"] > 0.97
        else:
            assert score["missed"] == pytest.approx(missed, abs=1e-9)
            assert score["bias"] == pytest.approx(-3.0, abs=0.1)
