from __future__ import annotations

import resource
from contextlib import nullcontext

import numpy as np
import pytest
import segyio
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import seismo3d as s3
from seismo3d.errors import FileAccessError, GeometryError, ParameterError, Seismo3dWarning
from seismo3d.geometry.axis import unit_of
from seismo3d.io._segy_encode import encode, ibm_words
from seismo3d.io._segy_layout import read_layout
from seismo3d.io._segy_samples import decode
from seismo3d.io.cubes import convert_cube
from seismo3d.io.segy import check_segy
from seismo3d.synthetic import fault_cube


def headers_of(path, order="big"):
    with segyio.open(path, ignore_geometry=True, endian=order) as file:
        return [dict(h) for h in file.header], file.text[0], dict(file.bin)


@pytest.fixture
def awkward(tmp_path, maker, rng):
    """Crossline-sorted, steps of 2, one missing, one duplicate, one dead trace, coordinates with a scalar, int16."""
    heads = maker.headers(range(10, 20, 2), range(3, 9), by="crossline")
    heads = [h | {181: 5 * h[193], 185: 7 * h[189], 71: -10, 109: 120, 1: k, 25: 7} for k, h in enumerate(heads)]
    heads = [*heads[:11], *heads[12:], heads[4] | {25: 8}]
    values = rng.integers(-900, 900, (30, 8))
    values[6] = 0
    return maker.write(tmp_path / "in.sgy", values, heads, code=3, text="C 1 AN AWKWARD FILE")


@pytest.mark.parametrize("lazy", [False, True])
@pytest.mark.parametrize("code", [1, 5])
def test_results_go_out_on_the_inputs_own_headers(awkward, tmp_path, lazy, code):
    cube = s3.open_cube(awkward, lazy=lazy)
    result = s3.write_segy(tmp_path / "out.sgy", cube * 2, like=awkward, sample_format=code)
    back = s3.open_cube(result)
    np.testing.assert_array_equal(back.values, cube.values * 2)
    before, after = headers_of(awkward), headers_of(result)
    assert before[0] == after[0]
    assert before[1] == after[1]
    assert {k for k in before[2] if before[2][k] != after[2][k]} == {segyio.BinField.Format}
    for name in cube.coords:
        np.testing.assert_array_equal(back[name].values, cube[name].values)


def test_the_input_is_found_by_itself(awkward, tmp_path):
    cube = s3.open_cube(awkward)
    back = s3.open_cube(s3.write_segy(tmp_path / "out.sgy", cube))
    assert (back.attrs["n_duplicates"], back.attrs["sorting"]) == (1, "unsorted")
    assert back.attrs["text_header"] == cube.attrs["text_header"]


def test_headers_are_not_made_unasked_when_the_input_has_gone(awkward, tmp_path):
    cube = s3.open_cube(awkward)
    awkward.rename(tmp_path / "moved.sgy")
    with pytest.raises(
        FileAccessError, match=r"in\.sgy, which the cube was opened from, is not there any more.*like=None"
    ):
        s3.write_segy(tmp_path / "out.sgy", cube)
    assert not (tmp_path / "out.sgy").exists()
    assert s3.open_cube(s3.write_segy(tmp_path / "made.sgy", cube, like=None)).attrs["n_duplicates"] == 0
    again = s3.write_segy(tmp_path / "again.sgy", cube, like=tmp_path / "moved.sgy")
    assert headers_of(again)[0] == headers_of(tmp_path / "moved.sgy")[0]


def test_headers_are_not_made_unasked_when_the_lines_are_others(awkward, tmp_path):
    cube = s3.open_cube(awkward)
    between = cube.assign_coords(inline=cube.inline + 1)
    with pytest.raises(GeometryError, match=r"not all are among the 5 of.*like=None"):
        s3.write_segy(tmp_path / "out.sgy", between)
    back = s3.open_cube(s3.write_segy(tmp_path / "made.sgy", between, like=None))
    np.testing.assert_array_equal(back.inline, between.inline)


def test_a_store_outlives_the_file_it_was_converted_from(awkward, tmp_path):
    convert_cube(awkward, tmp_path / "store.zarr")
    with_file = s3.open_cube(s3.write_segy(tmp_path / "a.sgy", s3.open_cube(tmp_path / "store.zarr")))
    assert with_file.attrs["n_duplicates"] == 1
    awkward.unlink()
    alone = s3.open_cube(s3.write_segy(tmp_path / "b.sgy", s3.open_cube(tmp_path / "store.zarr")))
    assert alone.attrs["n_duplicates"] == 0
    np.testing.assert_array_equal(alone.values, with_file.values)


def test_a_bare_array_takes_the_geometry_of_like(awkward, tmp_path, rng):
    values = rng.standard_normal((5, 6, 8)).astype(np.float32)
    back = s3.open_cube(s3.write_segy(tmp_path / "out.sgy", values, like=awkward, sample_format=5))
    live = np.isfinite(back.values).all(axis=2)
    np.testing.assert_array_equal(back.values[live], values[live])
    assert int((~live).sum()) == 1
    with pytest.raises(GeometryError, match=r"array has shape \(5, 7, 8\).*5 x 6 lines"):
        s3.write_segy(tmp_path / "no.sgy", np.zeros((5, 7, 8)), like=awkward)


def test_a_part_of_the_cube_keeps_its_headers(awkward, tmp_path):
    cube = s3.open_cube(awkward)
    part = cube.isel(inline=slice(1, 4), crossline=[5, 1, 2], time=slice(2, 6))
    back = s3.open_cube(s3.write_segy(tmp_path / "part.sgy", part, like=awkward))
    np.testing.assert_array_equal(back.values, part.sortby("crossline").reindex(crossline=back.crossline).values)
    np.testing.assert_array_equal(back.time, part.time)
    other = cube.assign_coords(inline=cube.inline + 1)
    with pytest.raises(GeometryError, match="not all are among the 5 of"):
        s3.write_segy(tmp_path / "no.sgy", other, like=awkward)


def test_little_endian_stays_little_endian(tmp_path, maker):
    source = maker.write(tmp_path / "a.sgy", np.arange(18).reshape(6, 3), maker.headers([1, 2], [1, 2, 3]), order="<")
    cube = s3.open_cube(source)
    for code in (1, 5):
        out = s3.write_segy(tmp_path / "b.sgy", cube, sample_format=code)
        with segyio.open(out, endian="little") as file:
            np.testing.assert_array_equal(segyio.tools.cube(file), cube.values)
        np.testing.assert_array_equal(s3.open_cube(out).values, cube.values)


@pytest.mark.parametrize("lazy", [False, True])
def test_without_like_the_headers_are_made(awkward, tmp_path, lazy):
    cube = s3.open_cube(awkward, lazy=lazy)
    out = s3.write_segy(tmp_path / "out.sgy", cube, like=None, title="Likelihood of faults")
    back = s3.open_cube(out)
    np.testing.assert_array_equal(back.values, cube.values)
    for name in ("inline", "crossline", "time", "cdp_x", "cdp_y", "live"):
        np.testing.assert_array_equal(back[name].values, cube[name].values)
    assert "Likelihood of faults" in back.attrs["text_header"]
    assert back.attrs["n_duplicates"] == 0
    with segyio.open(out, strict=False) as file:
        assert file.tracecount == 29
        assert file.header[3][segyio.TraceField.INLINE_3D] == 10


def test_depth_line_and_odd_axes_survive(tmp_path):
    section = s3.as_cube(np.arange(12.0).reshape(3, 4), domain="depth", interval=2.5, start=-7.25)
    section = section.assign_coords(cdp_x=("trace", [1.25, 2.5, 3.75]), cdp_y=("trace", [0.0, 1.0, 2.0]))
    back = s3.open_cube(s3.write_segy(tmp_path / "a.sgy", section))
    assert back.dims == ("trace", "depth")
    np.testing.assert_array_equal(back.values, section.values)
    np.testing.assert_allclose(back.depth, section.depth)
    np.testing.assert_allclose(back.cdp_x, section.cdp_x, atol=0.005)  # centimetres are stored


def section_from(start):
    section = s3.as_cube(np.ones((3, 4), np.float32), domain="depth", interval=2.5)
    return section.assign_coords(depth=section.depth + start)


@pytest.mark.parametrize("start", [2345.5, -7.25, 40000.0, np.float32(100.1), 1e5])
def test_starts_come_back(tmp_path, start):
    section = section_from(start)
    back = s3.open_cube(s3.write_segy(tmp_path / "a.sgy", section), domain="depth")
    np.testing.assert_allclose(back.depth, section.depth, rtol=1e-7)  # single precision


@pytest.mark.parametrize("start", [3500.5, 327.6875, 1234567.0])
def test_starts_that_headers_cannot_hold_are_refused(tmp_path, start):
    with pytest.raises(GeometryError, match=rf"starts at {start:.10g}; expected a whole number.*write Zarr"):
        s3.write_segy(tmp_path / "a.sgy", section_from(start))
    assert not list(tmp_path.iterdir())


def test_a_crop_whose_start_headers_cannot_hold_is_refused(tmp_path, maker):
    heads = maker.headers([1, 2], [1, 2, 3], b109=3500)
    source = maker.write(tmp_path / "a.sgy", np.ones((6, 4)), heads, interval=500)
    cube = s3.open_cube(source, domain="depth")
    part = cube.isel(depth=slice(1, None))
    assert float(part.depth[0]) == 3500.5
    with pytest.raises(GeometryError, match=r"starts at 3500\.5"):
        check_segy(part)
    for like in ("input", None):
        with pytest.raises(GeometryError, match=r"starts at 3500\.5"):
            s3.write_segy(tmp_path / "b.sgy", part, like=like)
    whole = s3.open_cube(s3.write_segy(tmp_path / "b.sgy", cube.isel(depth=slice(2, None))))
    assert float(whole.depth[0]) == 3501.0


def test_headers_that_mean_the_cubes_samples_stay(tmp_path, maker):
    # tens of thousands of metres, and no interval but the one that is assumed
    heads = maker.headers([1, 2], [1, 2, 3], b109=6000, b215=10)
    source = maker.write(tmp_path / "a.sgy", np.ones((6, 4)), heads)
    out = s3.write_segy(tmp_path / "b.sgy", s3.open_cube(source))
    assert headers_of(out)[0] == headers_of(source)[0]


def test_traces_of_one_sample_keep_their_interval(tmp_path, maker):
    source = maker.write(tmp_path / "a.sgy", np.ones((6, 1)), maker.headers([1, 2], [1, 2, 3], b109=8))
    out = s3.write_segy(tmp_path / "b.sgy", s3.open_cube(source))
    assert out.read_bytes() == source.read_bytes()


@pytest.mark.parametrize("name", ["inline", "crossline", "cdp"])
@pytest.mark.parametrize("numbers", [[0.0, 0.5, 1.0], [1.0, np.nan, 3.0], [0.0, 1.0, 3e9]])
def test_line_numbers_that_are_not_whole_are_refused(tmp_path, name, numbers):
    line = s3.as_cube(np.ones((3, 4)), interval=4.0).assign_coords({name: ("trace", numbers)})
    cubes = [line]
    if name != "cdp" and np.isfinite(numbers).all():
        cube = s3.as_cube(np.ones((3, 3, 4)), interval=4.0)
        cubes.append(cube.assign_coords({name: numbers}))
    for cube in cubes:
        with pytest.raises(GeometryError, match=f"cube has {name} .*; expected whole numbers"):
            check_segy(cube)
        with pytest.raises(GeometryError, match="expected whole numbers"):
            s3.write_segy(tmp_path / "a.sgy", cube)
    assert not list(tmp_path.iterdir())


def test_line_numbers_are_rounded_not_cut(tmp_path):
    cube = s3.as_cube(np.ones((3, 3, 4)), interval=4.0)
    cube = cube.assign_coords(inline=np.array([1.0, 2.0, 3.0]) - 1e-9)
    back = s3.open_cube(s3.write_segy(tmp_path / "a.sgy", cube))
    np.testing.assert_array_equal(back.inline, [1, 2, 3])


def test_all_that_writing_would_refuse_is_refused_before(awkward, tmp_path):
    cube = s3.open_cube(awkward)
    check_segy(cube)
    check_segy(s3.as_cube(np.ones((2, 2, 2)), interval=4.0))
    coarse = s3.as_cube(np.ones((2, 2, 2)), interval=50.0)
    odd = s3.as_cube(np.ones((2, 2, 2)), interval=4.0)
    odd.attrs["sample_unit"] = "fortnights"
    between = cube.assign_coords(inline=cube.inline + 1)
    for bad, words in ((coarse, "interval of 50"), (odd, "fortnights"), (between, "not all are among the 5 of")):
        with pytest.raises(GeometryError, match=words):
            check_segy(bad)
    convert_cube(awkward, tmp_path / "store.zarr")
    store = s3.open_cube(tmp_path / "store.zarr")
    awkward.unlink()
    with pytest.raises(FileAccessError, match="is not there any more"):
        check_segy(cube)
    check_segy(store)
    with pytest.raises(GeometryError, match="expected whole numbers"):
        check_segy(store.assign_coords(inline=store.inline + 0.5))


def test_a_domain_that_was_given_is_written_down(tmp_path, maker):
    source = maker.write(tmp_path / "a.sgy", np.ones((6, 3)), maker.headers([1, 2], [1, 2, 3]))
    cube = s3.open_cube(source, domain="depth")
    assert s3.open_cube(s3.write_segy(tmp_path / "b.sgy", cube)).dims[2] == "depth"


def test_what_is_not_finite_becomes_the_fill(tmp_path, awkward):
    cube = s3.open_cube(awkward)
    throw = cube.where(cube > 0)
    assert (~np.isfinite(throw.values[cube.live.values])).any()
    for like in (awkward, None):
        back = s3.open_cube(s3.write_segy(tmp_path / "t.sgy", throw, like=like, fill=-9.0))
        assert (back.values[0, 0] == np.where(cube.values[0, 0] > 0, cube.values[0, 0], -9.0)).all()
        np.testing.assert_array_equal(back.values[cube.live.values], throw.fillna(-9.0).values[cube.live.values])


@pytest.mark.parametrize("fill", [np.nan, np.inf, 1e39, "nothing"])
def test_a_fill_that_no_sample_can_be_is_refused_though_all_are_finite(tmp_path, fill):
    with pytest.raises(ParameterError, match=r"^fill is .*; expected a (finite )?number"):
        s3.write_segy(tmp_path / "t.sgy", np.zeros((2, 3, 4)), fill=fill)
    with pytest.raises(ParameterError, match=r"^title is .*; expected str\. Give text, or leave it out"):
        s3.write_segy(tmp_path / "t.sgy", np.zeros((2, 3, 4)), title=np.zeros(3))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("lazy", [False, True])
@pytest.mark.parametrize("like", ["input", None])
def test_samples_too_large_for_single_precision_are_refused(tmp_path, maker, lazy, like):
    source = maker.write(tmp_path / "in.sgy", np.full((6, 4), 1e60), maker.headers([1, 2], [1, 2, 3]), code=6)
    with pytest.raises(ParameterError, match=r"samples up to 1e\+60; expected at most 3.4e\+38"):
        s3.write_segy(tmp_path / "out.sgy", s3.open_cube(source, lazy=lazy), like=like)
    assert [path.name for path in tmp_path.iterdir()] == ["in.sgy"]


def test_samples_too_small_for_single_precision_are_told(tmp_path):
    # a trace as weak among others is none: filters leave such tails
    cube = np.full((9, 9, 16), 1.0)
    cube[3] = 1e-50
    s3.write_segy(tmp_path / "tails.sgy", cube)
    with pytest.warns(Seismo3dWarning, match=r"cube has no sample larger than 1e-50; expected 1e-35.*Scale them up"):
        s3.write_segy(tmp_path / "out.sgy", cube * 1e-50)


@pytest.mark.parametrize(
    ("value", "is_told"), [(2**24 + 1, True), (2**24, False), (2**30, False), (2**24 + 1.5, False)]
)
def test_whole_numbers_that_are_rounded_are_told(tmp_path, value, is_told):
    cube = s3.as_cube(np.full((2, 3, 4), value), interval=4.0)
    with pytest.warns(Seismo3dWarning, match="whole numbers beyond 16777216") if is_told else nullcontext():
        back = s3.open_cube(s3.write_segy(tmp_path / "a.sgy", cube))
    assert (back == np.float32(value)).all()


@given(
    arrays(np.float32, 20, elements=st.floats(width=32, allow_nan=False, allow_infinity=False, allow_subnormal=False))
)
@settings(max_examples=60, deadline=None)
def test_ibm_words_are_nearest(values):
    words = ibm_words(values).astype(np.int64)
    exact = (words & 0xFFFFFF) / 2.0**24 * 16.0 ** (((words >> 24) & 127) - 64) * np.where(words >> 31, -1, 1)
    # a base-16 fraction of 24 bits is at least 1/16: half of its last bit is at most 2^-21 of the value
    np.testing.assert_allclose(exact, values, rtol=2.0**-21, atol=0)


def test_ibm_words_are_what_segyio_reads(tmp_path, rng):
    values = (rng.standard_normal((4, 50)) * 10.0 ** rng.integers(-9, 9, (4, 50))).astype(np.float32)
    out = s3.write_segy(tmp_path / "a.sgy", values, like=None, sample_format=1)
    with segyio.open(out, ignore_geometry=True) as file:
        np.testing.assert_allclose(file.trace.raw[:], values, rtol=2.0**-21)
    layout = read_layout(out)
    np.testing.assert_array_equal(decode(encode(values, 1, 0.0), layout), decode(layout.map_traces()["data"], layout))


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError(28, "No space left on device"), ValueError("x")])
def test_nothing_half_written_stays(awkward, tmp_path, stop):
    old = tmp_path / "out.sgy"
    old.write_bytes(b"an older result")

    def interrupt(*_):
        raise stop

    with pytest.raises((KeyboardInterrupt, FileAccessError, ValueError)):
        s3.write_segy(old, s3.open_cube(awkward), progress=interrupt)
    assert old.read_bytes() == b"an older result"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in.sgy", "out.sgy"]


def test_a_full_disk_is_one_line_and_leaves_nothing(awkward, tmp_path):
    # a limit on the size of files makes the system refuse the write, as a full disk does
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    cube = s3.open_cube(awkward)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, hard))
    try:
        with pytest.raises(FileAccessError, match=r"out\.sgy cannot be written: File too large"):
            s3.write_segy(tmp_path / "out.sgy", cube)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [p.name for p in tmp_path.iterdir()] == ["in.sgy"]


def test_refusals(awkward, tmp_path):
    cube = s3.open_cube(awkward)
    with pytest.raises(ParameterError, match="is the file that the cube was read from"):
        s3.write_segy(awkward, cube)
    with pytest.raises(ParameterError, match="sample_format is 3"):
        s3.write_segy(tmp_path / "a.sgy", cube, sample_format=3)
    with pytest.raises(FileAccessError, match="is not a folder"):
        s3.write_segy(tmp_path / "no" / "a.sgy", cube)
    with pytest.raises(FileAccessError, match="is a directory"):
        s3.write_segy(tmp_path, cube)
    with pytest.raises(GeometryError, match="expected numbers that grow downwards"):
        s3.write_segy(tmp_path / "a.sgy", cube.assign_coords(time=-cube.time))
    with pytest.raises(GeometryError, match="sample interval of 50"):
        s3.write_segy(tmp_path / "a.sgy", s3.as_cube(np.ones((2, 2, 2)), interval=50.0))
    with pytest.raises(GeometryError, match="There is nothing to write"):
        s3.write_segy(tmp_path / "a.sgy", np.full((2, 2, 2), np.nan))
    assert [p.name for p in tmp_path.iterdir()] == ["in.sgy"]


@pytest.mark.parametrize(
    "name", ["f3.sgy", "ex1_missing_traces_75x71x26.segy", "31_81_PR.sgy", "volve10-migvel-depth-sub3d.sgy"]
)
def test_real_files_come_back(real_data, tmp_path, name):
    source = real_data / "seismic" / "segy" / name
    cube = s3.open_cube(source)
    back = s3.open_cube(s3.write_segy(tmp_path / "a.sgy", cube))
    assert back.dims == cube.dims
    np.testing.assert_array_equal(back.values, cube.values)
    before, after = headers_of(source)[0], headers_of(tmp_path / "a.sgy")[0]
    assert before == after


def on_the_map(spacing, origin):
    """A small cube whose traces lie so far apart on the map."""
    cube = fault_cube("clean", shape=(16, 16, 32), seed=1, population=None).to_dataarray(bin_m=(spacing, spacing))
    shift = {name: cube[name] - float(cube[name][0, 0]) + origin for name in ("cdp_x", "cdp_y")}
    return cube.assign_coords(shift)


@pytest.mark.parametrize(("spacing", "origin", "scalar"), [(12.5, 6e5, -100), (0.02, 500.0, -1000), (25.0, 3e7, -10)])
def test_map_coordinates_are_scaled_so_that_traces_stay_apart(tmp_path, spacing, origin, scalar):
    cube = on_the_map(spacing, origin)
    out = s3.write_segy(tmp_path / "a.sgy", cube, like=None)
    with segyio.open(out, ignore_geometry=True) as file:
        assert file.header[0][segyio.TraceField.SourceGroupScalar] == scalar
    back = s3.open_cube(out)
    for name in ("cdp_x", "cdp_y"):
        np.testing.assert_allclose(back[name], cube[name], atol=0.5 / abs(scalar) + 1e-6)


def test_the_finer_axis_tells_how_finely_coordinates_are_kept():
    cube = on_the_map(12.5, 500.0)
    narrow = cube.assign_coords(
        cdp_x=cube.cdp_x * 0.0 + 4.5 + 2.2e-4 * cube.crossline, cdp_y=cube.cdp_y * 0.0 + cube.inline
    )
    for part in (narrow, narrow[:, :4], narrow[:4]):
        with pytest.raises(GeometryError, match="apart on the map"):
            check_segy(part)
    check_segy(cube)
    check_segy(cube.values)


def test_degrees_are_refused_where_rounding_would_put_traces_together(tmp_path):
    with pytest.raises(GeometryError, match="Project degrees to metres"):
        s3.write_segy(tmp_path / "a.sgy", on_the_map(0.00038, 4.5), like=None)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(("depth", "length"), [("ft", "m"), ("m", "ft")])
def test_depth_and_map_in_other_units_are_refused(tmp_path, depth, length):
    axes = {"inline": np.arange(3), "crossline": np.arange(4), "depth": ("depth", 5.0 * np.arange(6), {"units": depth})}
    at = np.meshgrid(10.0 * np.arange(3), 10.0 * np.arange(4), indexing="ij")
    axes |= {n: (("inline", "crossline"), a, {"units": length}) for n, a in zip(("cdp_x", "cdp_y"), at, strict=True)}
    cube = xr.DataArray(np.ones((3, 4, 6), np.float32), dims=("inline", "crossline", "depth"), coords=axes)
    with pytest.raises(GeometryError, match=f"depth in {depth} and map coordinates in {length}"):
        s3.write_segy(tmp_path / "a.sgy", cube)
    assert not list(tmp_path.iterdir())
    for name in ("cdp_x", "cdp_y"):
        cube[name].attrs["units"] = depth
    s3.write_segy(tmp_path / "a.sgy", cube)
    assert unit_of(s3.open_cube(tmp_path / "a.sgy", domain="depth")) == depth
