from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.errors import FileAccessError, FormatError


@pytest.fixture
def good(tmp_path, maker):
    return maker.write(tmp_path / "good.sgy", np.ones((6, 5)), maker.headers([1, 2], [1, 2, 3]))


def patched(path, byte, value):
    raw = bytearray(path.read_bytes())
    raw[byte - 1 : byte + 1] = value.to_bytes(2, "big", signed=value < 0)
    out = path.with_name("patched.sgy")
    out.write_bytes(bytes(raw))
    return out


def one_line(error):
    assert "\n" not in str(error.value)


def test_the_unpatched_file_opens(good):
    assert s3.open_cube(good).shape == (2, 3, 5)


@pytest.mark.parametrize("cut", [1, 100, 239, 259])
def test_truncated(good, cut):
    good.write_bytes(good.read_bytes()[:-cut])
    with pytest.raises(FormatError, match=r"5 traces of 5 samples.*bytes over.*cut short") as error:
        s3.open_cube(good)
    one_line(error)


@pytest.mark.parametrize(("size", "words"), [(0, "zero bytes"), (1, "at least 3600"), (3599, "at least 3600")])
def test_too_short_for_headers(good, size, words):
    good.write_bytes(good.read_bytes()[:size])
    with pytest.raises(FormatError, match=words) as error:
        s3.open_cube(good)
    one_line(error)


def test_headers_without_a_trace(good):
    good.write_bytes(good.read_bytes()[:3600])
    with pytest.raises(FormatError, match="expected traces behind them"):
        s3.open_cube(good)


def test_a_text_file(tmp_path):
    path = tmp_path / "notes.sgy"
    path.write_text("inline crossline time\n" * 1000)
    with pytest.raises(FormatError, match=r"is not SEG-Y.*looks like a text file") as error:
        s3.open_cube(path)
    one_line(error)


def test_noise(tmp_path, rng):
    path = tmp_path / "noise.sgy"
    raw = bytearray(rng.integers(0, 256, 9000, dtype=np.uint8).tobytes())
    raw[3224:3226] = b"\x77\x77"
    path.write_bytes(bytes(raw))
    with pytest.raises(FormatError, match="sample format code is 30583; expected one of"):
        s3.open_cube(path)


@pytest.mark.parametrize(
    ("byte", "value", "words"),
    [
        (3221, 0, "0 samples a trace"),
        (3221, 32767, "traces of 32767 samples"),
        (3221, -5, "traces of 65531 samples"),
        (3217, -4000, "sample interval of -4000"),
        (3225, 0, "sample format code is 0"),
        (3225, 4, "sample format code is 4"),
        (3225, 99, "sample format code is 99"),
        (3505, 30000, "30000 extended textual headers"),
        (3505, -1, "none has the end mark"),
    ],
)
def test_absurd_headers(good, byte, value, words):
    with pytest.raises(FormatError, match=words) as error:
        s3.open_cube(patched(good, byte, value))
    one_line(error)


def test_missing_and_directory(tmp_path):
    with pytest.raises(FileAccessError, match="does not exist"):
        s3.open_cube(tmp_path / "no.sgy")
    with pytest.raises(FileAccessError, match="is a directory; expected a file"):
        s3.open_cube(tmp_path)


def test_no_permission(good, monkeypatch):
    def refuse(self, *_args, **_keys):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(FileAccessError, match="cannot be read: permission denied") as error:
        s3.open_cube(good)
    one_line(error)


def test_errors_are_builtin_too(tmp_path):
    with pytest.raises(OSError, match="does not exist"):
        s3.open_cube(tmp_path / "no.sgy")


def test_a_pipe_is_refused_and_does_not_hang(tmp_path):
    os.mkfifo(tmp_path / "pipe.sgy")
    with pytest.raises(FileAccessError, match="is a pipe or a device"):
        s3.open_cube(tmp_path / "pipe.sgy")


def test_reasons_of_the_system_are_told(tmp_path):
    (tmp_path / "loop.sgy").symlink_to(tmp_path / "loop.sgy")
    with pytest.raises(FileAccessError, match=r"loop\.sgy cannot be read: "):
        s3.open_cube(tmp_path / "loop.sgy")
    with pytest.raises(FileAccessError, match=r"cannot be read: File name too long"):
        s3.open_cube(tmp_path / ("x" * 300))
