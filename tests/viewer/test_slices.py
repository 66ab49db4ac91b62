from __future__ import annotations

import dask.array as da
import numpy as np
import pytest
import xarray as xr

import seismo3d as s3
from seismo3d.errors import ShapeError
from seismo3d.io.zarr_store import read_zarr, write_zarr
from seismo3d.viewer import slices
from seismo3d.viewer.slices import SliceReader


@pytest.fixture
def volume(rng):
    return rng.normal(size=(12, 20, 30)).astype(np.float32)


@pytest.mark.parametrize("lazy", [False, True])
def test_slices_are_those_of_the_cube(volume, lazy):
    data = da.from_array(volume, chunks=(5, 20, 30)) if lazy else volume
    reader = SliceReader(xr.DataArray(data, dims=("inline", "crossline", "time")))
    assert reader.is_lazy is lazy
    np.testing.assert_array_equal(reader.read(0, 7).values, volume[7].T)
    np.testing.assert_array_equal(reader.read(1, 3).values, volume[:, 3].T)
    np.testing.assert_array_equal(reader.read(2, 9).values, volume[:, :, 9])
    assert reader.read(0, 7).is_full


def test_a_thinned_slice_takes_every_nth_row_and_column(volume):
    part = SliceReader(volume).read(1, 4, most=11)
    np.testing.assert_array_equal(part.values, volume[::2, 4, ::3].T)
    assert (part.steps, part.shape, part.is_full) == ((3, 2), (30, 12), False)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_dead_traces_have_no_data(cube, axis):
    dead = cube.copy(data=np.nan_to_num(cube.values))
    reader, k = SliceReader(dead), (4, 3, 20)[axis]
    known = np.broadcast_to(cube["live"].values[:, :, None], cube.shape)
    values = np.where(known, dead.values, np.nan).take(k, axis=axis)
    np.testing.assert_array_equal(reader.read(axis, k).values, values if axis == 2 else values.T)
    thinned = reader.read(axis, k, most=20).values
    assert np.isnan(thinned).any()
    # what is drawn is not what was opened
    assert np.isfinite(dead.values).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_dead_traces_of_a_lazy_file_have_no_data_either(tmp_path, cube, axis):
    dead = cube.copy(data=np.nan_to_num(cube.values))
    dead[4:6, 3] = 0.0
    dead[7, 3, :20] = 0.0  # muted, and live below
    s3.write_segy(tmp_path / "a.sgy", dead.drop_vars("live"))
    whole, lazy = s3.open_cube(tmp_path / "a.sgy", lazy=False), s3.open_cube(tmp_path / "a.sgy", lazy=True)
    assert not isinstance(lazy["live"].data, np.ndarray)
    for k, most in (((4, 3, 8)[axis], 1024), ((4, 3, 30)[axis], 10)):
        expected = SliceReader(whole).read(axis, k, most=most).values
        assert np.isnan(expected).any()
        np.testing.assert_array_equal(SliceReader(lazy).read(axis, k, most=most).values, expected)


class Counting:
    """A cube too large for memory: every read is counted, and gives the sum of its indices."""

    shape = (4000, 5000, 2000)
    dtype = np.dtype(np.float32)
    ndim = 3

    def __init__(self):
        self.samples = 0

    def __getitem__(self, key):
        axes = [np.arange(n)[k] for k, n in zip(key, self.shape, strict=True)]
        self.samples += int(np.prod([len(axis) for axis in axes]))
        return (axes[0][:, None, None] + axes[1][:, None] + axes[2]).astype(np.float32)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_of_a_huge_cube_only_what_is_shown_is_read(axis):
    source = Counting()
    reader = SliceReader(source)
    part = reader.read(axis, 5, most=256)
    assert max(part.values.shape) <= 256
    assert source.samples == part.values.size
    reader.read(axis, 5, most=256)
    assert source.samples == part.values.size
    steps = part.steps
    assert part.values[1, 1] == 5 + steps[0] + steps[1]


def test_a_lazy_segy_and_zarr_cube_give_the_same_slices(tmp_path, cube):
    s3.write_segy(tmp_path / "a.sgy", cube)
    write_zarr(tmp_path / "a.zarr", cube, brick=16)
    readers = [
        SliceReader(s3.open_cube(tmp_path / "a.sgy", lazy=True)),
        SliceReader(read_zarr(tmp_path / "a.zarr", lazy_above=0)),
    ]
    assert all(reader.is_lazy for reader in readers)
    for axis in range(3):
        first, second = (reader.read(axis, 11, most=20).values for reader in readers)
        np.testing.assert_allclose(second, SliceReader(cube).read(axis, 11, most=20).values, rtol=1e-6)
        np.testing.assert_array_equal(first, second)


def test_the_limits_leave_out_what_is_no_data():
    volume = np.zeros((8, 9, 10), np.float32)
    volume[:, :5] = np.nan
    volume[:, 6:, ::2] = 4.0
    volume[:, 6:, 1::2] = -4.0
    assert SliceReader(volume).limits() == (-4.0, 4.0)
    assert SliceReader(np.zeros((8, 9, 10), np.float32)).limits() == (-1.0, 1.0)


def test_unsigned_bytes_are_shown_about_their_level():
    volume = np.full((8, 9, 10), 128, np.uint8)
    volume[:, :, ::2], volume[:, :, 1::5] = 88, 168
    assert SliceReader(volume).limits() == (88.0, 168.0)


def test_old_slices_are_let_go(monkeypatch, volume):
    monkeypatch.setattr(slices, "_KEPT_BYTES", 3 * volume[0].nbytes)
    reader = SliceReader(volume)
    for index in range(12):
        reader.read(0, index)
    assert len(reader._kept) == 3


def test_a_section_is_refused():
    with pytest.raises(ShapeError, match=r"Draw a line by plot\.section"):
        SliceReader(np.zeros((5, 6), np.float32))
