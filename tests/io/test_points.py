"""Point files: each format read back, each broken file refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, FormatError, ParameterError, Seismo3dWarning, ShapeError
from seismo3d.io import _lzf
from seismo3d.io import points as points_module
from seismo3d.io.points import read_points, write_points

POINTS = np.array([[0.5, -1.25, 3.0], [1e3, 2.0, -4.5], [7.0, 8.0, 9.0]])
NORMALS = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])


@pytest.mark.parametrize("suffix", [".ply", ".xyz"])
def test_written_files_are_read_back(tmp_path, suffix):
    held = read_points(write_points(tmp_path / f"a{suffix}", POINTS, normals=NORMALS))
    np.testing.assert_array_equal(held.points, POINTS)
    np.testing.assert_array_equal(held.normals, NORMALS)


def test_numpy_files(tmp_path):
    np.testing.assert_array_equal(read_points(write_points(tmp_path / "a.npy", POINTS[:, :2])).points, POINTS[:, :2])
    np.savez(tmp_path / "b.npz", points=POINTS, normals=NORMALS)
    np.testing.assert_array_equal(read_points(tmp_path / "b.npz").normals, NORMALS)


def test_ascii_ply_with_faces_before_and_behind(tmp_path):
    text = (
        "ply\nformat ascii 1.0\ncomment hello\nelement camera 1\nproperty float f\nelement vertex 2\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n9\n1 2 3 255\n4 5 6 0\n2 0 1\n"
    )
    (tmp_path / "a.ply").write_text(text)
    np.testing.assert_array_equal(read_points(tmp_path / "a.ply").points, [[1, 2, 3], [4, 5, 6]])


def test_big_endian_ply_and_rows_that_are_not_finite(tmp_path):
    head = b"ply\nformat binary_big_endian 1.0\nelement vertex 2\n"
    head += b"property float x\nproperty double y\nproperty short z\nend_header\n"
    (tmp_path / "a.ply").write_bytes(head + struct.pack(">fdh", 1.5, 2.5, -3) + struct.pack(">fdh", np.nan, 2.5, -3))
    with pytest.warns(Seismo3dWarning, match=r"a\.ply has 1 of 2 points with values that are not finite"):
        held = read_points(tmp_path / "a.ply")
    np.testing.assert_array_equal(held.points, [[1.5, 2.5, -3.0]])
    assert held.n_dropped == 1


def pcd(form, body):
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z i\nSIZE 4 4 4 2\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    head += f"WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {form}\n"
    return head.encode() + body


def test_all_three_kinds_of_pcd(tmp_path):
    rows = [(1.0, 2.0, 3.0, 7), (4.0, 5.0, 6.0, 8)]
    columns = b"".join(struct.pack("<ff", *c) for c in list(zip(*rows))[:3]) + struct.pack("<HH", 7, 8)
    packed = bytes([len(columns) - 1]) + columns  # one literal run
    bodies = {
        "ascii": b"1 2 3 7\n4 5 6 8\n",
        "binary": b"".join(struct.pack("<fffH", *row) for row in rows),
        "binary_compressed": struct.pack("<II", len(packed), len(columns)) + packed,
    }
    for form, body in bodies.items():
        (tmp_path / "a.pcd").write_bytes(pcd(form, body))
        np.testing.assert_array_equal(read_points(tmp_path / "a.pcd").points, [[1, 2, 3], [4, 5, 6]])


def test_lzf_repeats_and_refuses_what_points_before_the_start():
    packed = np.array([1, 65, 66, (3 << 5), 1], dtype=np.uint8)  # "AB", then 5 bytes from 2 back
    assert bytes(_lzf.decompress(packed, 7)) == b"ABABABA"
    assert _lzf.decompress(np.array([(3 << 5), 9], dtype=np.uint8), 5).size == 0


def test_csv_with_names_in_any_order_and_a_bare_xyz(tmp_path):
    (tmp_path / "a.csv").write_text("# c\nz;x;y\n3;1;2\n6;4;5\n")
    np.testing.assert_array_equal(read_points(tmp_path / "a.csv").points, [[1, 2, 3], [4, 5, 6]])
    (tmp_path / "b.xyz").write_text("1 2 3 0.5 7\n4 5 6 0.5 7\n")
    assert read_points(tmp_path / "b.xyz").normals is None


@pytest.mark.parametrize(
    "header",
    [
        "id,x [m],y [m],z [m]",
        "id,Easting,Northing,Elevation",
        "//GpsTime X Y Z",
        "# time,x,y,z",
        "\ufeffid,x,y,z",
        '"t (s)";"x(m)";"y(m)";"height (m)"',
        "# made by hand, in metres\n#id x y z\n# 2 points follow",
    ],
)
def test_named_columns_are_taken_by_their_names(tmp_path, header):
    (tmp_path / "a.csv").write_text(f"{header}\n7,1,2,3\n8,4,5,6\n", encoding="utf-8")
    np.testing.assert_array_equal(read_points(tmp_path / "a.csv").points, [[1, 2, 3], [4, 5, 6]])


def test_names_before_normals_without_names_keep_them(tmp_path):
    (tmp_path / "a.xyz").write_text("# x y z\n1 2 3 0 0 1\n4 5 6 0 1 0\n")
    np.testing.assert_array_equal(read_points(tmp_path / "a.xyz").normals, [[0, 0, 1], [0, 1, 0]])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("lon,lat,up\n1,2,3\n", "names its columns lon, lat, up; expected x, y and z"),
        ("# time,lon,lat\n1,2,3\n", "names its columns time, lon, lat"),
        ("x,y,z,label\n1,2,3\n", "names 4 columns, x, y, z, label, and its rows have 3 numbers"),
    ],
)
def test_names_that_are_not_understood_are_refused(tmp_path, text, match):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(FormatError, match=match):
        read_points(tmp_path / "a.csv")


@pytest.mark.parametrize("header", ["# three plain words", "2\na comment", "# x y z in metres", "#"])
def test_lines_that_name_nothing_are_passed_over(tmp_path, header):
    (tmp_path / "a.xyz").write_text(f"{header}\n1 2 3\n4 5 6\n")
    np.testing.assert_array_equal(read_points(tmp_path / "a.xyz").points, [[1, 2, 3], [4, 5, 6]])


def test_las_file(tmp_path):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.scales, header.offsets = np.full(3, 0.01), np.array([100.0, 200.0, 0.0])
    file = laspy.LasData(header)
    file.x, file.y, file.z = POINTS.T
    file.write(tmp_path / "a.las")
    np.testing.assert_allclose(read_points(tmp_path / "a.las").points, POINTS, atol=0.006)  # half a step of 0.01


@pytest.mark.parametrize(
    ("name", "body", "match"),
    [
        ("a.ply", b"solid", "no PLY header"),
        (
            "a.ply",
            b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty float y\nend_header\n",
            "cut short",
        ),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float q\nend_header\n1 2\n",
            "expected x, y",
        ),
        ("a.pcd", b"FIELDS x", "no PCD header"),
        ("a.pcd", pcd("binary", b"123"), "cut short"),
        ("a.pcd", pcd("binary_compressed", struct.pack("<II", 1, 4) + b"\x00"), "cut short"),
        ("a.xyz", b"1 2 3\n4 x 6\n", "not numbers"),
        ("a.npy", b"junk", "no NumPy file"),
        ("a.obj", b"", "expected one of"),
    ],
)
def test_broken_files_are_refused(tmp_path, name, body, match):
    (tmp_path / name).write_bytes(body)
    with pytest.raises(FormatError, match=match):
        read_points(tmp_path / name)


def test_missing_files_and_unknown_outputs_are_refused(tmp_path):
    with pytest.raises(FileAccessError, match="does not exist"):
        read_points(tmp_path / "no.ply")
    with pytest.raises(ParameterError, match=r"expected \.ply"):
        write_points(tmp_path / "a.las", POINTS)
    with pytest.raises(ShapeError, match=r"^normals has shape .*; expected .*, one a point"):
        write_points(tmp_path / "a.ply", POINTS, normals=NORMALS[1:])


@pytest.mark.parametrize("name", ["a.ply", "a.xyz", "a.npy", "q.NPY", "q.XYZ"])
def test_every_digit_is_kept_under_the_given_name(tmp_path, name, rng):
    points = rng.uniform(size=(50, 3)) * [1.0, 1e-9, 1.0] + [523456.789, 0.0, 5812345.678]
    np.testing.assert_array_equal(read_points(write_points(tmp_path / name, points)).points, points)
    assert [file.name for file in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["a.ply", "a.xyz", "a.npy"])
def test_a_write_that_fails_leaves_the_old_file(tmp_path, name, monkeypatch):
    write_points(tmp_path / name, POINTS)
    held = (tmp_path / name).read_bytes()

    def fail(aside, *_):
        aside.write_bytes(b"half")
        raise OSError(28, "no room")

    monkeypatch.setattr(points_module, "write_ply", fail)
    monkeypatch.setattr(points_module.np, "savetxt", lambda aside, *_, **__: fail(aside))
    monkeypatch.setattr(points_module.np, "save", lambda stream, *_: fail(Path(stream.name)))
    with pytest.raises(FileAccessError, match=f"{name} cannot be written: no room"):
        write_points(tmp_path / name, 2.0 * POINTS)
    assert (tmp_path / name).read_bytes() == held
    assert [file.name for file in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    "rows",
    [
        "x;y;z\n0,25;-0,5;3\n1;2e1;-3,125\n",
        "0,25 -0,5 3\n1 2e1 -3,125\n",
        "1;2e1;-3,125\n0,25;-0,5;3;\n",
        "0.25, -0.5, 3\n1,2e1,-3.125\n",
        "0.25,-0.5,3\n1,2e1,-3.125\n",
        "0.25;-0.5;3\n1;2e1;-3.125\n",
    ],
)
def test_commas_are_decimal_only_where_others_part_the_numbers(tmp_path, rows):
    (tmp_path / "a.csv").write_text(rows)
    points = read_points(tmp_path / "a.csv").points
    np.testing.assert_array_equal(points[np.argsort(points[:, 0])], [[0.25, -0.5, 3.0], [1.0, 20.0, -3.125]])


def test_points_in_columns_are_refused_with_the_remedy(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((3, 50)))
    with pytest.raises(FormatError, match=r"shape \(3, 50\).*transpose"):
        read_points(tmp_path / "a.npy")


def test_arrays_wider_than_points_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", points=np.zeros((60, 80)))
    with pytest.raises(FormatError, match=r"shape \(60, 80\).*entry 'elevation'"):
        read_points(tmp_path / "a.npz")
    np.save(tmp_path / "b.npy", np.zeros((60, 10)))
    assert read_points(tmp_path / "b.npy").points.shape == (60, 3)
