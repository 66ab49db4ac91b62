from __future__ import annotations

import dask.array as da
import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.io._as_cube import as_cube
from seismo3d.plot.pictures import axis_labels, take_picture
from seismo3d.plot.traces_of_faults import cut_faults
from seismo3d.seismic.preparing import describe_volume


def test_pictures_are_the_cube_s_slices() -> None:
    cube = make_cube()
    inline = take_picture(cube, inline=110)
    np.testing.assert_array_equal(inline.values, cube.values[5].T)
    assert (inline.title, inline.column_name, inline.row_name) == ("Inline 110", "Crossline", "Time (ms)")
    assert inline.extent == (499.5, 539.5, 1198.0, 998.0)
    crossline = take_picture(cube, crossline=503)
    np.testing.assert_array_equal(crossline.values, cube.values[:, 3].T)
    assert not crossline.live[:, 3:5].any()
    assert crossline.live.sum() == 28 * 50
    level = take_picture(cube, time=1100)
    np.testing.assert_array_equal(level.values, cube.values[:, :, 25])
    assert level.title == "Time 1100 ms"
    np.testing.assert_array_equal(take_picture(cube, sample=25).values, level.values)
    section = make_section()[0]
    np.testing.assert_array_equal(take_picture(section).values, section.values.T)


def test_bare_arrays_count_from_zero() -> None:
    values = make_cube().values
    picture = take_picture(values, crossline=7)
    np.testing.assert_array_equal(picture.values, values[:, 7].T)
    assert picture.extent == (-0.5, 29.5, 49.5, -0.5)
    falling = take_picture(make_cube()[::-1, ::-1], time=1100)
    assert falling.extent == (539.5, 499.5, 99.0, 159.0)
    assert take_picture(values).index == 15


def test_nearest_line_is_taken_and_named() -> None:
    assert take_picture(make_cube(), inline=110.9).title == "Inline 110"


def test_only_the_slice_of_a_lazy_cube_is_read() -> None:
    cube = make_cube()
    read: list[int] = []

    def load(block: np.ndarray, block_info: dict) -> np.ndarray:  # type: ignore[type-arg]
        read.append(block_info[0]["array-location"][0][0])
        return block

    chunked = da.from_array(cube.values, chunks=(1, 40, 50))
    data = da.map_blocks(load, chunked, dtype=np.float32, meta=np.empty((0, 0, 0), np.float32))
    lazy = cube.copy(data=data).assign_coords(live=(("inline", "crossline"), (data != 0).any(axis=-1)))
    np.testing.assert_array_equal(take_picture(lazy, inline=120).values, cube.values[10].T)
    assert set(read) == {10}  # once for the samples, once for what is live


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({"inline": 99}, "inline is 99; expected 100 to 158"),
        ({"time": 1300}, "time is 1300; expected 1000 to 1196"),
        ({"sample": 50}, "sample is 50; expected 0 to 49"),
        ({"inline": float("nan")}, "inline is nan"),
        ({"depth": 10}, "depth is asked of a cube with axes inline, crossline, time"),
        ({"inline": 100, "time": 1000}, "inline and time are given; expected one"),
    ],
)
def test_refusals(where: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        take_picture(make_cube(), **where)


def test_section_takes_no_position_and_other_shapes_are_refused() -> None:
    with pytest.raises(ParameterError, match="inline is given for a section"):
        take_picture(make_section()[0], inline=3)
    with pytest.raises(ShapeError, match="expected"):
        take_picture(np.zeros(5))


def test_fault_lines_lie_where_the_surface_is() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    lines = cut_faults(faults, take_picture(cube, inline=120))
    first = lines.surface == 1
    x, y = lines.segments[first][..., 0], lines.segments[first][..., 1]
    np.testing.assert_allclose(x, 500 + 20 + ((y - 1000) / 4 - 24.5) * 0.5, atol=1e-3)
    assert lines.throw_unit == "ms"
    # throw runs from 2 to 6 samples of 4 ms over the surface; the inline lies in its middle
    assert 10 < np.nanmean(lines.throw[first]) < 22
    level = cut_faults(faults, take_picture(cube, sample=24))
    first = level.surface == 1
    np.testing.assert_allclose(level.segments[first][..., 0], 520 - 0.25, atol=1e-3)
    assert level.segments[first][..., 1].min() == pytest.approx(104)
    assert len(cut_faults(faults, take_picture(cube, sample=0)).segments) == 0


def test_samples_without_a_unit_are_not_said_to_be_milliseconds() -> None:
    cube = as_cube(np.zeros((4, 5, 6), np.float32))
    assert describe_volume(as_cube(np.zeros((8, 8, 16), np.float32))) == (1.0, "samples")
    assert axis_labels(cube) == axis_labels(cube.values) == ("Inline", "Crossline", "Sample")
    assert axis_labels(cube.assign_attrs(sample_unit="ms")) == ("Inline", "Crossline", "Time (ms)")
    assert take_picture(cube, time=3.0).title == "Sample 3"
