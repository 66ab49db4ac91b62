from __future__ import annotations

import sys

import numpy as np
import pytest

from seismo3d.errors import (
    FileAccessError,
    FormatError,
    GeometryError,
    MissingDependencyError,
    ParameterError,
    Seismo3dWarning,
    ShapeError,
)
from seismo3d.geometry.map_grid import MapGrid
from seismo3d.io.elevation import holds_elevation, make_elevation, read_elevation, write_elevation

PLACE = (30.0, 0.0, 376_313.5, 0.0, -30.0, 3_807_917.75)


@pytest.fixture
def map_with_holes(rng):
    z = rng.normal(500.0, 50.0, (12, 17)).astype(np.float32)
    z[3:5, 7] = np.nan
    return make_elevation(z, PLACE, crs="EPSG:32611")


@pytest.mark.parametrize("ending", ["tif", "asc", "npz"])
def test_what_is_written_is_read(tmp_path, map_with_holes, ending):
    path = write_elevation(tmp_path / f"a.{ending}", map_with_holes)
    read = read_elevation(path)
    np.testing.assert_allclose(read.values, map_with_holes.values, rtol=1e-6)  # ASCII keeps nine digits
    assert read.attrs["transform"] == PLACE
    assert read.attrs["crs"] == ("" if ending == "asc" else "EPSG:32611")
    np.testing.assert_allclose(read.x.values[:2], [376_328.5, 376_358.5])
    np.testing.assert_allclose(read.y.values[:2], [3_807_902.75, 3_807_872.75])


@pytest.mark.parametrize("ending", ["tif", "asc", "npz"])
def test_nodata_of_whole_numbers_is_written_and_read(tmp_path, map_with_holes, ending):
    codes = np.where(np.isnan(map_with_holes.values), 255, map_with_holes.values > 500.0).astype(np.uint8)
    made = map_with_holes.copy(data=codes).assign_attrs(nodata=255)
    read = read_elevation(write_elevation(tmp_path / f"a.{ending}", made))
    np.testing.assert_array_equal(read.values, np.where(codes == 255, np.float32(np.nan), codes))


def test_integers_with_nodata_become_nan(tmp_path):
    import rasterio

    z = np.arange(30, dtype=np.int16).reshape(5, 6)
    z[2, 2] = 32767
    with rasterio.open(
        tmp_path / "a.tif", "w", driver="GTiff", height=5, width=6, count=1, dtype="int16", nodata=32767,
        transform=rasterio.Affine(*PLACE), crs="EPSG:32611",
    ) as file:  # fmt: skip
        file.write(z, 1)
    read = read_elevation(tmp_path / "a.tif")
    assert read.attrs["nodata"] == 32767
    assert np.isnan(read.values[2, 2])
    assert read.values[0, 5] == 5.0
    with pytest.raises(FormatError, match="has 1 bands; band 2"):
        read_elevation(tmp_path / "a.tif", band=2)
    for band in (0, "1", 1.5, [1]):
        with pytest.raises(ParameterError, match=r"^band is .*; expected a (finite |whole )?number"):
            read_elevation(tmp_path / "a.tif", band=band)


def test_a_whole_number_of_any_size_stands_for_nothing():
    assert np.isfinite(make_elevation(np.ones((2, 3)), nodata=10**30).values).all()


@pytest.mark.parametrize("wrong", [np.zeros((2, 3, 4)), np.zeros((2, 3), complex), [["a", "b"]], np.zeros((0, 3))])
def test_what_is_no_map_of_numbers_is_neither_made_nor_written(tmp_path, wrong):
    with pytest.raises(ShapeError, match=r"^elevation has "):
        make_elevation(wrong)
    with pytest.raises(ShapeError, match=r"^elevation has "):
        write_elevation(tmp_path / "a.npz", wrong)
    assert not list(tmp_path.iterdir())


def test_scale_offset_and_mask_of_a_band_count(tmp_path):
    import rasterio

    stored = np.arange(30, dtype=np.int16).reshape(5, 6)
    stored[1, 1] = -1
    kept = np.ones((5, 6), bool)
    kept[4, 0] = False
    for name, nodata in (("scaled", -1), ("masked", None)):
        with (
            rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True),
            rasterio.open(
                tmp_path / f"{name}.tif", "w", driver="GTiff", height=5, width=6, count=1, dtype="int16", nodata=nodata,
                transform=rasterio.Affine(*PLACE), crs="EPSG:32611",
            ) as file,
        ):  # fmt: skip
            file.write(stored, 1)
            file.scales, file.offsets = (0.1,), (1000.0,)
            if nodata is None:
                file.write_mask(kept)
        read = read_elevation(tmp_path / f"{name}.tif")
        assert read.values[0, 5] == np.float32(1000.5)
        empty = np.argwhere(np.isnan(read.values)).tolist()
        assert empty == ([[1, 1]] if name == "scaled" else [[4, 0]])
        assert read.attrs["nodata"] is None


@pytest.mark.parametrize("value", [-9999.0, -32768.0, np.finfo(np.float32).min])
@pytest.mark.parametrize("ending", ["tif", "npy"])
def test_undeclared_voids_far_below_are_empty_with_a_warning(tmp_path, map_with_holes, value, ending):
    z = map_with_holes.copy()
    z.values[1:3, 2] = value
    if ending == "tif":
        path = write_elevation(tmp_path / "a.tif", z)
    else:
        path = tmp_path / "a.npy"
        np.save(path, z.values)
    with pytest.warns(Seismo3dWarning, match=r"in 2 cells.*does not declare it"):
        read = read_elevation(path)
    expected = map_with_holes.values.copy()
    expected[1:3, 2] = np.nan
    np.testing.assert_array_equal(read.values, expected)


def test_a_trench_as_deep_as_a_usual_void_is_no_void(tmp_path):
    z = np.linspace(-9999.0, -9000.0, 100).reshape(10, 10)
    np.save(tmp_path / "trench.npy", z)
    np.testing.assert_array_equal(read_elevation(tmp_path / "trench.npy").values, z.astype(np.float32))


@pytest.mark.parametrize(
    ("crs", "unit", "words"),
    [("EPSG:2225", "", "whose unit is the US survey foot"), ("EPSG:32611", "us-ft", "elevations in 'us-ft'")],
)
def test_feet_are_not_taken_for_metres(tmp_path, map_with_holes, crs, unit, words):
    import rasterio

    path = write_elevation(tmp_path / "a.tif", map_with_holes.assign_attrs(crs=crs))
    with rasterio.open(path, "r+") as file:
        file.units = (unit,)
    with pytest.raises(FormatError, match=words):
        read_elevation(path)
    if not unit:
        with pytest.raises(FormatError, match=words):
            read_elevation(write_elevation(tmp_path / "a.npz", map_with_holes.assign_attrs(crs=crs)))


@pytest.mark.parametrize("ending", ["tif", "npz"])
@pytest.mark.parametrize(
    ("crs", "unit"), [("EPSG:7844", "degree"), ("EPSG:4326+5773", "degree"), ("EPSG:4471", "metre")]
)
def test_degrees_and_metres_are_those_of_the_system(tmp_path, crs, unit, ending):
    place = (1e-4, 0.0, 149.0, 0.0, -1e-4, -35.0) if unit == "degree" else (10.0, 0.0, 5e5, 0.0, -10.0, 8.6e6)
    path = write_elevation(tmp_path / f"a.{ending}", make_elevation(np.ones((9, 9)), place, crs=crs))
    read = read_elevation(path)
    assert read.attrs["crs_unit"] == unit
    cell = (9.1, 11.1) if unit == "degree" else (10.0, 10.0)
    np.testing.assert_allclose(np.abs(np.diag(MapGrid.from_elevation(read).steps_m)), cell, rtol=0.01)


def test_an_archive_without_rasterio_says_what_it_is_in(tmp_path, monkeypatch):
    made = make_elevation(np.ones((9, 9)), (1e-4, 0.0, 149.0, 0.0, -1e-4, -35.0), crs="EPSG:7844")
    path = write_elevation(tmp_path / "a.npz", made)
    np.savez(tmp_path / "b.npz", elevation=np.ones((9, 9)), transform=made.attrs["transform"], crs="EPSG:7844")
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert read_elevation(path).attrs["crs_unit"] == "degree"
    with pytest.raises(MissingDependencyError, match=r"b\.npz is in EPSG:7844, and rasterio"):
        read_elevation(tmp_path / "b.npz")


def test_a_map_cut_short_says_what_failed(tmp_path, map_with_holes):
    path = write_elevation(tmp_path / "a.tif", map_with_holes)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FormatError, match=r"raster: (?!.*previous exception).*[^.]\. It may be cut short"):
        read_elevation(path)


def test_a_map_by_its_edges_in_degrees(tmp_path):
    np.savez(tmp_path / "a.npz", elevation=np.ones((10, 20)), xmin=-84.0, xmax=-83.8, ymin=36.5, ymax=36.4)
    read = read_elevation(tmp_path / "a.npz")
    assert read.attrs["crs"] == "EPSG:4326"
    assert read.attrs["crs_unit"] == "degree"
    np.testing.assert_allclose(read.attrs["transform"], (0.01, 0.0, -84.0, 0.0, -0.01, 36.5))
    assert holds_elevation(tmp_path / "a.npz")


def test_bare_arrays_have_no_place(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((9, 9)))
    assert "transform" not in read_elevation(tmp_path / "a.npy").attrs


def test_refusals(tmp_path, map_with_holes, monkeypatch):
    with pytest.raises(FileAccessError, match="does not exist"):
        read_elevation(tmp_path / "none.tif")
    (tmp_path / "a.txt").write_text("1")
    with pytest.raises(FormatError, match=r"ends in '\.txt'; expected \.tif"):
        read_elevation(tmp_path / "a.txt")
    (tmp_path / "b.tif").write_bytes(b"II*\x00cut")
    with pytest.raises(FormatError, match="cannot be read as a raster"):
        read_elevation(tmp_path / "b.tif")
    np.savez(tmp_path / "c.npz", one=np.ones(3), two=np.ones(3))
    with pytest.raises(FormatError, match="expected a map of numbers"):
        read_elevation(tmp_path / "c.npz")
    np.savez(tmp_path / "f.npz", elevation=np.ones((9, 9)), transform=PLACE, crs="EPSG:foo")
    with pytest.raises(FormatError, match=r"f\.npz is in 'EPSG:foo', which is no known reference system"):
        read_elevation(tmp_path / "f.npz")
    np.savez(tmp_path / "d.npz", elevation=np.full((4, 4), np.nan))
    with pytest.raises(GeometryError, match=r"d\.npz holds no elevation: every cell is nodata"):
        read_elevation(tmp_path / "d.npz")
    with pytest.raises(ParameterError, match=r"ends in '\.png'; expected \.tif"):
        write_elevation(tmp_path / "a.png", map_with_holes)
    with pytest.raises(GeometryError, match="square cells"):
        write_elevation(tmp_path / "a.asc", make_elevation(np.ones((4, 4)), (1.0, 0, 0, 0, -2.0, 0)))
    write_elevation(tmp_path / "e.tif", map_with_holes)
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'seismo3d\[terrain\]'"):
        read_elevation(tmp_path / "e.tif")
