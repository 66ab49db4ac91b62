from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image

import seismo3d as s3
from seismo3d.errors import FileAccessError, FormatError, ParameterError
from seismo3d.io import grids
from seismo3d.io.grids import read_grid


def test_pictures_keep_their_depth(tmp_path, rng):
    eight = rng.integers(0, 256, (20, 30)).astype(np.uint8)
    sixteen = rng.integers(0, 65536, (20, 30)).astype(np.uint16)
    for name, image in (("a.png", eight), ("b.png", sixteen), ("c.tif", sixteen)):
        cv2.imwrite(str(tmp_path / name), image)
        read = read_grid(tmp_path / name)
        assert read.dtype == image.dtype
        np.testing.assert_array_equal(read, image)


def test_colour_becomes_grey(tmp_path):
    colour = np.zeros((4, 5, 3), np.uint8)
    colour[..., 1] = 100  # green counts 0.587
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    assert (np.abs(read_grid(tmp_path / "a.png").astype(int) - 58.7) < 1).all()


def test_arrays_and_cubes(tmp_path):
    cube = np.arange(4 * 5 * 6, dtype=np.float32).reshape(4, 5, 6)
    np.save(tmp_path / "a.npy", cube)
    np.savez(tmp_path / "b.npz", cube=cube)
    path = s3.write_segy(tmp_path / "c.sgy", s3.as_cube(cube, interval=4.0))
    for name in ("a.npy", "b.npz", path):
        np.testing.assert_array_equal(read_grid(tmp_path / name), cube)


@pytest.mark.parametrize(
    ("name", "content", "error", "words"),
    [
        ("none.png", None, FileAccessError, "does not exist"),
        ("bad.png", b"text", FormatError, "cannot be read as a picture"),
        ("bad.npy", b"text", FormatError, "no NumPy file"),
        ("cut.npz", b"PK\x03\x04", FormatError, "no NPZ archive"),
    ],
)
def test_refuses(tmp_path, name, content, error, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(error, match=words):
        read_grid(tmp_path / name)


def test_a_picture_that_declares_more_than_it_holds_is_refused(tmp_path):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 30_000, 30_000, 16, 0, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress(b"0" * 100)) + chunk(b"IEND", b"")
    (tmp_path / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + head + body)
    with pytest.raises(FormatError, match="of 30000 x 30000 pixels, declares 7200000000 bytes"):
        read_grid(tmp_path / "bomb.png")


def test_a_picture_beyond_a_readers_own_limit_is_refused_by_that(tmp_path, monkeypatch):
    def raise_bomb(_path):
        raise Image.DecompressionBombError("too large")

    Image.new("L", (40, 30), 7).save(tmp_path / "a.webp")
    monkeypatch.setattr(grids, "_declared_size", raise_bomb)
    with pytest.raises(FormatError, match="of more than 178956970 pixels, declares"):
        read_grid(tmp_path / "a.webp")


@pytest.mark.parametrize("ending", ["png", "jpg", "tif", "bmp", "webp", "pgm"])
def test_the_limit_that_the_process_shares_stays(tmp_path, ending, monkeypatch):
    path = tmp_path / f"a.{ending}"
    Image.new("L", (40, 30), 7).save(path)
    seen = []
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    monkeypatch.setattr(Image, "open", lambda *_, **__: seen.append(Image.MAX_IMAGE_PIXELS) or Image.new("L", (4, 3)))
    assert grids._declared_size(path) == (40, 30)
    assert read_grid(path).shape == (30, 40)
    assert set(seen) <= {1000}


def test_an_empty_picture_is_refused(tmp_path):
    (tmp_path / "none.png").write_bytes(b"")
    with pytest.raises(FormatError, match="cannot be read as a picture"):
        read_grid(tmp_path / "none.png")


def test_the_array_of_an_archive_is_named(tmp_path):
    np.savez(tmp_path / "two.npz", a=np.zeros((9, 8)), b=np.ones((9, 8)))
    np.testing.assert_array_equal(read_grid(tmp_path / "two.npz", variable="b"), np.ones((9, 8)))
    with pytest.raises(ParameterError, match=r"variable is 'c'; expected one of the arrays of .*: a, b"):
        read_grid(tmp_path / "two.npz", variable="c")
    with pytest.raises(FormatError, match="Name the one that is meant with variable"):
        read_grid(tmp_path / "two.npz")


@pytest.mark.parametrize(("name", "option"), [("a.png", {"variable": "b"}), ("a.npy", {"inline_byte": 9})])
def test_options_that_do_not_serve_are_refused(tmp_path, name, option):
    Image.new("L", (40, 30), 7).save(tmp_path / "a.png")
    np.save(tmp_path / "a.npy", np.zeros((9, 8)))
    with pytest.raises(ParameterError, match="expected none for"):
        read_grid(tmp_path / name, **option)
