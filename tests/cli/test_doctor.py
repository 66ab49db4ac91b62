from __future__ import annotations

import importlib.metadata
import json

import pytest

import seismo3d as s3
from seismo3d.cli import _machine, main


@pytest.fixture(autouse=True)
def _no_probe(monkeypatch):
    monkeypatch.setattr("seismo3d.plot.rendering.find_windowless", lambda: ("vtkEGLRenderWindow", ""))


def run(*words):
    with pytest.raises(SystemExit) as left:
        main(list(words))
    return left.value.code


def test_doctor_tells_what_there_is(capsys):
    assert run("doctor") == 0
    out = capsys.readouterr().out
    for words in (
        f"seismo3d {s3.__version__}",
        "numpy ",
        "threads ",
        "3D scenes   yes, vtkEGLRenderWindow",
        "compiled ",
    ):
        assert words in out


def test_doctor_as_json(capsys, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert run("doctor", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"versions", "threads", "memory_gib", "rendering", "cache", "extras"}
    assert found["threads"]["limits"]["OMP_NUM_THREADS"] == "3"
    assert found["rendering"]["window"] == "vtkEGLRenderWindow"
    assert found["threads"]["used"] >= 1
    assert found["memory_gib"] > 0.1


def test_problems_come_with_their_remedy(capsys, monkeypatch):
    monkeypatch.setattr("seismo3d.plot.rendering.find_windowless", lambda: ("", "no OpenGL"))
    monkeypatch.setattr(_machine, "_can_write", lambda _folder: False)
    wanted = ["numpy>=2.0", "numpy>=2 ; extra == 'small'", 'no-such-package[x]>=3 ; extra == "large"']
    monkeypatch.setattr(importlib.metadata, "requires", lambda _name: wanted)
    assert run("doctor") == 0
    out = capsys.readouterr().out
    assert "3D scenes   no OpenGL" in out
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in out
    assert "small: there" in out
    assert "large: lacks no-such-package: pip install 'seismo3d[large]'" in out


def test_extras_are_not_guessed_where_the_package_is_not_installed(monkeypatch):
    def absent(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "requires", absent)
    assert _machine.find_extras() == {}


def test_the_cache_is_measured(tmp_path, monkeypatch):
    import numba

    (tmp_path / "k.nbi").write_bytes(b"12")
    (tmp_path / "deep").mkdir()
    (tmp_path / "deep" / "k.1.nbc").write_bytes(b"1" * 2**20)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    found = _machine.find_cache()
    assert (found["files"], round(found["size_mib"], 3), found["writable"]) == (2, 1.0, True)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "not" / "yet"))
    assert _machine.find_cache()["files"] == 0
