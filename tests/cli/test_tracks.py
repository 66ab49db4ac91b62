from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from seismo3d.cli import _run
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.io.cubes import open_cube
from seismo3d.io.segy import write_segy
from seismo3d.synthetic import SyntheticCube, make_cube, recipe_of


@pytest.fixture
def folded() -> SyntheticCube:
    recipe = recipe_of("folded", shape=(24, 28, 60), population=None, wavelength=(12.0, 12.0))
    return make_cube(recipe, seed=4)


def test_run_writes_tracks_in_map_coordinates(
    folded: SyntheticCube, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cube = folded.to_dataarray()
    write_segy(tmp_path / "cube.sgy", cube)
    truth = folded.horizons[2]
    seed = f"1012,2014,{600 + 4 * truth[12, 14]:.3f}"
    out = tmp_path / "out"
    assert _run(["tracks", str(tmp_path / "cube.sgy"), "--seed", seed, "-o", str(out)], debug=True) == 0
    assert str(out) in capsys.readouterr().out
    names = {path.name for path in out.iterdir()}
    assert names == {
        "track_01.xyz", "track_01.charisma.txt", "track_01.irap.txt", "track_01_map.png", "tracks_inline.png",
        "tracks_crossline.png", "tracks.csv", "loops.png", "report.html", "run.json",
    }  # fmt: skip
    rows = [line.split() for line in (out / "track_01.charisma.txt").read_text().splitlines()]
    assert rows[0][:2] == ["INLINE", ":"]
    assert rows[0][3] == "XLINE"
    table = np.array([[float(row[k]) for k in (2, 5, 6, 7, 8)] for row in rows])
    i, j = (table[:, 0] - 1001).astype(int), (table[:, 1] - 2001).astype(int)
    assert np.median(np.abs((table[:, 4] - 600) / 4 - truth[i, j])) < 0.5
    np.testing.assert_allclose(table[:, 2], cube["cdp_x"].values[i, j], atol=0.6)  # SEG-Y keeps them as integers
    points = np.loadtxt(out / "track_01.xyz")
    np.testing.assert_allclose(points, table[:, 2:], atol=0.01)
    check_irap(out / "track_01.irap.txt", table)
    with (out / "tracks.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["share_traced"]) == pytest.approx(len(rows) / (24 * 28), abs=1e-3)
    assert row["unit"] == "ms"
    record = json.loads((out / "run.json").read_text())
    assert record["survey"] == SurveyGeometry.from_cube(open_cube(tmp_path / "cube.sgy")).to_dict()
    # picks 2 ms below the track, a third of a bin beside its traces
    i_step, j_step = (np.array(record["survey"]["map"][name]) for name in ("inline_step", "crossline_step"))
    beside = np.append(0.3 * i_step - 0.3 * j_step, 2.0)
    np.savetxt(tmp_path / "top.xyz", points + beside, fmt="%.3f")
    assert _run(["score", str(out), str(tmp_path / "top.xyz")], debug=True) == 0
    (score,) = json.loads((out / "score" / "score.json").read_text())["scores"]
    assert (score["missed"], score["new"]) == (0.0, 0)
    assert score["bias"] == pytest.approx(-2.0, abs=1e-3)


def test_sheared_survey_gets_all_but_irap(
    folded: SyntheticCube, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cube = folded.to_dataarray()
    sheared = cube.assign_coords(cdp_x=cube["cdp_x"] + 0.25 * (cube["cdp_y"] - cube["cdp_y"][0, 0]))
    sheared.attrs.pop("survey", None)
    write_segy(tmp_path / "cube.sgy", sheared)
    seed = f"1012,2014,{600 + 4 * folded.horizons[2][12, 14]:.3f}"
    out = tmp_path / "out"
    assert _run(["tracks", str(tmp_path / "cube.sgy"), "--seed", seed, "-o", str(out)], debug=True) == 0
    assert "without IRAP grids: the survey has lines that do not meet at right angles" in capsys.readouterr().err
    assert {path.name for path in out.iterdir() if path.suffix in (".txt", ".xyz", ".csv")} == {
        "track_01.xyz", "track_01.charisma.txt", "tracks.csv",
    }  # fmt: skip
    # a row of the track lies where the sheared survey puts its trace
    words = (out / "track_01.charisma.txt").read_text().splitlines()[-1].split()
    i, j = int(words[2]) - 1001, int(words[5]) - 2001
    assert float(words[6]) == pytest.approx(float(sheared["cdp_x"].values[i, j]), abs=0.6)


def check_irap(path: Path, table: np.ndarray) -> None:
    """Rebuild the places of the grid's values from its header; they must be those of the table."""
    words = path.read_text().split()
    assert words[0] == "-996"
    m, dx, dy = int(words[1]), float(words[2]), float(words[3])
    n, angle, x0, y0 = int(words[8]), np.radians(float(words[9])), float(words[10]), float(words[11])
    values = np.array([float(word) for word in words[19:]])
    assert len(values) == n * m
    b, a = np.divmod(np.arange(n * m), n)
    x = x0 + a * dx * np.cos(angle) - b * dy * np.sin(angle)
    y = y0 + a * dx * np.sin(angle) + b * dy * np.cos(angle)
    known = values < 9e6
    found = np.column_stack([x, y, values])[known]
    order, wanted = np.lexsort(np.rint(found[:, :2].T)), np.lexsort(np.rint(table[:, 2:4].T))
    assert np.abs(np.sort(found[:, 2]) - np.sort(table[:, 4])).max() < 1e-3
    assert np.abs(found[order][:, :2].mean(axis=0) - table[wanted][:, 2:4].mean(axis=0)).max() < 1.0


def test_bad_seed_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "cube.npy", np.zeros((10, 10, 40), np.float32))
    assert _run(["tracks", str(tmp_path / "cube.npy"), "--seed", "1,2", "-o", str(tmp_path / "o")], debug=False) == 2
    assert "INLINE,CROSSLINE,TIME" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_json_has_a_row_a_track(folded: SyntheticCube, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_segy(tmp_path / "cube.sgy", folded.to_dataarray())
    words = ["tracks", str(tmp_path / "cube.sgy"), "--count", "2", "-o", str(tmp_path / "out"), "--json"]
    assert _run(words, debug=True) == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert [row["track"] for row in found["tracks"]] == [1, 2]
    assert {"dip", "shifts", "solve", "tracks", "export"} <= set(found["timings_s"])
    assert found["loops"]["side_traces"] == 4
    assert found["loops"]["n_loops"] > 1000
    assert 0.0 <= found["loops"]["median_error_samples"] < 0.5
    assert err.startswith("time     ")


def test_picked_horizon_is_followed(folded: SyntheticCube, tmp_path: Path) -> None:
    cube = folded.to_dataarray()
    write_segy(tmp_path / "cube.sgy", cube)
    truth = folded.horizons[2]
    i, j = (a.ravel() for a in np.meshgrid(range(0, 24, 6), range(0, 28, 6), indexing="ij"))
    z = 600 + 4 * truth[i, j]
    picks = [f"INLINE : {1001 + a} XLINE : {2001 + b} 0 0 {c:.3f}" for a, b, c in zip(i, j, z) if np.isfinite(c)]
    (tmp_path / "top.txt").write_text("\n".join(picks) + "\n")
    words = ["tracks", str(tmp_path / "cube.sgy"), "--horizon", str(tmp_path / "top.txt"), "-o", str(tmp_path / "out")]
    assert _run(words, debug=True) == 0
    rows = [line.split() for line in (tmp_path / "out" / "track_01.charisma.txt").read_text().splitlines()]
    table = np.array([[float(row[k]) for k in (2, 5, 8)] for row in rows])
    a, b = (table[:, 0] - 1001).astype(int), (table[:, 1] - 2001).astype(int)
    assert np.nanmedian(np.abs((table[:, 2] - 600) / 4 - truth[a, b])) < 0.5


def test_report_shows_every_track(folded: SyntheticCube, tmp_path: Path) -> None:
    write_segy(tmp_path / "cube.sgy", folded.to_dataarray())
    assert _run(["tracks", str(tmp_path / "cube.sgy"), "--count", "2", "-o", str(tmp_path / "out")], debug=True) == 0
    page = (tmp_path / "out" / "report.html").read_text()
    n = len(list((tmp_path / "out").glob("track_*_map.png")))
    assert 1 <= n <= 2
    assert page.count("data:image/png;base64") == n + 3
    assert "samples missed by closed loops" in page
    assert (tmp_path / "out" / "loops.png").is_file()
    assert "Horizons in cube.sgy" in page


def test_line_is_tracked_by_the_same_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from seismo3d.synthetic import fault_section

    line = fault_section("folded", seed=2007, shape=(16, 60, 64), population=None, wavelength=(12.0, 12.0))
    write_segy(tmp_path / "line.sgy", line.to_dataarray())
    truth = line.horizons[2]
    out = tmp_path / "out"
    words = ["tracks", str(tmp_path / "line.sgy"), "-o", str(out)]
    trace = int(open_cube(tmp_path / "line.sgy")["trace"].values[30])
    assert _run([*words, "--seed", f"{trace},{600 + 4 * truth[30]:.3f}"], debug=True) == 0
    assert {path.name for path in out.iterdir()} == {
        "track_01.xyz", "tracks.csv", "tracks_section.png", "report.html", "run.json",
    }  # fmt: skip
    points = np.loadtxt(out / "track_01.xyz")
    assert len(points) > 50
    check_line_is_scored(out, points, capsys)
    assert _run([*words, "--seed", "1,2031,800", "--overwrite"], debug=False) == 2
    assert "expected TRACE,TIME" in capsys.readouterr().err
    picks = tmp_path / "top.xyz"
    picks.write_text("1 2 3\n")
    assert _run([*words, "--horizon", str(picks), "--overwrite"], debug=False) == 2
    assert "it is for cubes" in capsys.readouterr().err


def check_line_is_scored(out: Path, points: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    """Picks 2 ms above the line's track, on its first 40 points, must give that; in seconds they are refused."""
    picks = out.parent / "picks.xyz"
    np.savetxt(picks, points[:40] - [0.0, 0.0, 2.0], fmt="%.4f")
    assert _run(["score", str(out), str(picks)], debug=True) == 0
    capsys.readouterr()
    (score,) = json.loads((out / "score" / "score.json").read_text())["scores"]
    assert (score["track"], score["n_common"], score["new"]) == ("track_01", 40, len(points) - 40)
    assert (score["bias"], score["missed"]) == (pytest.approx(2.0, abs=1e-3), 0.0)
    np.savetxt(picks, points[:40] * [1.0, 1.0, 1e-3], fmt="%.4f")
    assert _run(["score", str(out), str(picks), "--overwrite"], debug=False) == 2
    assert "Check the export's unit and sign" in capsys.readouterr().err
