from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FileAccessError
from seismo3d.io.fingerprint import fingerprint


def test_copy_has_the_same_and_a_change_another(tmp_path: Path, rng: np.random.Generator) -> None:
    data = rng.integers(0, 255, 20 * 2**20, dtype=np.uint8)
    data.tofile(tmp_path / "a")
    shutil.copy(tmp_path / "a", tmp_path / "b")
    a, b = fingerprint(tmp_path / "a"), fingerprint(tmp_path / "b")
    assert a["sha256"] == b["sha256"]
    assert (a["file"], a["size_bytes"]) == ("a", 20 * 2**20)
    for place in (0, -1):  # the first and the last byte are always seen
        changed = data.copy()
        changed[place] ^= 1
        changed.tofile(tmp_path / "b")
        assert fingerprint(tmp_path / "b")["sha256"] != a["sha256"]
    data[:-1].tofile(tmp_path / "b")
    assert fingerprint(tmp_path / "b")["sha256"] != a["sha256"]


def test_small_files_are_hashed_whole_and_folders_by_their_files(tmp_path: Path) -> None:
    folder = tmp_path / "store"
    (folder / "c").mkdir(parents=True)
    (folder / "c" / "0").write_bytes(b"abc")
    first = fingerprint(folder)
    assert first["size_bytes"] == 3
    shutil.copytree(folder, tmp_path / "copy")
    assert fingerprint(tmp_path / "copy")["sha256"] == first["sha256"]
    (folder / "c" / "0").write_bytes(b"abd")
    assert fingerprint(folder)["sha256"] != first["sha256"]
    with pytest.raises(FileAccessError, match="does not exist"):
        fingerprint(tmp_path / "none")
