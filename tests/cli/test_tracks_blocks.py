"""The tracks command on a cube larger than the memory it may take."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from seismo3d.cli import _run
from seismo3d.io.cubes import open_cube
from seismo3d.io.zarr_store import write_zarr
from seismo3d.seismic.faults import trace_faults
from seismo3d.seismic.layer_time import layer_time
from seismo3d.seismic.tracks import trace_tracks
from seismo3d.synthetic import SyntheticFault, fault_cube


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cube that asks for blocks, and its faults beside it; the working folder is its own."""
    for module in ("layering", "stored_layers"):
        monkeypatch.setattr(f"seismo3d.seismic.blocks.{module}.whole_layers_bytes", lambda _: 2 * 10**9)
    monkeypatch.chdir(tmp_path)
    fault = SyntheticFault((26.0, 26.0, 32.0), 40.0, 65.0, 8.0)
    cube = fault_cube("clean", seed=7, shape=(52, 60, 64), wavelength=(14.0, 14.0), population=None, faults=(fault,))
    found = trace_faults(cube.to_dataarray())
    (tmp_path / "faults").mkdir()
    found.save(tmp_path / "faults")
    return write_zarr(tmp_path / "cube.zarr", cube.to_dataarray())


def run(*words: str) -> int:
    return _run(["tracks", "cube.zarr", "-o", "out", *words], debug=False)


def test_stopped_by_a_full_disk_it_goes_on_to_the_whole_result(
    store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--faults", "faults", "--seed", "1012,2014,712", "--memory", "1GB")
    with monkeypatch.context() as patch:

        def fail(*_: object, **__: object) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        patch.setattr("seismo3d.seismic.track_exports.write_tracks", fail)
        assert run(*words) == 2
    said = capsys.readouterr().err
    assert "out cannot be written: No space left on device. Finished blocks are kept: give the same command" in said
    assert {entry.name for entry in store.parent.iterdir()} == {"cube.zarr", "faults", "out.unfinished"}
    assert run("--seed", "1012,2014,712", "--memory", "1GB") == 2
    assert "the input of the run in out.unfinished has changed: faults was" in capsys.readouterr().err
    assert run(*words, "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert {entry.name for entry in store.parent.iterdir()} == {"cube.zarr", "faults", "out"}
    names = {entry.name for entry in (store.parent / "out").iterdir()}
    assert {"layer_time.zarr", "track_01.xyz", "tracks.csv", "track_01_map.png", "loops.png", "report.html"} <= names
    assert "work" not in names
    assert printed["loops"]["n_loops"] > 1000
    cube, faults = open_cube(store), trace_faults(open_cube(store))
    (wanted,) = trace_tracks(cube, [(1012, 2014, 712)], faults=faults)
    depths = np.loadtxt("out/track_01.xyz")[:, 2]
    np.testing.assert_allclose(depths, wanted.depth[np.isfinite(wanted.depth)], atol=0.01)
    assert printed["tracks"][0]["share_traced"] == pytest.approx(wanted.share)
    kept, times = open_cube("out/layer_time.zarr").values, layer_time(cube, faults=faults).values
    np.testing.assert_array_equal(kept, times)


def test_a_memory_that_is_none_is_refused_before_any_work(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--memory", "lots") == 2
    assert "expected a size such as 2GB" in capsys.readouterr().err
    assert {entry.name for entry in store.parent.iterdir()} == {"cube.zarr", "faults"}


def test_too_little_memory_leaves_nothing_behind(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--memory", "1MB") == 2
    assert "memory" in capsys.readouterr().err
    assert {entry.name for entry in store.parent.iterdir()} == {"cube.zarr", "faults"}
