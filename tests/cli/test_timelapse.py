from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from seismo3d.cli import _run
from seismo3d.io.cubes import open_cube
from seismo3d.io.segy import write_segy
from seismo3d.synthetic import make_cube, recipe_of


def test_shifts_are_written_on_the_base_s_geometry(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recipe = recipe_of("folded", shape=(20, 22, 64), population=None, wavelength=(14.0, 14.0))
    base = make_cube(recipe, seed=2102).to_dataarray()
    monitor = base.copy(data=np.roll(base.values, 2, axis=2))
    write_segy(tmp_path / "base.sgy", base)
    write_segy(tmp_path / "monitor.sgy", monitor)
    words = ["timelapse", str(tmp_path / "base.sgy"), str(tmp_path / "monitor.sgy"), "-o", str(tmp_path / "out")]
    assert _run(words, debug=True) == 0
    said = re.match(r"monitor deeper by ([\d.]+) ms", capsys.readouterr().out)
    assert said is not None
    assert float(said[1]) == pytest.approx(8.0, abs=0.1)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"shift.sgy", "shift_std.sgy", "aligned.sgy", "inline_shift.sgy", "run.json"} <= names
    assert len([name for name in names if name.endswith(".png")]) == 2
    shift = open_cube(tmp_path / "out" / "shift.sgy")
    np.testing.assert_array_equal(shift["inline"], base["inline"])
    assert np.median(shift.values[:, :, 16:-16]) == pytest.approx(8.0, abs=0.4)
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["alignment"]["shift_median"] == pytest.approx(8.0, abs=0.4)
    assert _run([*words, "--json", "--overwrite"], debug=True) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["alignment"]["shift_median"] == pytest.approx(8.0, abs=0.4)
    assert said.err.splitlines()[-1].startswith("time ")
    assert _run(words, debug=False) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_options_on_how_cubes_are_read_are_for_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recipe = recipe_of("folded", shape=(16, 16, 48), population=None, wavelength=(14.0, 14.0))
    base = make_cube(recipe, seed=2102).seismic
    for name, cube in (("base", base), ("monitor", np.roll(base, 2, axis=2))):
        np.savez(tmp_path / f"{name}.npz", meant=cube, other=np.zeros((3, 3)))
    words = ["timelapse", *(str(tmp_path / f"{name}.npz") for name in ("base", "monitor")), "-o", str(tmp_path / "out")]
    assert _run([*words, "--variable", "meant", "--interval", "5", "--start", "400"], debug=True) == 0
    assert "monitor deeper by 10" in capsys.readouterr().out
    shift = open_cube(tmp_path / "out" / "shift.sgy")
    np.testing.assert_allclose(shift[shift.dims[2]].values[:2], [400.0, 405.0])
    options = json.loads((tmp_path / "out" / "run.json").read_text())["options"]
    assert options == {"interval": 5.0, "start": 400.0, "variable": "meant"}


@pytest.mark.filterwarnings("default")
def test_an_unrelated_monitor_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base, monitor = np.random.default_rng(0).normal(size=(2, 16, 16, 48))
    for name, cube in (("base", base), ("monitor", monitor)):
        np.save(tmp_path / f"{name}.npy", cube)
    words = ["timelapse", *(str(tmp_path / f"{name}.npy") for name in ("base", "monitor")), "-o", str(tmp_path / "out")]
    assert _run([*words, "--interval", "4"], debug=False) == 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "no more like base" in line]
    assert "correlation" in line
