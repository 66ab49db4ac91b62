from __future__ import annotations

import json

import numpy as np
import pytest
from fake_terrain import make_hills, make_scarp, place, shift

from seismo3d.cli import main
from seismo3d.io.elevation import read_elevation, write_elevation


def run(*words: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(word) for word in words])
    return int(left.value.code or 0)


@pytest.fixture
def maps(tmp_path, rng):
    hills = make_hills((240, 300))
    after = shift(hills, 1.5, -0.5) + rng.normal(0.0, 0.3, hills.shape)
    after[60:90, 60:90] += 12.0
    return write_elevation(tmp_path / "a.tif", place(hills)), write_elevation(tmp_path / "b.tif", place(after))


def test_lineaments_writes_its_folder(tmp_path, capsys):
    dem = write_elevation(tmp_path / "dem.tif", place(make_scarp(azimuth_deg=20.0)))
    assert run("lineaments", dem, "-o", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "strike   20" in said or "strike   19" in said or "strike   21" in said
    assert "scarp" in said
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "lineaments.geojson", "lineaments.csv", "scarp_profiles.csv", "likelihood.tif", "map.png", "rose.png",
        "run.json",
    }  # fmt: skip
    assert json.loads((tmp_path / "out" / "run.json").read_text())["n_scarps"] >= 1
    assert run("lineaments", dem, "-o", tmp_path / "out") == 2
    assert "exists already" in capsys.readouterr().err


def test_compare_aligns_first(tmp_path, maps, capsys):
    assert run("compare", *maps, "-o", tmp_path / "out") == 0
    moved = [float(word) for word in capsys.readouterr().out.split()[1:4]]
    np.testing.assert_allclose(moved, [-15.0, -5.0, 0.0], atol=0.1)
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["gained_m3"] == pytest.approx(12.0 * 900 * 100.0, rel=0.1)
    difference, marks = (read_elevation(tmp_path / "out" / f"{name}.tif") for name in ("difference", "significant"))
    assert difference.shape == read_elevation(maps[0]).shape
    # carried off the map, a cell is unknown, not without change
    np.testing.assert_array_equal(np.isnan(marks.values), np.isnan(difference.values))
    assert np.isnan(difference.values).any()
    assert marks.attrs["nodata"] == 255
    assert set(np.unique(marks.values[np.isfinite(marks.values)])) == {0.0, 1.0}
    assert (tmp_path / "out" / "change.png").stat().st_size > 5000


def test_compare_writes_nothing_where_maps_do_not_match(tmp_path, maps, capsys):
    other = write_elevation(tmp_path / "other.tif", place(make_hills((240, 300), seed=9)))
    assert run("compare", maps[0], other, "-o", tmp_path / "out") == 2
    assert "is a poor fit" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    elsewhere = write_elevation(tmp_path / "elsewhere.tif", place(make_hills((240, 300), seed=9), crs="EPSG:32612"))
    assert run("compare", maps[0], elsewhere, "-o", tmp_path / "out") == 2
    assert "before is in EPSG:32611 and after in EPSG:32612; expected one" in capsys.readouterr().err
    assert run("compare", maps[0], other, "-o", tmp_path / "out", "--no-align", "--vertical", "tilt") == 2
    assert "--vertical is 'tilt'; expected none with --no-align" in capsys.readouterr().err
    assert run("compare", maps[0], other, "-o", tmp_path / "out", "--no-align") == 0
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["options"] == {"align": False, "confidence": 0.95}


def test_register_on_maps(tmp_path, maps, capsys):
    assert run("register", *maps, "--json", "-o", tmp_path / "moved.tif") == 0
    found = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(found["shift"][:2], [-15.0, -5.0], atol=0.2)
    difference = read_elevation(tmp_path / "moved.tif").values - read_elevation(maps[0]).values
    assert np.nanmedian(np.abs(difference)) < 0.5
    assert run("register", *maps, "--vertical", "bent") == 2
    assert "vertical is 'bent'" in capsys.readouterr().err


def test_json_and_records_hold_the_same(tmp_path, maps, capsys):
    assert run("compare", *maps, "-o", tmp_path / "out", "--confidence", 0.9, "--json") == 0
    out, err = capsys.readouterr()
    found, record = json.loads(out), json.loads((tmp_path / "out" / "run.json").read_text())
    assert all(record[name] == found[name] for name in ("gained_m3", "lost_m3", "shift_m", "timings_s"))
    assert [entry["file"] for entry in record["inputs"]] == ["a.tif", "b.tif"]
    assert record["options"] == {"align": True, "vertical": "offset", "confidence": 0.9}
    assert {"finished", "versions"} <= set(record)
    assert err.startswith("time     ")
    dem = write_elevation(tmp_path / "dem.tif", place(make_scarp(azimuth_deg=20.0)))
    assert run("lineaments", dem, "-o", tmp_path / "lines", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    record = json.loads((tmp_path / "lines" / "run.json").read_text())
    assert len(found["lineaments"]) == found["n_lineaments"] == record["n_lineaments"] >= 1
    assert abs(found["lineaments"][0]["strike_deg"] - 20) <= 2
    assert record["input"]["file"] == "dem.tif"
    assert record["options"] == {"length": 24.0, "levels": 2}
