"""The faults command on a cube larger than the memory it may take."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from seismo3d.cli import _run
from seismo3d.io.cubes import open_cube
from seismo3d.io.zarr_store import write_zarr
from seismo3d.seismic.faults import trace_faults
from seismo3d.seismic.faultset import FaultSet
from seismo3d.synthetic import SyntheticFault, fault_cube


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cube that asks for blocks; the working folder is its own."""
    monkeypatch.setattr("seismo3d.seismic.blocks.tracing.whole_cube_bytes", lambda _: 2 * 10**9)
    monkeypatch.chdir(tmp_path)
    fault = SyntheticFault((26.0, 26.0, 32.0), 40.0, 65.0, 8.0)
    cube = fault_cube("clean", seed=7, shape=(52, 60, 64), wavelength=(14.0, 14.0), population=None, faults=(fault,))
    return write_zarr(tmp_path / "cube.zarr", cube.to_dataarray())


def run(*words: str) -> int:
    return _run(["faults", *words], debug=False)


def test_stopped_by_a_full_disk_it_goes_on_to_the_whole_result(
    store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("cube.zarr", "-o", "out", "--memory", "1GB")
    with monkeypatch.context() as patch:

        def fail(*_: object, **__: object) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        patch.setattr("seismo3d.io.segy.write_segy", fail)
        assert run(*words) == 2
    said = capsys.readouterr().err
    assert "out cannot be written: No space left on device. Finished blocks are kept: give the same command" in said
    assert {entry.name for entry in store.parent.iterdir()} == {"cube.zarr", "out.unfinished"}
    assert run(*words) == 0
    assert {entry.name for entry in store.parent.iterdir()} == {"cube.zarr", "out"}
    names = {entry.name for entry in (store.parent / "out").iterdir()}
    assert {"labels.zarr", "likelihood.zarr", "throw.zarr", "labels.sgy", "faults.csv", "report.html"} <= names
    assert "work" not in names
    wanted = trace_faults(open_cube(store))
    found = FaultSet.load("out")
    np.testing.assert_array_equal(found.labels.values, wanted.labels.values)
    np.testing.assert_array_equal(open_cube("out/likelihood.sgy").values, wanted.likelihood.values)


def test_interrupted_it_says_where_what_is_done_is_kept(
    store: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("seismo3d.io.segy.write_segy", interrupt)
    assert run("cube.zarr", "-o", "out", "--memory", "1GB") == 130
    said = capsys.readouterr().err
    assert "seismo3d: what is done is kept in out.unfinished: give the same command again to go on\n" in said
    assert {entry.name for entry in store.parent.iterdir()} == {"cube.zarr", "out.unfinished"}


def test_what_takes_the_whole_cube_is_refused_before_any_work(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--attributes", "--unfault"):
        assert run("cube.zarr", "-o", "out", "--memory", "1GB", option) == 2
        assert f"{option} takes the cube in one piece" in capsys.readouterr().err
    assert run("cube.zarr", "-o", "out", "--memory", "lots") == 2
    assert "expected a size such as 2GB" in capsys.readouterr().err
    assert [entry.name for entry in store.parent.iterdir()] == ["cube.zarr"]


def test_files_without_trace_headers_are_traced_within_a_memory_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("line.npy", np.random.default_rng(3).normal(size=(40, 48)).astype(np.float32))
    assert run("line.npy", "-o", "out", "--memory", "1GB") == 0
    assert FaultSet.load("out").labels.shape == (40, 48)
