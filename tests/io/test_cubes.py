from __future__ import annotations

import json
import os
import platform
import re
import resource
import tracemalloc

import dask.array as da
import numpy as np
import pytest
import xarray as xr

import seismo3d as s3
from seismo3d.errors import FileAccessError, FormatError, GeometryError, ParameterError, ShapeError
from seismo3d.geometry.axis import length_unit_of
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.io import cubes
from seismo3d.io.cubes import convert_cube, write_npy
from seismo3d.io.summary import summarise
from seismo3d.io.zarr_store import read_zarr, write_zarr


@pytest.fixture
def segy(tmp_path, maker, rng):
    heads = maker.headers(range(10, 20, 2), range(3, 9))
    heads = [h | {181: 3 * h[193] + h[189], 185: 7 * h[189] - h[193], 71: 1} for h in heads]
    values = rng.integers(-900, 900, (29, 8))
    values[6] = 0
    return maker.write(tmp_path / "in.sgy", values, [*heads[:12], *heads[13:]], code=3)


def same(a, b):
    xr.testing.assert_identical(a.drop_attrs(), b.drop_attrs())


def test_as_cube_takes_arrays_and_cubes_and_turns_axes():
    values = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    cube = s3.as_cube(values, domain="depth", interval=5, start=100)
    assert cube.dims == ("inline", "crossline", "depth")
    assert cube.depth.values.tolist() == [100, 105, 110, 115]
    assert cube.attrs["sample_unit"] == "m"
    assert s3.as_cube(values).attrs["sample_unit"] == "samples"
    assert s3.as_cube(values[0]).dims == ("trace", "time")
    xr.testing.assert_identical(s3.as_cube(cube.transpose("depth", "crossline", "inline")), cube)
    lazy = s3.as_cube(da.from_array(values, chunks=(1, 3, 4)))
    assert lazy.chunks is not None
    plain = xr.DataArray(values, dims=("inline", "crossline", "time"))
    assert s3.as_cube(plain).time.values.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (np.zeros(4), r"cube has shape \(4,\)"),
        (np.zeros((2, 0, 3)), "it is empty"),
        (np.array([["a", "b"]]), "expected real numbers"),
        (np.zeros((2, 2), dtype=complex), "expected real numbers"),
        (xr.DataArray(np.zeros((2, 2)), dims=("x", "time")), "expected .inline, crossline, time or depth."),
        (xr.Dataset({"a": ("x", [1])}), "Select one of"),
    ],
)
def test_as_cube_refuses(bad, words):
    with pytest.raises(ShapeError, match=words):
        s3.as_cube(bad)


@pytest.mark.parametrize("lazy", [False, True])
def test_zarr_round_trip(segy, tmp_path, lazy):
    cube = s3.open_cube(segy, lazy=lazy)
    write_zarr(tmp_path / "a.zarr", cube, brick=3)
    back = s3.open_cube(tmp_path / "a.zarr")
    same(back, cube.compute())
    assert json.loads(json.dumps(back.attrs)) == back.attrs
    assert {k for k in cube.attrs if cube.attrs[k] != back.attrs[k]} == {"path", "file_format"}
    opened = s3.open_cube(tmp_path / "a.zarr", lazy=True)
    assert opened.data.chunksize == (3, 3, 3)
    same(opened.compute(), cube.compute())
    write_zarr(tmp_path / "a.zarr", cube.isel(inline=slice(0, 2)))
    assert s3.open_cube(tmp_path / "a.zarr").sizes["inline"] == 2


def test_sections_and_integers_in_zarr(tmp_path):
    section = s3.as_cube(np.arange(12, dtype=np.int32).reshape(3, 4), interval=2.0)
    same(s3.open_cube(write_zarr(tmp_path / "a.zarr", section)), section)


def test_attributes_survive_plain_xarray(segy, tmp_path):
    cube = s3.open_cube(segy)
    cube.to_dataset().to_zarr(tmp_path / "b.zarr", consolidated=False)
    assert s3.open_cube(tmp_path / "b.zarr").attrs["survey"] == cube.attrs["survey"]


def test_segy_to_zarr_to_segy_is_the_same_file_again(segy, tmp_path):
    convert_cube(segy, tmp_path / "a.zarr")
    convert_cube(tmp_path / "a.zarr", tmp_path / "b.sgy")
    convert_cube(tmp_path / "b.sgy", tmp_path / "c.sgy")
    assert (tmp_path / "b.sgy").read_bytes() == (tmp_path / "c.sgy").read_bytes()
    same(s3.open_cube(tmp_path / "b.sgy"), s3.open_cube(segy))


def test_zarr_to_segy_without_the_original_file(segy, tmp_path):
    cube = s3.open_cube(segy)
    convert_cube(segy, tmp_path / "a.zarr")
    segy.unlink()
    same(s3.open_cube(convert_cube(tmp_path / "a.zarr", tmp_path / "b.sgy")), cube)


@pytest.mark.parametrize("lazy", [False, True])
def test_a_store_takes_the_axis_that_is_given(segy, tmp_path, lazy):
    convert_cube(segy, tmp_path / "a.zarr")
    held = s3.open_cube(tmp_path / "a.zarr")
    same(s3.open_cube(tmp_path / "a.zarr", domain="time"), held)
    how = {"domain": "depth", "interval": 5.0, "start": 100.0}
    cube, read = (s3.open_cube(path, lazy=lazy, **how) for path in (tmp_path / "a.zarr", segy))
    assert cube.dims == ("inline", "crossline", "depth")
    assert cube["depth"].attrs["units"] == cube.attrs["sample_unit"] == "m"
    for name in ("survey", "domain_reason"):
        assert cube.attrs[name] == read.attrs[name]
    same(cube.compute(), read.compute())
    later = s3.open_cube(tmp_path / "a.zarr", start=8.0)
    np.testing.assert_array_equal(later.time - later.time[0], held.time - held.time[0])
    assert (float(later.time[0]), later.attrs["sample_unit"]) == (8.0, "ms")
    with pytest.raises(ParameterError, match="domain is 'twt'; expected 'time' or 'depth'"):
        s3.open_cube(tmp_path / "a.zarr", domain="twt")
    again = s3.open_cube(convert_cube(tmp_path / "a.zarr", tmp_path / "b.sgy", **how))
    same(again, read.compute())


def test_a_store_without_a_unit_gets_one_with_the_interval(tmp_path):
    write_zarr(tmp_path / "a.zarr", s3.as_cube(np.ones((3, 4), np.float32)))
    assert s3.open_cube(tmp_path / "a.zarr", domain="depth").attrs["sample_unit"] == "samples"
    section = s3.open_cube(tmp_path / "a.zarr", interval=2.0)
    same(section, s3.as_cube(np.ones((3, 4), np.float32), interval=2.0))
    assert section.attrs["sample_unit"] == "ms"


@pytest.mark.parametrize("name", ["a.zarr", "a.npy"])
@pytest.mark.parametrize("option", ["inline_byte", "crossline_byte", "x_byte", "y_byte"])
def test_options_that_do_not_serve_a_format_are_refused(segy, tmp_path, name, option):
    convert_cube(segy, tmp_path / name)
    with pytest.raises(ParameterError, match=rf"{option} is 9; expected none for .*{name}: it serves SEG-Y"):
        s3.open_cube(tmp_path / name, **{option: 9})
    for path in (segy, tmp_path / "a.npy"):
        with pytest.raises(ParameterError, match="variable is 'b'; expected none for"):
            s3.open_cube(path, variable="b")


def test_npy_and_npz(segy, tmp_path):
    cube = s3.open_cube(segy)
    convert_cube(segy, tmp_path / "a.npy")
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy"), cube.values)
    for lazy in (False, True):
        back = s3.open_cube(tmp_path / "a.npy", interval=4.0, lazy=lazy)
        np.testing.assert_array_equal(back.values, cube.values)
        assert (back.chunks is not None) is lazy
    np.savez(tmp_path / "b.npz", seismic=cube.values, lines=np.arange(3))
    assert s3.open_cube(tmp_path / "b.npz").shape == cube.shape
    np.savez(tmp_path / "c.npz", a=cube.values, b=cube.values)
    with pytest.raises(FormatError, match=r"2 arrays that could be the cube: \['a', 'b'\]"):
        s3.open_cube(tmp_path / "c.npz")
    assert s3.open_cube(tmp_path / "c.npz", variable="b").shape == cube.shape
    with pytest.raises(ParameterError, match="no array 'z'"):
        s3.open_cube(tmp_path / "c.npz", variable="z")


@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
@pytest.mark.parametrize("content", [b"", b"not numpy at all", b"\x93NUMPY\x01\x00v\x00{"])
def test_broken_numpy_files(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FormatError, match=r"is no (NumPy file of numbers|NPZ archive)") as error:
        s3.open_cube(tmp_path / name)
    assert "\n" not in str(error.value)


def test_pickles_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(FormatError, match="holds Python objects"):
        s3.open_cube(tmp_path / "a.npy")


def test_broken_zarr(tmp_path):
    with pytest.raises(FileAccessError, match="does not exist"):
        s3.open_cube(tmp_path / "no.zarr")
    (tmp_path / "file.zarr").write_text("x")
    with pytest.raises(FormatError, match="is a file; expected a folder"):
        s3.open_cube(tmp_path / "file.zarr")
    (tmp_path / "empty.zarr").mkdir()
    with pytest.raises((FormatError, FileAccessError), match=r"empty\.zarr"):
        s3.open_cube(tmp_path / "empty.zarr")
    (tmp_path / "bad.zarr").mkdir()
    (tmp_path / "bad.zarr" / "zarr.json").write_text("{")
    with pytest.raises(FormatError, match="is no Zarr group"):
        s3.open_cube(tmp_path / "bad.zarr")
    xr.Dataset({"a": ("x", [1, 2])}).to_zarr(tmp_path / "other.zarr", consolidated=False)
    with pytest.raises(FormatError, match=r"holds a \(x\); expected an array \(inline, crossline, time or depth\)"):
        s3.open_cube(tmp_path / "other.zarr")


def test_zarr_of_several_arrays_and_of_other_names(tmp_path, rng):
    values = rng.normal(size=(3, 4, 5))
    axes = {"iline": [7, 8, 9], "xline": [1, 2, 3, 4], "twt": 4.0 * np.arange(5)}
    places = {"cdp_x": (("iline", "xline"), rng.normal(size=(3, 4)))}
    arrays = {"data": (tuple(axes), values), "envelope": (tuple(axes), -values)}
    xr.Dataset({"data": arrays["data"]}, coords=axes | places).to_zarr(tmp_path / "a.zarr", consolidated=False)
    cube = s3.open_cube(tmp_path / "a.zarr")
    assert cube.dims == ("inline", "crossline", "time")
    assert (cube.inline.values[-1], cube.time.values[-1], cube.attrs["sample_unit"]) == (9, 16.0, "ms")
    np.testing.assert_array_equal(cube.values, values)
    np.testing.assert_array_equal(cube.cdp_x.values, places["cdp_x"][1])
    xr.Dataset(arrays, coords=axes).to_zarr(tmp_path / "b.zarr", consolidated=False)
    with pytest.raises(
        FormatError, match=r"holds the arrays \['data', 'envelope'\].*Name it by variable \(--variable\)"
    ):
        s3.open_cube(tmp_path / "b.zarr")
    np.testing.assert_array_equal(s3.open_cube(tmp_path / "b.zarr", variable="envelope").values, -values)
    with pytest.raises(ParameterError, match="has no array 'amp'; expected one of"):
        s3.open_cube(tmp_path / "b.zarr", variable="amp")


@pytest.mark.parametrize(("scale", "units", "is_told"), [(0.001, None, True), (0.001, "s", False), (1.0, None, False)])
def test_a_time_without_a_unit_that_is_hardly_in_ms_is_told(tmp_path, scale, units, is_told):
    time = ("time", scale * (400.0 + 4.0 * np.arange(5)), {} if units is None else {"units": units})
    axes = {"inline": np.arange(3), "crossline": np.arange(4), "time": time}
    made = xr.DataArray(np.ones((3, 4, 5)), dims=("inline", "crossline", "time"), coords=axes, name="amplitude")
    made.to_dataset().to_zarr(tmp_path / "a.zarr", consolidated=False)
    notes = s3.open_cube(tmp_path / "a.zarr").attrs.get("notes", [])
    assert ["steps of 0.004 and no unit: taken as ms" in note for note in notes] == [True] * is_told


def test_folders_that_are_no_zarr_are_not_overwritten(segy, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "precious").write_text("x")
    with pytest.raises(FileAccessError, match="is there and is no Zarr group"):
        write_zarr(tmp_path / "mine", s3.open_cube(segy))
    assert (tmp_path / "mine" / "precious").read_text() == "x"


@pytest.mark.parametrize("suffix", [".zarr", ".npy", ".sgy"])
def test_an_interrupted_conversion_leaves_nothing(segy, tmp_path, suffix):
    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        convert_cube(segy, tmp_path / f"out{suffix}", progress=interrupt)
    assert [p.name for p in tmp_path.iterdir()] == ["in.sgy"]


@pytest.mark.parametrize("suffix", [".zarr", ".npy"])
def test_a_full_disk_leaves_nothing(segy, tmp_path, suffix):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    cube = s3.open_cube(segy)
    resource.setrlimit(resource.RLIMIT_FSIZE, (150, hard))
    try:
        with pytest.raises(FileAccessError, match="cannot be written"):
            (write_zarr if suffix == ".zarr" else write_npy)(tmp_path / f"out{suffix}", cube)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [p.name for p in tmp_path.iterdir()] == ["in.sgy"]


@pytest.mark.parametrize("suffix", [".zarr", ".npy", ".sgy"])
def test_what_is_there_is_replaced_only_on_request(segy, tmp_path, suffix):
    target = convert_cube(segy, tmp_path / f"out{suffix}")
    before = s3.open_cube(target).values
    write_npy(tmp_path / "other.npy", np.ones((2, 3, 8), np.float32))
    with pytest.raises(FileAccessError, match="exists already"):
        convert_cube(tmp_path / "other.npy", target)
    np.testing.assert_array_equal(s3.open_cube(target).values, before)
    convert_cube(tmp_path / "other.npy", target, overwrite=True, interval=4.0)
    assert (s3.open_cube(target).values == 1.0).all()


@pytest.mark.parametrize("suffix", [".zarr", ".npy", ".sgy"])
def test_what_another_process_writes_is_left_to_it(segy, tmp_path, suffix):
    writes, target = os.getppid(), tmp_path / f"out{suffix}"
    half = tmp_path / f".out{suffix}.{platform.node()}.{writes}.part"
    half.touch()
    with pytest.raises(FileAccessError, match=rf"out{suffix} is being written by process {writes}. Wait for it"):
        convert_cube(segy, target)
    assert half.exists()
    assert not target.exists()
    half.unlink()
    convert_cube(segy, target)


def test_what_another_process_made_while_the_source_was_opened_stays(segy, tmp_path, monkeypatch):
    target, open_cube = tmp_path / "out.npy", cubes.open_cube

    def open_slowly(*given, **options):
        target.write_bytes(b"theirs")
        return open_cube(*given, **options)

    monkeypatch.setattr(cubes, "open_cube", open_slowly)
    with pytest.raises(FileAccessError, match="exists already"):
        convert_cube(segy, target)
    assert target.read_bytes() == b"theirs"


def test_source_is_never_the_target(segy, tmp_path):
    store = convert_cube(segy, tmp_path / "a.zarr")
    (tmp_path / "b.zarr").symlink_to(store)
    before = s3.open_cube(store).values
    for target, words in (
        (store, "is the input too"),
        (tmp_path / "b.zarr", "is the input too"),
        (store / "c.zarr", "lie in each other"),
    ):
        with pytest.raises(ParameterError, match=words):
            convert_cube(store, target, overwrite=True)
    inner = convert_cube(segy, store / "inner.npy")
    with pytest.raises(ParameterError, match="lie in each other"):
        convert_cube(inner, store, overwrite=True)
    inner.unlink()
    np.testing.assert_array_equal(s3.open_cube(store).values, before)


def test_convert_refuses_what_it_cannot_do(segy, tmp_path):
    with pytest.raises(ParameterError, match=r"expected \.sgy, \.segy, \.zarr or \.npy"):
        convert_cube(segy, tmp_path / "a.txt")
    with pytest.raises(ParameterError, match="is the input too"):
        convert_cube(segy, segy)
    with pytest.raises(FileAccessError, match="does not exist"):
        convert_cube(tmp_path / "no.sgy", tmp_path / "a.zarr")
    with pytest.raises(ParameterError, match="scan is 'no'"):
        s3.open_cube(segy, scan="no")


def test_traces_are_not_thinned_beyond_what_segy_holds(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(64, dtype=np.float32).reshape(2, 2, 16))
    with pytest.raises(ParameterError, match=r"every is 9; expected 1 to 8, for SEG-Y holds .* at most 32\.767 and"):
        convert_cube(tmp_path / "a.npy", tmp_path / "a.sgy", every=9, interval=4.0)
    thinned = s3.open_cube(convert_cube(tmp_path / "a.npy", tmp_path / "a.sgy", every=8, interval=4.0))
    assert thinned.time.values.tolist() == [0.0, 32.0]
    assert s3.open_cube(convert_cube(tmp_path / "a.npy", tmp_path / "a.zarr", every=9, interval=4.0)).sizes["time"] == 2
    with pytest.raises(GeometryError, match=r"interval of 40; expected 0\.001 to 32\.767"):
        convert_cube(tmp_path / "a.npy", tmp_path / "b.sgy", interval=40.0)


@pytest.mark.parametrize("suffix", [".sgy", ".zarr", ".npy"])
def test_traces_of_one_sample_are_converted(tmp_path, suffix):
    np.save(tmp_path / "a.npy", np.arange(6, dtype=np.float32).reshape(2, 3, 1))
    out = convert_cube(tmp_path / "a.npy", tmp_path / f"b{suffix}", interval=4.0)
    assert s3.open_cube(out).values.ravel().tolist() == [0, 1, 2, 3, 4, 5]
    with pytest.raises(ParameterError, match="every is 2; expected 1 to 1"):
        convert_cube(tmp_path / "a.npy", tmp_path / f"c{suffix}", interval=4.0, every=2)


def test_summary_counts_and_measures(segy):
    cube = s3.open_cube(segy)
    got = summarise(cube)
    assert got["traces"] == {"bins_looked_at": 30, "missing": 1, "dead": 1, "duplicate": 0, "sampled": False}
    finite = cube.values[np.isfinite(cube.values)].astype(np.float64)
    assert got["amplitude"]["min"] == finite.min()
    assert got["amplitude"]["rms"] == pytest.approx(np.sqrt((finite**2).mean()), rel=1e-12)
    assert got["axes"]["inline"] == {"first": 10, "last": 18, "step": 2, "n": 5}
    assert got["map"]["bin_size_m"] == pytest.approx([2 * np.hypot(1, 7), np.hypot(3, 1)])
    assert got["map"]["corners"][0] == pytest.approx([19, 67])
    assert json.loads(json.dumps(got)) == got


def test_summary_of_a_large_cube_is_sampled(monkeypatch, segy):
    monkeypatch.setattr("seismo3d.io.summary._SAMPLED_ABOVE", 100)
    got = summarise(s3.open_cube(segy, lazy=True))
    assert got["amplitude"]["sampled"]
    assert got["traces"]["missing"] == 1


def test_summary_of_a_lazy_cube_holds_a_slab_of_it_at_a_time(monkeypatch):
    monkeypatch.setattr("seismo3d.io.summary._SLAB", 2**20)
    monkeypatch.setattr("seismo3d.io.summary._PART", 2**17)
    cube = s3.as_cube(da.ones((64, 64, 2048), np.float32, chunks=(1, 64, 2048)))
    tracemalloc.start()
    got = summarise(cube)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert got["amplitude"] == {"min": 1.0, "max": 1.0, "mean": 1.0, "rms": 1.0, "n_not_finite": 0, "sampled": False}
    assert got["traces"]["bins_looked_at"] == 64 * 64
    assert peak < cube.nbytes / 4


def test_summary_of_bad_samples():
    values = np.ones((2, 2, 3))
    values[0, 0, 1] = np.inf
    values[1, 1] = np.nan
    assert summarise(values)["amplitude"]["n_not_finite"] == 1
    assert summarise(np.full((2, 3), np.nan))["amplitude"]["max"] is None


@pytest.mark.parametrize("size", [1e-300, 1e-200, 1.0, 1e200, 1e300])
def test_summary_of_amplitudes_whose_squares_double_precision_does_not_hold(size, monkeypatch):
    monkeypatch.setattr("seismo3d.io.summary._SLAB", 1)
    got = summarise(size * np.array([[3.0, -4.0], [0.0, 0.0], [5.0, 0.0]]))["amplitude"]
    assert got["rms"] == pytest.approx(size * np.sqrt(50 / 6), rel=1e-12)
    assert got["mean"] == pytest.approx(size * 4 / 6, rel=1e-12)


def test_a_zarr_store_that_declares_more_than_it_holds_is_refused(tmp_path):
    made = s3.as_cube(np.ones((4, 5, 6), np.float32), interval=4.0)
    write_zarr(tmp_path / "a.zarr", made)
    found = next(path for path in (tmp_path / "a.zarr").rglob("zarr.json") if path.parent.name == "amplitude")
    found.write_text(re.sub(r'"shape":\s*\[\s*4,\s*5,\s*6', '"shape": [4, 5, 20000000', found.read_text()))
    with pytest.raises(FormatError, match=r"a\.zarr"):
        s3.open_cube(tmp_path / "a.zarr")


def test_damaged_bricks_are_one_clear_line_also_where_they_are_read_late(tmp_path):
    write_zarr(tmp_path / "a.zarr", s3.as_cube(np.random.default_rng(0).normal(size=(4, 5, 6)), interval=4.0))
    brick = next(path for path in (tmp_path / "a.zarr" / "amplitude").rglob("0") if path.is_file())
    brick.write_bytes(b"no zstandard")
    lazy = read_zarr(tmp_path / "a.zarr", lazy_above=0)
    with pytest.raises(FormatError, match="no Zarr group whose bricks can be read"):
        lazy.compute()


def test_an_mdio_store_is_opened_as_it_is(tmp_path, rng):
    """The layout of MDIO 1: integer times, a mask of the traces, map coordinates named beside the samples."""
    store, samples = tmp_path / "survey.mdio", rng.normal(size=(5, 6, 20)).astype(np.float32)
    mask = np.ones((5, 6), bool)
    mask[4, 5] = False
    samples[~mask] = np.nan
    lateral = ("inline", "crossline")
    dataset = xr.Dataset(
        {"amplitude": ((*lateral, "time"), samples, {"statsV1": "{}"}), "trace_mask": (lateral, mask)},
        coords={
            "inline": np.arange(10, 15, dtype=np.int32), "crossline": np.arange(20, 26, dtype=np.int32),
            "time": np.arange(0, 80, 4, dtype=np.int32), "cdp_x": (lateral, np.zeros((5, 6))),
        },
        attrs={"apiVersion": "1.1.3", "name": "PostStack3DTime"},
    )  # fmt: skip
    dataset.to_zarr(store, zarr_format=3, consolidated=False)
    for lazy in (False, True):
        cube = s3.open_cube(store, lazy=lazy)
        assert cube.attrs["file_format"] == "MDIO"
        assert "statsV1" not in cube.attrs
        np.testing.assert_array_equal(cube.values, samples)
        np.testing.assert_array_equal(cube["live"], mask)
        assert cube["time"].dtype == np.float64
        assert cube["time"].values[-1] == 76.0
        assert (cube.attrs["sample_unit"], length_unit_of(cube)) == ("ms", "m")


def test_units_of_an_mdio_store_are_its_own(tmp_path):
    """Units are named by what they measure; a depth and a map in feet are not metres."""
    lateral, feet = ("inline", "crossline"), {"unitsV1": {"length": "ft"}}
    x, y = np.meshgrid(np.arange(5) * 82.0, np.arange(6) * 41.0, indexing="ij")
    xr.Dataset(
        {"amplitude": ((*lateral, "depth"), np.ones((5, 6, 20))), "trace_mask": (lateral, np.ones((5, 6), bool))},
        coords={
            "inline": np.arange(5), "crossline": np.arange(6), "depth": ("depth", np.arange(0, 400, 20), feet),
            "cdp_x": (lateral, x, feet), "cdp_y": (lateral, y, feet),
        },
        attrs={"apiVersion": "1.1.3"},
    ).to_zarr(tmp_path / "feet.mdio", zarr_format=3, consolidated=False)  # fmt: skip
    cube = s3.open_cube(tmp_path / "feet.mdio")
    assert (cube.attrs["sample_unit"], cube["depth"].attrs["units"], cube["cdp_x"].attrs["units"]) == ("ft", "ft", "ft")
    assert SurveyGeometry.from_cube(cube).length_unit == "ft"
    np.testing.assert_array_equal(cube["cdp_y"], y)
