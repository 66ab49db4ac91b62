from __future__ import annotations

import dataclasses
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section

from seismo3d.errors import FileAccessError, FormatError, GeometryError, ParameterError
from seismo3d.io.archive import read_archive, write_archive
from seismo3d.seismic.faultset import FaultSet, FaultSurface


def assert_same_surfaces(found: FaultSet, expected: FaultSet) -> None:
    assert len(found.surfaces) == len(expected.surfaces)
    for a, b in zip(found.surfaces, expected.surfaces, strict=True):
        for field in dataclasses.fields(FaultSurface):
            x, y = getattr(a, field.name), getattr(b, field.name)
            if isinstance(y, np.ndarray):
                np.testing.assert_array_equal(x, y)
                assert x.dtype == y.dtype
            else:
                assert x == y
                assert type(x) is type(y)


def test_round_trip_keeps_every_array_setting_and_coordinate(tmp_path: Path) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    file = faults.save(tmp_path / "new" / "folder")
    assert file == tmp_path / "new" / "folder" / "faultset.npz"
    found = FaultSet.load(tmp_path / "new" / "folder")
    assert_same_surfaces(found, faults)
    assert found.settings == faults.settings
    assert type(found.settings["scales"]) is tuple
    assert isinstance(found.settings["rate"], np.float32)
    for name in ("likelihood", "labels", "throw"):
        a, b = getattr(found, name), getattr(faults, name)
        assert a.identical(b)  # values, names, dims, coordinates and attributes
        assert a.dtype == b.dtype
        for key in b.coords:
            assert a[key].dtype == b[key].dtype


def test_round_trip_of_section_bare_arrays_and_no_faults(tmp_path: Path) -> None:
    section, faults = make_section()
    faults.save(tmp_path / "a")
    found = FaultSet.load(tmp_path / "a")
    assert_same_surfaces(found, faults)
    assert found.throw.identical(faults.throw)
    bare = FaultSet((), np.zeros((3, 4, 5), np.float32), np.zeros((3, 4, 5), np.int32), np.full((3, 4, 5), np.nan))
    bare.save(tmp_path / "b")
    found = FaultSet.load(tmp_path / "b")
    assert found.surfaces == ()
    assert isinstance(found.labels, np.ndarray)
    np.testing.assert_array_equal(found.throw, bare.throw)
    assert section.shape == (60, 50)


def test_lazy_volumes_are_saved(tmp_path: Path) -> None:
    faults = make_faults(make_cube())
    lazy = dataclasses.replace(faults, labels=faults.labels.chunk({"inline": 5}))
    lazy.save(tmp_path)
    np.testing.assert_array_equal(FaultSet.load(tmp_path).labels.values, faults.labels.values)


def test_file_holds_no_pickle_and_is_plain_npz(tmp_path: Path) -> None:
    faults = make_faults(make_cube())
    file = faults.save(tmp_path)
    with np.load(file, allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["labels"], faults.labels.values)
        assert all(arrays[name].dtype != object for name in arrays.files if name != "meta.json")


def test_failed_save_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    faults = make_faults(make_cube())
    file = faults.save(tmp_path)
    before = file.read_bytes()
    bad = dataclasses.replace(faults, settings={"callback": print})
    with pytest.raises(ParameterError, match=r"meta\['settings'\]\['callback'\] is a builtin"):
        bad.save(tmp_path)
    assert file.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["faultset.npz"]


def test_load_refuses_what_is_not_a_fault_set(tmp_path: Path) -> None:
    with pytest.raises(FileAccessError, match=r"holds no faultset\.npz"):
        FaultSet.load(tmp_path)
    file = make_faults(make_cube()).save(tmp_path)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FormatError, match="damaged"):
        FaultSet.load(tmp_path)
    damaged = bytearray(whole)
    damaged[len(whole) // 3] ^= 0xFF
    file.write_bytes(bytes(damaged))
    with pytest.raises(FormatError, match="damaged"):
        FaultSet.load(tmp_path)
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("meta.json", '{"dict": [["format", "seismo3d faults"], ["version", 99]]}')
    with pytest.raises(FormatError, match="version 99; expected"):
        FaultSet.load(tmp_path)


@pytest.mark.parametrize(
    ("key", "value"),
    [("surfaces", 3), ("surfaces", [3]), ("surfaces", [{"confidence": 1.0}]), ("volumes", []), ("volumes", None),
     ("settings", 3), ("volumes", {"likelihood": {"dims": 3, "coords": 4}})],
)  # fmt: skip
def test_a_damaged_description_is_refused(tmp_path: Path, key: str, value: object) -> None:
    file = make_faults(make_cube()).save(tmp_path)
    arrays, meta = read_archive(file)
    write_archive(file, arrays, meta=meta | {key: value})
    with pytest.raises(FormatError, match=r"faultset\.npz is no fault set, or is damaged"):
        FaultSet.load(tmp_path)
    write_archive(file, arrays, meta={name: held for name, held in meta.items() if name != key})
    with pytest.raises(FormatError, match=f"damaged or cut short: '{key}'"):
        FaultSet.load(tmp_path)


def test_save_refuses_a_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FileAccessError, match="cannot be made"):
        make_faults(make_cube()).save(tmp_path / "file")


def test_throw_in_units_follows_the_sample_interval() -> None:
    surface = make_faults(make_cube()).surfaces[0]
    np.testing.assert_allclose(surface.throw_ms, 4.0 * surface.throw)
    assert np.isnan(surface.throw_ms[:3]).all()
    with pytest.raises(GeometryError, match="throw_m is asked of a surface whose samples are in ms"):
        _ = surface.throw_m
