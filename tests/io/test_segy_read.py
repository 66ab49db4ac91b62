from __future__ import annotations

import pickle
import threading

import numpy as np
import pytest
import segyio
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import seismo3d as s3
from seismo3d.errors import FormatError, GeometryError, ParameterError
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry
from seismo3d.io._segy_grid import _spread_rows, scanned_grid
from seismo3d.io._segy_layout import SegyLayout
from seismo3d.io.summary import summarise

INLINES, CROSSLINES, N_SAMPLES = np.arange(100, 105), np.arange(30, 44, 2), 9


def numbered(n_traces, n_samples=N_SAMPLES):
    """Every sample tells its trace and its place in it."""
    return (np.arange(n_traces)[:, None] * 10 + np.arange(n_samples) + 1) % 120


def full(maker, path, **keys):
    by = keys.pop("by", "inline")
    bytes_ = keys.pop("bytes_", (189, 193))
    more = {k: keys.pop(k) for k in list(keys) if k.startswith("b") and k[1:].isdigit() and int(k[1:]) <= 240}
    heads = maker.headers(INLINES, CROSSLINES, bytes_=bytes_, by=by, **more)
    return maker.write(path, numbered(len(heads)), heads, **keys)


@pytest.mark.parametrize("order", [">", "<"])
@pytest.mark.parametrize("code", [2, 3, 5, 6, 8, 10, 11, 16])
def test_every_sample_format_gives_the_stored_numbers(tmp_path, maker, code, order):
    path = full(maker, tmp_path / "a.sgy", code=code, order=order)
    cube = s3.open_cube(path)
    assert cube.dims == ("inline", "crossline", "time")
    np.testing.assert_array_equal(cube.values.reshape(-1, N_SAMPLES), numbered(35))
    with segyio.open(path, endian="little" if order == "<" else "big") as reference:
        np.testing.assert_array_equal(cube.values, segyio.tools.cube(reference))
        np.testing.assert_array_equal(cube.inline, reference.ilines)
        np.testing.assert_array_equal(cube.crossline, reference.xlines)
        np.testing.assert_array_equal(cube.time, reference.samples)


@pytest.mark.parametrize(("code", "value"), [(2, 2**31 - 3), (6, 1 / 3), (10, 2**32 - 1)])
def test_wide_formats_keep_every_bit(tmp_path, maker, code, value):
    path = maker.write(tmp_path / "a.sgy", np.full((4, 2), value), maker.headers([1, 2], [1, 2]), code=code)
    assert (s3.open_cube(path).values == value).all()


@pytest.mark.parametrize("order", [">", "<"])
def test_ibm_floats_are_what_the_standard_says(tmp_path, maker, order):
    words = [0x00000000, 0x41100000, 0xC276A000, 0x42640000, 0x40800000, 0x3F199999]
    known = [0.0, 1.0, -118.625, 100.0, 0.5, 0x199999 / 2**28]
    path = maker.write(tmp_path / "a.sgy", np.tile(words, (4, 1)), maker.headers([1, 2], [1, 2]), code=1, order=order)
    cube = s3.open_cube(path)
    np.testing.assert_allclose(cube.values[1, 1], known, rtol=1e-7)  # float32's own resolution
    assert cube.dtype == np.float32


@pytest.mark.parametrize("by", ["inline", "crossline"])
@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("lazy", [False, True])
def test_sorting_and_direction_of_lines_do_not_matter(tmp_path, maker, by, turn, lazy):
    heads = maker.headers(INLINES[::turn], CROSSLINES, by=by)
    path = maker.write(tmp_path / "a.sgy", [[h[189] % 7 * 16 + h[193] % 16] for h in heads], heads)
    cube = s3.open_cube(path, lazy=lazy)
    np.testing.assert_array_equal(cube.inline, INLINES)
    np.testing.assert_array_equal(cube.values[:, :, 0], INLINES[:, None] % 7 * 16 + CROSSLINES % 16)
    assert cube.attrs["sorting"] == by


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_subset_in_any_order_lands_where_its_headers_say(tmp_path, maker, data):
    heads = maker.headers(range(5, 13, 2), range(-3, 3))
    chosen = data.draw(st.permutations(heads))[: data.draw(st.integers(14, 24))]
    path = maker.write(tmp_path / "a.sgy", [[h[189] * 8 + h[193], 5] for h in chosen], chosen)
    cube = s3.open_cube(path)
    assert int(np.isfinite(cube.values[..., 0]).sum()) == len(chosen)
    for h in chosen:
        assert float(cube.sel(inline=h[189], crossline=h[193])[0]) == h[189] * 8 + h[193]
    lazy = s3.open_cube(path, lazy=True)
    np.testing.assert_array_equal(lazy.values, cube.values)
    np.testing.assert_array_equal(lazy.live.values, cube.live.values)


@pytest.mark.parametrize("pair", [(9, 21), (9, 13), (17, 21), (5, 21), (221, 225), (233, 237), (17, 229), (205, 1)])
def test_line_numbers_are_found_where_the_standard_bytes_are_empty(tmp_path, maker, pair):
    path = full(maker, tmp_path / "a.sgy", bytes_=pair)
    cube = s3.open_cube(path)
    assert (cube.attrs["inline_byte"], cube.attrs["crossline_byte"]) == pair
    assert "found by trial" in cube.attrs["header_bytes"]
    np.testing.assert_array_equal(cube.values.reshape(-1, N_SAMPLES), numbered(35))
    given_bytes = s3.open_cube(path, inline_byte=pair[0], crossline_byte=pair[1])
    assert given_bytes.attrs["header_bytes"] == "as given"
    np.testing.assert_array_equal(given_bytes.values, cube.values)


def test_a_running_trace_number_is_no_crossline(tmp_path, maker):
    heads = [h | {193: k + 1, 9: h[189], 21: h[193]} for k, h in enumerate(maker.headers(INLINES, CROSSLINES))]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads))
    assert cube.shape == (5, 7, N_SAMPLES)
    assert (cube.attrs["inline_byte"], cube.attrs["crossline_byte"]) == (9, 21)


def test_standard_bytes_win_over_others(tmp_path, maker):
    heads = [h | {9: h[193], 21: h[189]} for h in maker.headers(INLINES, CROSSLINES)]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads))
    assert cube.attrs["inline_byte"] == 189
    assert cube.sizes["inline"] == 5


def test_given_bytes_without_geometry_are_refused(tmp_path, maker):
    path = full(maker, tmp_path / "a.sgy")
    with pytest.raises(FormatError, match="no line numbers at bytes 9 and 21: 0 throughout"):
        s3.open_cube(path, inline_byte=9, crossline_byte=21)
    with pytest.raises(ParameterError, match="inline_byte is 300"):
        s3.open_cube(path, inline_byte=300)
    with pytest.raises(ParameterError, match="crossline_byte is 0"):
        s3.open_cube(path, crossline_byte=0)


def test_missing_duplicate_dead_and_padding_traces(tmp_path, maker):
    heads = maker.headers(INLINES, CROSSLINES)
    values = numbered(35)
    values[3] = 0
    heads, values = [*heads[:10], *heads[11:]], np.delete(values, 10, axis=0)
    heads, values = [*heads, heads[0], {189: 0, 193: 0}], np.vstack([values, values[:1] + 50, values[:1]])
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", values, heads))
    assert cube.shape == (5, 7, N_SAMPLES)
    assert np.isnan(cube.values[1, 3]).all()
    assert (cube.values[0, 3] == 0).all()
    np.testing.assert_array_equal(cube.values[0, 0], values[0])
    expected = np.ones((5, 7), dtype=bool)
    expected[1, 3] = expected[0, 3] = False
    np.testing.assert_array_equal(cube.live, expected)
    assert (cube.attrs["n_missing"], cube.attrs["n_duplicates"]) == (1, 1)
    notes = " ".join(cube.attrs["notes"])
    assert "1 duplicate traces: the first live one" in notes
    assert "1 traces numbered inline 0, crossline 0" in notes


@pytest.mark.parametrize("lazy", [False, True])
def test_of_traces_in_one_place_the_first_live_one_is_taken(tmp_path, maker, lazy):
    heads, values = maker.headers(INLINES, CROSSLINES), numbered(35)
    values[:2] = 0
    heads = [*heads, heads[0], heads[1], heads[0], heads[0], heads[20]]
    values = np.vstack([values, np.full((2, N_SAMPLES), 0), np.arange(2 * N_SAMPLES).reshape(2, -1) + 1, values[:1]])
    path = maker.write(tmp_path / "a.sgy", values, heads)
    cube = s3.open_cube(path, lazy=lazy)
    np.testing.assert_array_equal(cube[0, 0].values, values[37])
    np.testing.assert_array_equal(cube[2, 6].values, values[20])
    assert not cube.live[0, 1]
    assert (~cube.live).sum() == 1
    # written to every trace of the place
    back = s3.open_cube(s3.write_segy(tmp_path / "b.sgy", cube))
    np.testing.assert_array_equal(back.values, cube.values)


@pytest.mark.parametrize("given_bytes", [{}, {"inline_byte": 189, "crossline_byte": 193}])
def test_line_numbers_that_span_far_too_much_are_refused_before_memory_is_taken(tmp_path, maker, given_bytes):
    heads = maker.headers(INLINES, CROSSLINES)
    heads[4] = {189: 2_000_000_001, 193: 2_000_000_000}
    path = maker.write(tmp_path / "a.sgy", numbered(35), heads)
    with pytest.raises(FormatError, match=r"a grid far larger than its 35 traces\. Some headers are wrong"):
        s3.open_cube(path, **given_bytes)


def test_coordinates_are_not_taken_for_line_numbers_where_one_of_those_is_wrong(tmp_path, maker):
    heads = [h | {181: 50000 + 25 * h[193], 185: 80000 - 30 * h[189]} for h in maker.headers(INLINES, CROSSLINES)]
    heads[4] |= {189: 30000}
    with pytest.raises(
        FormatError, match=r"a grid far larger than its 35 traces\. Some headers are wrong: repair them"
    ):
        s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads))
    # numbers at other bytes are
    heads = [h | {9: 1 + k // 7, 21: 1 + k % 7} for k, h in enumerate(heads)]
    assert s3.open_cube(maker.write(tmp_path / "b.sgy", numbered(35), heads)).attrs["inline_byte"] == 9


def test_a_wrong_line_number_that_leaves_most_bins_empty_is_said(tmp_path, maker):
    heads = maker.headers(INLINES, CROSSLINES)
    heads[4] = {189: 140, 193: 30}
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads))
    assert "bins have no trace: line numbers may be wrong" in cube.attrs["notes"][0]


@pytest.mark.parametrize(("scalar", "factor"), [(-100, 0.01), (-10, 0.1), (0, 1.0), (1, 1.0), (10, 10.0)])
@pytest.mark.parametrize("lazy", [False, True])
def test_coordinates_obey_their_scalar(tmp_path, maker, scalar, factor, lazy):
    heads = maker.headers(INLINES, CROSSLINES)
    heads = [h | {181: 50000 + 25 * h[193], 185: 80000 - 30 * h[189], 71: scalar} for h in heads]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads), lazy=lazy)
    np.testing.assert_allclose(cube.cdp_x.values, np.tile((50000 + 25 * CROSSLINES) * factor, (5, 1)))
    np.testing.assert_allclose(cube.cdp_y.values, np.tile((80000 - 30 * INLINES) * factor, (7, 1)).T)
    stored = cube.attrs["survey"]["map"]
    np.testing.assert_allclose(stored["inline_step"], [0, -30 * factor], atol=1e-6)
    np.testing.assert_allclose(stored["crossline_step"], [50 * factor, 0], atol=1e-6)


def test_coordinates_from_other_bytes(tmp_path, maker):
    heads = [h | {73: 10 * h[193], 77: 10 * h[189]} for h in maker.headers(INLINES, CROSSLINES)]
    path = maker.write(tmp_path / "a.sgy", numbered(35), heads)
    assert s3.open_cube(path).attrs["x_byte"] == 73
    assert float(s3.open_cube(path, x_byte=77, y_byte=73).cdp_x[0, 0]) == 10 * INLINES[0]
    with pytest.raises(ParameterError, match="expected both or neither"):
        s3.open_cube(path, x_byte=73)


@pytest.mark.parametrize("lazy", [False, True])
@pytest.mark.parametrize("n_dead", [1, 2])
def test_coordinates_of_zero_are_not_known(tmp_path, maker, lazy, n_dead):
    heads = [h | {181: 50000 + 25 * h[193], 185: 80000 - 30 * h[189]} for h in maker.headers(INLINES, CROSSLINES)]
    dead = 7 * n_dead
    heads[:dead] = [h | {181: 0, 185: 0} for h in heads[:dead]]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads), lazy=lazy)
    unknown = np.isnan(np.stack([cube.cdp_x.values, cube.cdp_y.values]))
    assert unknown[:, :n_dead].all()
    assert not unknown[:, n_dead:].any()
    survey = SurveyGeometry.from_cube(cube)
    np.testing.assert_allclose(survey.index_to_map([[0, 0, 0]])[0, :2], [50750, 77000])
    np.testing.assert_allclose(survey.bin_size, [30, 50])


def test_traces_of_a_line_without_coordinates_lie_between_the_others(tmp_path, maker):
    heads = [{21: k + 1, 181: 1000 + 30 * k, 185: 7000 - 40 * k} for k in range(12)]
    for k in (0, 1, 5, 6, 11):
        heads[k] = {21: k + 1}
    line = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(12), heads))
    assert np.isnan(line.cdp_x.values).sum() == 5
    want = [[1000 + 30 * k, 7000 - 40 * k] for k in range(12)]
    np.testing.assert_allclose(SectionGeometry.from_cube(line).xy, want)
    told = summarise(line)["map"]
    assert (told["first"], told["last"]) == (want[0], want[-1])
    np.testing.assert_allclose(told["length_m"], 11 * 50.0)


@pytest.mark.parametrize("dead", [False, True])
def test_line_numbers_are_found_beside_coordinates_of_zero(tmp_path, maker, dead):
    heads = maker.headers(INLINES, CROSSLINES, bytes_=(9, 21))
    heads = [h | {181: 50000 + 25 * h[21], 185: 80000 - 30 * h[9]} for h in heads]
    if dead:
        heads[:7] = [h | {181: 0, 185: 0} for h in heads[:7]]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads))
    assert (cube.attrs["inline_byte"], cube.attrs["crossline_byte"]) == (9, 21)


@pytest.mark.parametrize("lazy", [False, True])
def test_wrong_coordinates_are_left_out_of_the_map_and_said(tmp_path, maker, lazy):
    heads = [h | {181: 50000 + 25 * h[193], 185: 80000 - 30 * h[189]} for h in maker.headers(INLINES, CROSSLINES)]
    heads[17] |= {181: 2_000_000_000}
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads), lazy=lazy)
    assert any("of 1 of 35 traces looked at lie more than half a bin off" in note for note in cube.attrs["notes"])
    survey = SurveyGeometry.from_cube(cube)
    np.testing.assert_allclose(survey.bin_size, [30, 50])
    np.testing.assert_allclose(survey.map_fit.origin, [50750, 77000])
    for k, head in enumerate(heads):
        head[181] += 5000 * (k % 3)
    told = s3.open_cube(maker.write(tmp_path / "b.sgy", numbered(35), heads)).attrs["notes"]
    assert any("off any map of evenly spaced lines" in note for note in told)


@pytest.mark.parametrize(("code", "unit"), [(1, None), (2, "seconds of arc"), (3, "degrees")])
@pytest.mark.parametrize("false_easting", [0, 6_000_000])
def test_coordinates_that_are_angles_are_told(tmp_path, maker, code, unit, false_easting):
    """No angle is six million degrees, whatever the trace header says."""
    heads = [h | {181: h[193] + false_easting, 185: 2 * h[189], 89: code} for h in maker.headers(INLINES, CROSSLINES)]
    notes = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads)).attrs["notes"]
    assert [f"coordinates are in {unit} (byte 89)" in note for note in notes] == [True] * (unit is not None)
    assert ["strikes and distances on the map are wrong" in note for note in notes] == [not false_easting] * len(notes)
    assert ["which 6000" in note and "cannot be" in note for note in notes] == [bool(false_easting)] * len(notes)


def test_constant_coordinates_are_none(tmp_path, maker):
    cube = s3.open_cube(full(maker, tmp_path / "a.sgy", b181=6000, b185=65536))
    assert "cdp_x" not in cube.coords


@pytest.mark.parametrize(("delay", "scalar", "start"), [(392, 0, 392.0), (-8, 1, -8.0), (15, -10, 1.5), (4, 10, 40.0)])
def test_the_delay_is_the_first_sample(tmp_path, maker, delay, scalar, start):
    path = full(maker, tmp_path / "a.sgy", b109=delay, b215=scalar)
    np.testing.assert_allclose(s3.open_cube(path).time, start + 4 * np.arange(N_SAMPLES))
    np.testing.assert_allclose(s3.open_cube(path, start=7.0, interval=2.0).time, 7 + 2 * np.arange(N_SAMPLES))


@pytest.mark.parametrize("lazy", [False, True])
def test_traces_with_data_that_start_a_sample_apart_are_refused(tmp_path, maker, lazy):
    heads = [h | {109: 400} for h in maker.headers(INLINES, CROSSLINES)]
    heads[20] |= {109: 404}
    path = maker.write(tmp_path / "a.sgy", numbered(35), heads)
    with pytest.raises(FormatError, match=r"start at 400, and trace 21 starts at 404.*Shift the traces"):
        s3.open_cube(path, lazy=lazy)
    taken = s3.open_cube(path, lazy=lazy, start=400.0)
    assert float(taken.time[0]) == 400.0
    # results lie as the input does
    assert s3.write_segy(tmp_path / "b.sgy", taken).read_bytes() == path.read_bytes()
    samples = numbered(35)
    samples[20] = 0
    dead = s3.open_cube(maker.write(tmp_path / "c.sgy", samples, heads), lazy=lazy)
    assert "start at different times (400 to 404" in dead.attrs["notes"][0]


def test_odd_sample_headers_are_decided_and_said(tmp_path, maker):
    heads = [h | {109: 8, 215: 77} for h in maker.headers(INLINES, CROSSLINES)]
    heads[0][109] = 9
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads, interval=0))
    np.testing.assert_allclose(cube.time[:2], [8, 12])
    notes = " ".join(cube.attrs["notes"])
    assert "no sample interval in the headers: took 4" in notes
    assert "traces start at different times (8 to 9" in notes
    assert "77 (trace header byte 215) is not a power of ten" in notes
    from_trace = s3.open_cube(full(maker, tmp_path / "b.sgy", interval=0, b117=2000))
    np.testing.assert_allclose(from_trace.time[1], 2)
    differs = s3.open_cube(full(maker, tmp_path / "c.sgy", interval=1000, b117=2000))
    np.testing.assert_allclose(differs.time[1], 1)
    assert "took the binary header's" in differs.attrs["notes"][0]


@pytest.mark.parametrize(
    ("text", "interval", "name", "domain"),
    [
        ("", 4000, "a", "time"),
        ("", 20000, "a", "depth"),
        ("", 5000, "survey_depth", "depth"),
        ("", 5000, "psdm-full", "depth"),
        ("", 4000, "z_third", "time"),
        ("", 4000, "mig-z-full", "time"),
        ("", 4000, "horizon_size", "time"),
        ("C 1 PSDM STACK", 5000, "a", "depth"),
        ("C 1 PSDM STRETCHED TO TIME", 4000, "depth", "time"),
        ("C 1 Domain: Depth", 4000, "time", "depth"),
        ("C 1 Depth min: 0 Depth max: 400", 4000, "a", "depth"),
        ("C 1 Time min: 0 max: 400", 4000, "depth", "time"),
        ("C 1 CLIENT\x00 3D PSTM SAMPLE INTERVAL: 4 MS", 4000, "a", "time"),
    ],
)
def test_time_or_depth(tmp_path, maker, text, interval, name, domain):
    path = full(maker, tmp_path / f"{name}.sgy", text=text, interval=interval)
    cube = s3.open_cube(path)
    assert cube.dims[2] == domain
    assert cube.attrs["domain_reason"]
    assert cube[domain].attrs["units"] == cube.attrs["sample_unit"] == {"time": "ms", "depth": "m"}[domain]
    other = {"time": "depth", "depth": "time"}[domain]
    assert s3.open_cube(path, domain=other).dims[2] == other
    with pytest.raises(ParameterError, match="expected 'time' or 'depth'"):
        s3.open_cube(path, domain="twt")


def test_a_line_is_a_section(tmp_path, maker):
    heads = [{21: 500 + k, 181: 1000 + 3 * k, 185: 2000 + 4 * k} for k in range(6)]
    path = maker.write(tmp_path / "a.sgy", numbered(6), heads)
    for lazy in (False, True):
        line = s3.open_cube(path, lazy=lazy)
        assert line.dims == ("trace", "time")
        np.testing.assert_array_equal(line.values, numbered(6))
        np.testing.assert_array_equal(line.cdp, 500 + np.arange(6))
        np.testing.assert_array_equal(line.cdp_y, 2000 + 4 * np.arange(6))
        assert line.live.values.all()


@pytest.mark.parametrize("axis", [0, 1])
def test_one_line_of_a_cube_is_a_section_with_its_numbers(tmp_path, maker, axis):
    lines = ([7], range(20, 26)) if axis == 0 else (range(20, 26), [7])
    line = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(6), maker.headers(*lines)))
    assert line.dims == ("trace", "time")
    np.testing.assert_array_equal(line["inline"], [7] * 6 if axis == 0 else np.arange(20, 26))


def test_a_single_trace_is_a_section(tmp_path, maker):
    assert s3.open_cube(maker.write(tmp_path / "a.sgy", [[1, 2]], [{}])).shape == (1, 2)


@pytest.mark.parametrize("sorted_by_offset", [False, True])
def test_prestack_is_refused_in_one_line(tmp_path, maker, sorted_by_offset):
    heads = maker.headers(INLINES, CROSSLINES)
    heads = (
        [h | {37: o} for o in (100, 200, 300) for h in heads]
        if sorted_by_offset
        else [h | {37: o} for h in heads for o in (100, 200, 300)]
    )
    path = maker.write(tmp_path / "a.sgy", numbered(105), heads)
    with pytest.raises(FormatError, match=r"is not stacked: about 3 traces for each place \(bytes 189 and 193\)"):
        s3.open_cube(path)


def test_shot_records_are_refused(tmp_path, maker):
    heads = [{9: shot, 13: channel, 37: 50 * channel} for shot in range(1, 6) for channel in range(1, 9)]
    with pytest.raises(FormatError, match="is not stacked"):
        s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(40), heads))


def test_lazy_is_whole_inlines_and_reads_what_is_asked(tmp_path, maker, monkeypatch):
    path = full(maker, tmp_path / "a.sgy")
    eager, lazy = s3.open_cube(path), s3.open_cube(path, lazy=True)
    assert lazy.chunks is not None
    assert lazy.chunks[1:] == ((7,), (N_SAMPLES,))
    read: list[int] = []
    from seismo3d.io import _segy_samples

    decode = _segy_samples.decode
    monkeypatch.setattr(_segy_samples, "decode", lambda raw, layout: read.append(raw.size) or decode(raw, layout))
    np.testing.assert_array_equal(lazy[2, 3:5, 1:4].values, eager[2, 3:5, 1:4].values)
    assert sum(read) == 2 * 3
    np.testing.assert_array_equal(lazy[[3, 1], :, ::-2].values, eager[[3, 1], :, ::-2].values)


def test_lazy_reads_in_many_threads(tmp_path, maker):
    path = full(maker, tmp_path / "a.sgy", by="crossline")
    lazy, eager = s3.open_cube(path, lazy=True).chunk({"inline": 1}), s3.open_cube(path)
    found: list[bool] = []
    threads = [
        threading.Thread(target=lambda: found.append(bool((lazy.values == eager.values).all()))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [True] * 8


class _CountedTraces:
    """Trace headers of a regular file, made when asked for, with the rows remembered."""

    def __init__(self, maker, n_xl, rows):
        self.maker, self.n_xl, self.rows = maker, n_xl, rows

    def __getitem__(self, name):
        assert name == "head"
        return self._Heads(self)

    class _Heads:
        def __init__(self, traces):
            self.traces = traces

        def __getitem__(self, key):
            rows = np.arange(key.start, key.stop) if isinstance(key, slice) else np.asarray(key)
            self.traces.rows.update(rows.tolist())
            heads = [self.traces.maker.trace_header(big_header(int(r), self.traces.n_xl)) for r in rows]
            return np.frombuffer(b"".join(heads), dtype=np.uint8).reshape(-1, 240)


def big_header(row, n_xl):
    il, xl = 1000 + row // n_xl, 2000 + 2 * (row % n_xl)
    return {189: il, 193: xl, 71: -10, 181: 40 * xl + 3 * il, 185: 7_000_000 + 250 * il, 109: 100}


def test_a_hundred_gigabytes_open_from_a_few_thousand_headers(tmp_path, maker, monkeypatch):
    n_il, n_xl, n_samples = 5000, 5000, 940
    trace_bytes = 240 + 4 * n_samples
    path = tmp_path / "big.sgy"
    rows: set[int] = set()
    # first with headers made on demand, to learn which are read; then on a sparse file that has those alone
    with path.open("wb") as stream:
        stream.write(maker.file_header(n_samples))
        stream.truncate(3600 + n_il * n_xl * trace_bytes)
    with monkeypatch.context() as patch:
        patch.setattr(SegyLayout, "map_traces", lambda _: _CountedTraces(maker, n_xl, rows))
        s3.open_cube(path)
    assert len(rows) < 10_000
    wanted = range(4321 * n_xl, 4322 * n_xl, 25)
    with path.open("r+b") as stream:
        for row in sorted(rows | set(wanted)):
            stream.seek(3600 + row * trace_bytes)
            stream.write(maker.trace_header(big_header(row, n_xl)) + np.full(4, row % 97, ">f4").tobytes())
    cube = s3.open_cube(path)
    assert path.stat().st_size > 99e9
    assert cube.shape == (n_il, n_xl, n_samples)
    assert (cube.inline.values[-1], cube.crossline.values[-1], float(cube.time[0])) == (5999, 11998, 100.0)
    np.testing.assert_allclose(cube.attrs["survey"]["map"]["inline_step"], [0.3, 25.0], rtol=1e-6)
    assert len(cube.data.dask.layers) < 10
    part = cube[4321, ::25, :6].values
    np.testing.assert_array_equal(part[:, :4], np.repeat(np.array(wanted)[:, None] % 97, 4, axis=1))
    assert (part[:, 4:] == 0).all()
    with pytest.raises(FormatError, match=r"expected .* as in a regular file"):
        cube[17, 3, :2].values.sum()


def test_extended_text_headers_are_skipped(tmp_path, maker):
    plain = full(maker, tmp_path / "a.sgy").read_bytes()
    for count, blocks in ((2, [b"x" * 3200, b"y" * 3200]), (-1, [b"x" * 3200, b"((SEG: EndText))".ljust(3200)])):
        head = bytearray(plain[:3600])
        head[3504:3506] = count.to_bytes(2, "big", signed=True)
        path = tmp_path / f"ext{count}.sgy"
        path.write_bytes(bytes(head) + b"".join(blocks) + plain[3600:])
        np.testing.assert_array_equal(s3.open_cube(path).values, s3.open_cube(tmp_path / "a.sgy").values)


REAL = {
    "F3_very_small.sgy": ((11, 11, 463), "time"),
    "f3.sgy": ((23, 18, 75), "time"),
    "penobscot_xl1155.sgy": ((601, 1501), "time"),
    "31_81_PR.sgy": ((534, 1501), "time"),
    "ex1_missing_traces_75x71x26.segy": ((75, 71, 26), "time"),
    "ex2_complete_3d_75x71x26.segy": ((75, 71, 26), "time"),
    "volve10-migvel-depth-sub3d.sgy": ((18, 52, 226), "depth"),
    "volve10r12-full-z-il10117sub.sgy": ((202, 1125), "depth"),
}


@pytest.mark.parametrize("name", REAL)
@pytest.mark.parametrize("lazy", [False, True])
def test_real_files_hold_what_segyio_reads(real_data, name, lazy):
    path = real_data / "seismic" / "segy" / name
    cube = s3.open_cube(path, lazy=lazy)
    assert (cube.shape, cube.dims[-1]) == REAL[name]
    with segyio.open(path, ignore_geometry=True) as file:
        raw, samples = file.trace.raw[:], file.samples
        il, xl = file.attributes(189)[:], file.attributes(193)[:]
    np.testing.assert_allclose(cube[cube.dims[-1]], samples)
    if cube.ndim == 2:
        np.testing.assert_array_equal(cube.values, raw)
        return
    i, j = np.searchsorted(cube.inline, il), np.searchsorted(cube.crossline, xl)
    np.testing.assert_array_equal(cube.values[i, j], raw)
    assert int(np.isfinite(cube.values).all(axis=2).sum()) == len(raw)


def test_parihaka_opens_as_segyio_reads_it(real_data):
    path = real_data / "seismic" / "parihaka_west.sgy"
    cube = s3.open_cube(path)
    with segyio.open(path) as file:
        np.testing.assert_array_equal(cube.inline, file.ilines)
        np.testing.assert_array_equal(cube.crossline, file.xlines)
        np.testing.assert_array_equal(cube.values[100], file.iline[int(file.ilines[100])])
    assert float(cube.time[0]) == 392.0


def test_a_prestack_line_is_refused(tmp_path, maker):
    heads = [{189: 1, 193: cdp, 37: offset} for cdp in range(1, 9) for offset in (100, 200, 300)]
    with pytest.raises(FormatError, match=r"is not stacked: about 3 traces for each place \(bytes 193\)"):
        s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(24), heads))


def test_feet_are_said(tmp_path, maker):
    cube = s3.open_cube(full(maker, tmp_path / "a.sgy", b3255=2))
    assert "says feet" in " ".join(cube.attrs["notes"])
    assert not s3.open_cube(full(maker, tmp_path / "b.sgy")).attrs["notes"]


def test_lengths_in_feet_are_so_in_memory_and_written(tmp_path, maker):
    heads = [h | {181: 50000 + 25 * h[193], 185: 80000 - 30 * h[189]} for h in maker.headers(INLINES, CROSSLINES)]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(35), heads, b3255=2), domain="depth")
    assert cube.attrs["sample_unit"] == cube["depth"].attrs["units"] == cube["cdp_x"].attrs["units"] == "ft"
    assert SurveyGeometry.from_cube(cube).length_unit == "ft"
    told = summarise(cube)["map"]
    assert told["unit"] == "ft"
    assert told["bin_size_ft"] == list(SurveyGeometry.from_cube(cube).bin_size)
    # without the headers that it came from, and where no place of a trace is left
    fresh = cube.drop_attrs(deep=False).assign_attrs(sample_unit="ft")
    s3.write_segy(tmp_path / "b.sgy", fresh)
    assert s3.open_cube(tmp_path / "b.sgy", domain="depth")["cdp_y"].attrs["units"] == "ft"
    assert SurveyGeometry.from_cube(cube.drop_vars(["cdp_x", "cdp_y"])).length_unit == "ft"
    in_time = s3.open_cube(tmp_path / "a.sgy", domain="time")
    assert (in_time.attrs["sample_unit"], SurveyGeometry.from_cube(in_time).length_unit) == ("ms", "ft")


def test_a_unit_that_segy_has_no_place_for_is_refused(tmp_path):
    cube = s3.as_cube(np.ones((3, 4, 5)), interval=4.0)
    in_seconds = cube.assign_coords(time=("time", cube["time"].values / 1000, {"units": "s"}))
    with pytest.raises(GeometryError, match=r"cube has time in s; expected ms, m or ft\. Convert it, or write Zarr\."):
        s3.write_segy(tmp_path / "a.sgy", in_seconds.assign_attrs(sample_unit="s"))
    assert not any(tmp_path.iterdir())


def test_an_irregular_large_file_is_scanned(tmp_path, maker, monkeypatch):
    """A file above the limit for reading every header at once, with a gap, and with a swap that the sample misses."""
    monkeypatch.setattr("seismo3d.io.segy._SCANNED_BELOW", 0)
    heads = maker.headers(range(40), range(50))
    regular = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(2000, 2), heads), lazy=True)
    assert "sample of the trace headers" in " ".join(regular.attrs["notes"])
    np.testing.assert_array_equal(regular.values.reshape(-1, 2), numbered(2000, 2))
    gap = s3.open_cube(maker.write(tmp_path / "b.sgy", numbered(1999, 2), heads[1:]), lazy=True)
    assert gap.attrs["n_missing"] == 1
    sampled = set(_spread_rows(2000, 50).tolist())
    row = next(k for k in range(5, 1990) if not {k, k + 1} & sampled and k % 50 not in (0, 48, 49))
    heads[row], heads[row + 1] = heads[row + 1], heads[row]
    swapped = maker.write(tmp_path / "c.sgy", numbered(2000, 2), heads)
    blind = s3.open_cube(swapped, lazy=True)
    with pytest.raises(FormatError, match=r"expected .* as in a regular file\. Open it with scan='full'"):
        blind.compute()
    exact = s3.open_cube(swapped, lazy=True, scan="full").values
    np.testing.assert_array_equal(exact[row // 50, row % 50], numbered(2000, 2)[row + 1])
    np.testing.assert_array_equal(exact, s3.open_cube(swapped, lazy=False).values)


def test_the_fullest_grid_wins_over_numbers_that_only_run(tmp_path, maker):
    heads = [h | {9: 7 + k // 3} for k, h in enumerate(maker.headers(range(8), range(20, 40), bytes_=(17, 21)))]
    del heads[40:44]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(156), heads))
    assert (cube.attrs["inline_byte"], cube.attrs["crossline_byte"], cube.shape[:2]) == (17, 21, (8, 20))


def test_the_map_tells_line_numbers_from_other_numbers(tmp_path, maker):
    """Two pairs span full grids; the coordinates are those of one of them."""
    heads = [
        {9: k // 6, 17: k % 6, 5: 100 + k // 4, 21: 200 + k % 4, 181: 30 * (k // 4), 185: 50 * (k % 4)}
        for k in range(48)
    ]
    cube = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(48), heads))
    assert (cube.attrs["inline_byte"], cube.attrs["crossline_byte"]) == (5, 21)
    assert cube.attrs["survey"]["map"]["inline_step"] == pytest.approx([30, 0], abs=1e-9)


@pytest.mark.parametrize("straight", [True, False])
def test_counters_along_a_line_make_no_cube(tmp_path, maker, straight):
    heads = []
    for k in range(288):
        bend = 0 if straight else round(400 * np.sin(k / 40))
        heads.append(
            {9: 1 + k // 48, 13: 1 + k % 48, 21: k + 1, 181: 450000 + round(12.5 * k), 185: 600000 + 7 * k + bend}
        )
    line = s3.open_cube(maker.write(tmp_path / "a.sgy", numbered(288), heads))
    assert line.dims == ("trace", "time")
    assert "opened as a 2D line" in line.attrs["notes"][0]


@pytest.mark.parametrize("lazy", [False, True])
def test_many_traces_at_odd_bytes_with_gaps(tmp_path, maker, lazy):
    """More traces than are looked at one by one: the bytes are found in runs of neighbours spread over the file."""
    il, xl = (a.ravel() for a in np.meshgrid(np.arange(1000, 1280), np.arange(3000, 3520, 2), indexing="ij"))
    keep = np.random.default_rng(0).random(il.size) > 0.01
    il, xl = il[keep], xl[keep]
    records = np.zeros(il.size, dtype=[("head", "u1", 240), ("data", "i1", 2)])
    for byte, values in ((17, il), (25, xl), (1, np.arange(il.size)), (181, 10 * xl), (185, 20 * il)):
        records["head"][:, byte - 1 : byte + 3] = values.astype(">i4").view("u1").reshape(-1, 4)
    records["data"][:, 0], records["data"][:, 1] = il % 100, xl % 100
    path = tmp_path / "a.sgy"
    path.write_bytes(maker.file_header(2, code=8) + records.tobytes())
    cube = s3.open_cube(path, lazy=lazy, inline_byte=17, crossline_byte=25)
    assert cube.shape == (280, 260, 2)
    assert cube.attrs["n_missing"] == 280 * 260 - il.size
    i, j = il - 1000, (xl - 3000) // 2
    np.testing.assert_array_equal(cube.values[i, j, 0], il % 100)
    np.testing.assert_array_equal(cube.values[i, j, 1], xl % 100)
    records["head"][:, 8:12], records["head"][:, 20:24] = records["head"][:, 16:20], records["head"][:, 24:28]
    path.write_bytes(maker.file_header(2, code=8) + records.tobytes())
    found = s3.open_cube(path, lazy=lazy)
    assert (found.attrs["inline_byte"], found.attrs["crossline_byte"]) == (9, 21)
    np.testing.assert_array_equal(found.values, cube.values)


def test_lazy_cubes_can_be_sent_elsewhere(tmp_path, maker):
    path = full(maker, tmp_path / "a.sgy")
    lazy = pickle.loads(pickle.dumps(s3.open_cube(path, lazy=True)))  # noqa: S301 - made one line above
    np.testing.assert_array_equal(lazy.values, s3.open_cube(path).values)


def test_the_table_of_traces_is_never_far_larger_than_the_file():
    lines = np.array([1, 2, 3, 10_000_019])
    with pytest.raises(FormatError, match=r"a\.sgy has line numbers 1 to 10000019 \(byte 9\).*Some headers are wrong"):
        scanned_grid(lines, lines, 9, 13, path="a.sgy")
