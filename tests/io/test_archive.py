from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.io.archive import read_archive, write_archive


def test_types_come_back(tmp_path: Path) -> None:
    meta = {
        "none": None,
        "numbers": [1, 2.5, True, float("inf")],
        "tuple": (1, ("a", b"\x00\xff")),
        "array": np.arange(6, dtype=np.int16).reshape(2, 3),
        "empty": np.zeros((0, 3)),
        "scalar": np.float32(0.1),
        "path": Path("a/b"),
        "dict": {1: "integer key", (1, 2): "tuple key"},
        "text": np.array(["ab", "c"]),
    }
    arrays = {"a": np.arange(5.0), "flags": np.array([True, False]), "when": np.array(["2020-01-01"], "datetime64[D]")}
    write_archive(tmp_path / "x.npz", arrays, meta=meta)
    found, got = read_archive(tmp_path / "x.npz")
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    for name in ("array", "empty", "text"):
        np.testing.assert_array_equal(got[name], meta[name])
        assert got.pop(name).dtype == meta.pop(name).dtype
    assert got == meta
    assert type(got["scalar"]) is np.float32


def test_not_a_number_comes_back(tmp_path: Path) -> None:
    write_archive(tmp_path / "x.npz", {}, meta={"nan": float("nan")})
    assert np.isnan(read_archive(tmp_path / "x.npz")[1]["nan"])


def test_refusals(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="'a' holds Python objects"):
        write_archive(tmp_path / "x.npz", {"a": np.array([None])}, meta={})
    with pytest.raises(ParameterError, match="is a set"):
        write_archive(tmp_path / "x.npz", {}, meta={"a": {1}})
    with pytest.raises(FileAccessError, match="Make it first"):
        write_archive(tmp_path / "no" / "x.npz", {}, meta={})
    with pytest.raises(FileAccessError, match="cannot be read"):
        read_archive(tmp_path / "none.npz")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(FormatError, match="no seismo3d archive"):
        read_archive(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(2))
    with pytest.raises(FormatError, match="no seismo3d archive"):
        read_archive(tmp_path / "other.npz")


@pytest.mark.parametrize(
    "text",
    ['{"dict": [["a", {"ditc": []}]]}', '{"a": 1}', "{}", '{"dict": [["a"]]}', '{"dict": 3}', '{"array": "AA"}', "3"],
)
def test_a_damaged_description_is_one_line(tmp_path: Path, text: str) -> None:
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("meta.json", text)
    with pytest.raises(FormatError, match=r"x\.npz") as error:
        read_archive(tmp_path / "x.npz")
    assert "\n" not in str(error.value)
