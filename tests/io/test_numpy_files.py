from __future__ import annotations

import io
import struct
import zipfile

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, FormatError
from seismo3d.io.numpy_files import check_declared, list_npz, read_npy, read_npz


def header(shape, descr="<f4"):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
    return stream.getvalue()


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_come_back(tmp_path, rng, mapped, order):
    values = np.asarray(rng.normal(size=(3, 4, 5)).astype(np.float32), order=order)
    np.save(tmp_path / "a.npy", values)
    got = read_npy(tmp_path / "a.npy", mapped=mapped)
    np.testing.assert_array_equal(got, values)
    assert isinstance(got, np.memmap) is mapped


def test_empty_arrays_come_back(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((0, 3)))
    assert read_npy(tmp_path / "a.npy", mapped=True).shape == (0, 3)


def test_archives_are_listed_and_read_by_name(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", one=np.arange(6).reshape(2, 3), two=np.float32(2.5))
    entries = list_npz(tmp_path / "a.npz")
    assert {name: (entry.shape, entry.dtype) for name, entry in entries.items()} == {
        "one": ((2, 3), np.dtype(np.int64)),
        "two": ((), np.dtype(np.float32)),
    }
    assert list(read_npz(tmp_path / "a.npz", ["two"])) == ["two"]
    with pytest.raises(FormatError, match="has the arrays one, two; expected three among them"):
        read_npz(tmp_path / "a.npz", ["three"])


@pytest.mark.parametrize("shape", [(10**6, 10**6), (2**62, 8), (7,)])
def test_declared_sizes_are_checked_before_anything_is_allocated(tmp_path, shape):
    (tmp_path / "a.npy").write_bytes(header(shape) + b"1234")
    for mapped in (False, True):
        with pytest.raises(FormatError, match="and has 4; expected all of them"):
            read_npy(tmp_path / "a.npy", mapped=mapped)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("a.npy", header(shape) + b"1234")
    for read in (list_npz, read_npz):
        with pytest.raises(FormatError, match="and has 4; expected all of them"):
            read(tmp_path / "a.npz")


def test_a_zip_that_lies_about_its_size_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", header((10**8,)) + b"1234")
    raw = bytearray((tmp_path / "a.npz").read_bytes())
    at = raw.rindex(b"PK\x01\x02")
    raw[at + 24 : at + 28] = struct.pack("<I", 4 * 10**8 + 128)
    (tmp_path / "a.npz").write_bytes(raw)
    with pytest.raises(FormatError, match="expected all of them"):
        read_npz(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (header((-4,)), "no negative size"),
        (header((2,), "|O") + b"12345678", "holds Python objects"),
        (b"\x93NUMPY\x03\x00" + header((1,))[8:] + b"1234", r"version \(3, 0\)"),
        (b"\x93NUMPY\x01\x00\x10\x00" + b"{'descr': '<f4', ", "is no NumPy file of numbers, or is damaged"),
        (b"\x93NUMPY\x01\x00\x10\x00" + b"{'a': (((((((((((", "is no NumPy file of numbers, or is damaged"),
        (b"", "is no NumPy file of numbers"),
    ],
)
def test_broken_headers_are_one_clear_line(tmp_path, content, words):
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(FormatError, match=words) as error:
        read_npy(tmp_path / "a.npy")
    assert "\n" not in str(error.value)


def test_damaged_members_and_other_packings_are_refused(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", a=np.arange(1000))
    raw = bytearray((tmp_path / "a.npz").read_bytes())
    raw[300] ^= 255
    (tmp_path / "b.npz").write_bytes(raw)
    with pytest.raises(FormatError, match="is no NPZ archive, or is damaged"):
        read_npz(tmp_path / "b.npz")
    with zipfile.ZipFile(tmp_path / "c.npz", "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("a.npy", header((1,)) + b"1234")
    with pytest.raises(FormatError, match="packed by method 14"):
        list_npz(tmp_path / "c.npz")


def test_absent_files_are_refused(tmp_path):
    with pytest.raises(FileAccessError, match="does not exist"):
        read_npy(tmp_path / "a.npy")


def test_what_packed_data_may_declare():
    check_declared(256 * 2**20, 10, "small")
    check_declared(10**9, 10**6, "well packed")
    with pytest.raises(FormatError, match="declares 1000000000 bytes, and has 10 on disk"):
        check_declared(10**9, 10, "it")
