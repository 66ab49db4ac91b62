from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import seismo3d as s3
from seismo3d.errors import GeometryError, ShapeError
from seismo3d.seismic.cube_checks import check_faults_of, check_order, differing_axis


def cube(first: int = 100, dims: tuple[str, ...] = ("inline", "crossline", "time")) -> xr.DataArray:
    values = np.random.default_rng(1).normal(size=(8, 9, 16)).astype(np.float32)
    coords = {"inline": first + np.arange(8), "crossline": np.arange(9), "time": 4.0 * np.arange(16)}
    return xr.DataArray(values, dims=("inline", "crossline", "time"), coords=coords).transpose(*dims)


@pytest.mark.parametrize("dims", [("time", "inline", "crossline"), ("crossline", "inline", "time")])
def test_axes_in_another_order_are_refused_with_what_to_do(dims: tuple[str, ...]) -> None:
    for run in (s3.trace_faults, s3.layer_time, lambda c: s3.trace_tracks(c, [(101, 1, 8)])):
        with pytest.raises(ShapeError, match=r"Give cube\.transpose\('inline', 'crossline', 'time'\)"):
            run(cube(dims=dims))


def test_other_names_and_bare_arrays_are_taken_as_they_are() -> None:
    check_order(np.zeros((3, 4, 5)))
    check_order(xr.DataArray(np.zeros((3, 4, 5)), dims=("x", "y", "z")))
    check_order(xr.DataArray(np.zeros((3, 4, 5)), dims=("angle", "inline", "depth")))
    with pytest.raises(ShapeError, match="transpose"):
        check_order(xr.DataArray(np.zeros((3, 5)), dims=("time", "trace")))


def test_faults_of_the_same_shape_elsewhere_are_refused() -> None:
    faults = SimpleNamespace(labels=cube(first=101))
    with pytest.raises(GeometryError, match="other inline coordinates"):
        check_faults_of(cube(), faults)
    check_faults_of(cube(first=101), faults)
    check_faults_of(cube().values, faults)
    check_faults_of(cube(), None)
    with pytest.raises(ShapeError, match="traced in"):
        check_faults_of(cube()[1:], faults)


def test_which_axis_differs() -> None:
    assert differing_axis(cube(), cube()) is None
    assert differing_axis(cube(), cube().values) is None
    assert differing_axis(cube(), cube().drop_vars("time")) == "time"
    assert differing_axis(cube(), cube().assign_coords(time=4.0 * np.arange(16) + 0.1)) == "time"
    assert differing_axis(cube(), cube().assign_coords(time=4.0 * np.arange(16) * (1.0 + 1e-7))) is None
