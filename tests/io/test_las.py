from __future__ import annotations

import struct

import numpy as np
import pytest

from seismo3d.errors import FormatError
from seismo3d.io.points import read_points

laspy = pytest.importorskip("laspy")


def make(path, n=50, version="1.2"):
    made = laspy.create(point_format=6 if version == "1.4" else 3, file_version=version)
    made.x, made.y, made.z = np.random.default_rng(0).normal(size=(3, n)).round(3)
    made.write(str(path))
    return path, np.column_stack([made.x, made.y, made.z])


def put(path, at, layout, value):
    raw = bytearray(path.read_bytes())
    struct.pack_into(layout, raw, at, value)
    path.write_bytes(raw)


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize("version", ["1.2", "1.4"])
def test_whole_files_are_read(tmp_path, ending, version):
    path, points = make(tmp_path / f"a.{ending}", version=version)
    np.testing.assert_allclose(read_points(path).points, points, atol=1e-9)


def test_files_of_several_pieces_are_joined(tmp_path, monkeypatch):
    monkeypatch.setattr("seismo3d.io._las._BYTES_AT_ONCE", 34 * 7)
    path, points = make(tmp_path / "a.laz")
    np.testing.assert_allclose(read_points(path).points, points, atol=1e-9)


@pytest.mark.parametrize(
    ("at", "layout", "value", "words"),
    [
        (107, "<I", 10**9, "announces 1000000000 points"),
        (96, "<I", 10**9, "announces 0 records before its points at byte 1000000000"),
        (100, "<I", 10**6, "announces 1000000 records before its points"),
        (105, "<H", 0, "announces"),
        (0, "<I", 0, "has no LAS header"),
    ],
)
def test_insane_headers_are_refused_before_anything_is_allocated(tmp_path, at, layout, value, words):
    path, _ = make(tmp_path / "a.las")
    put(path, at, layout, value)
    with pytest.raises(FormatError, match=words):
        read_points(path)


def test_insane_extended_records_are_refused(tmp_path):
    path, _ = make(tmp_path / "a.las", version="1.4")
    put(path, 235, "<Q", 400)
    put(path, 243, "<I", 10**6)
    with pytest.raises(FormatError, match="announces 1000000 extended records"):
        read_points(path)


def test_insane_tables_of_chunks_are_refused(tmp_path):
    path, _ = make(tmp_path / "a.laz")
    raw = path.read_bytes()
    (offset,) = struct.unpack_from("<I", raw, 96)
    (table,) = struct.unpack_from("<q", raw, offset)
    put(path, table + 4, "<I", 2**31)
    with pytest.raises(FormatError, match="announces 2147483648 chunks"):
        read_points(path)
    put(path, offset, "<q", 10**12)
    with pytest.raises(FormatError, match="a table of chunks at byte 1000000000000"):
        read_points(path)
