from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from fake_faults import make_cube, make_faults

import seismo3d as s3
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.seismic.cube_checks import check_faults_of, check_order, differing_axis, placing_cube, tell_extent
from seismo3d.seismic.flow_paths import flow_path
from seismo3d.seismic.network import fracture_network
from seismo3d.seismic.stick_scores import score_sticks


def cube(first: int = 100, dims: tuple[str, ...] = ("inline", "crossline", "time")) -> xr.DataArray:
    values = np.random.default_rng(1).normal(size=(8, 9, 16)).astype(np.float32)
    coords = {"inline": first + np.arange(8), "crossline": np.arange(9), "time": 4.0 * np.arange(16)}
    return xr.DataArray(values, dims=("inline", "crossline", "time"), coords=coords).transpose(*dims)


@pytest.mark.parametrize("dims", [("time", "inline", "crossline"), ("crossline", "inline", "time")])
def test_axes_in_another_order_are_refused_with_what_to_do(dims: tuple[str, ...]) -> None:
    for run in (s3.trace_faults, s3.layer_time, lambda c: s3.trace_tracks(c, [(101, 1, 8)])):
        with pytest.raises(ShapeError, match=r"Give cube\.transpose\('inline', 'crossline', 'time'\)"):
            run(cube(dims=dims))


def test_samples_that_run_upwards_are_refused_before_work_starts() -> None:
    down = cube().rename(time="depth")
    up = down.assign_coords(depth=-1000.0 - 10.0 * np.arange(16))
    seeds = [(101, 1, -1050.0)]
    for run in (
        s3.trace_faults,
        s3.layer_time,
        lambda c: s3.trace_tracks(c, seeds),
        lambda c: s3.trace_tracks(c[2], [(1, -1050.0)]),
        lambda c: s3.trace_faults(c[2]),
        lambda c: s3.follow_stick(c, [(101, 3, -1010.0), (101, 4, -1100.0)]),
    ):
        with pytest.raises(GeometryError, match=r"from -1000 to -1150; expected numbers that grow downwards\. Negate"):
            run(up)
    with pytest.raises(GeometryError, match=r"base has depth .* base\.assign_coords\(depth=-base\.depth\)"):
        s3.align_cubes(up, up)
    check_order(up.assign_coords(depth=-up.depth))
    check_order(up.isel(depth=slice(None, None, -1)))
    check_order(up[:, :, 0])
    check_order(down[:, :, :1])


def test_other_names_and_bare_arrays_are_taken_as_they_are() -> None:
    check_order(np.zeros((3, 4, 5)))
    check_order(xr.DataArray(np.zeros((3, 4, 5)), dims=("x", "y", "z")))
    check_order(xr.DataArray(np.zeros((3, 4, 5)), dims=("angle", "inline", "depth")))
    with pytest.raises(ShapeError, match="transpose"):
        check_order(xr.DataArray(np.zeros((3, 5)), dims=("time", "trace")))


def test_faults_of_the_same_shape_elsewhere_are_refused() -> None:
    faults = SimpleNamespace(labels=cube(first=101), surfaces=())
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


def placed(east: float = 0.0) -> xr.DataArray:
    """The cube on a map, with bins of 25 m and 12.5 m."""
    plain = cube()
    x, y = np.meshgrid(25.0 * np.arange(8), 12.5 * np.arange(9), indexing="ij")
    return plain.assign_coords(cdp_x=(("inline", "crossline"), x + east), cdp_y=(("inline", "crossline"), y))


def test_traces_elsewhere_on_the_map_are_refused() -> None:
    assert differing_axis(placed(), placed(50_000.0)) == "map"
    assert differing_axis(placed(), placed(6.0)) == "map"
    assert differing_axis(placed(), placed(2.0)) is None
    assert differing_axis(placed(), cube()) is None
    sections = [a.isel(inline=3, drop=True) for a in (placed(), placed(50_000.0), placed(2.0))]
    assert differing_axis(sections[0], sections[1]) == "map"
    assert differing_axis(sections[0], sections[2]) is None
    faults: Any = SimpleNamespace(labels=placed(50_000.0), surfaces=())
    for run in (s3.layer_time, lambda c, faults: s3.trace_tracks(c, [(101, 1, 8)], faults=faults)):
        with pytest.raises(GeometryError, match="with other map coordinates"):
            run(placed(), faults=faults)
    with pytest.raises(GeometryError, match="differ in their map coordinates"):
        s3.align_cubes(placed(), placed(50_000.0))


def test_sections_of_other_lines_are_refused() -> None:
    one, other = (cube().isel(inline=k) for k in (2, 3))
    assert differing_axis(one, other) == "inline"
    assert differing_axis(one, one.drop_vars("inline")) is None


def test_what_is_no_set_of_faults_is_refused() -> None:
    for faults in ("x", 3, np.zeros((8, 9, 16))):
        with pytest.raises(ParameterError, match=r"expected a FaultSet\. Give what trace_faults returned"):
            check_faults_of(cube(), faults)
    for run in (s3.fracture_network, lambda f: s3.unfault(cube(), f), lambda f: s3.flow_path(f, (1, 1, 1), (2, 2, 2))):
        with pytest.raises(ParameterError, match="faults is None; expected a FaultSet"):
            run(None)


def test_faults_are_placed_by_their_own_cube_only() -> None:
    own = make_cube()
    faults = make_faults(own)
    assert placing_cube(own, faults) is own
    assert placing_cube(None, faults) is faults.labels
    other = own.assign_coords(time=own["time"] + 40.0)
    for run in (
        lambda c: flow_path(faults, (110, 520, 1100), (120, 520, 1100), cube=c),
        lambda c: fracture_network(faults, cube=c),
        lambda c: score_sticks(faults, (), cube=c),
    ):
        with pytest.raises(GeometryError, match="other time coordinates"):
            run(other)
        with pytest.raises(ShapeError, match="faults are of a cube of shape"):
            run(own[1:])
        with pytest.raises(ShapeError, match=r"Give cube\.transpose"):
            run(own.transpose("crossline", "inline", "time"))


def test_the_extent_of_a_cube_is_told_axis_by_axis():
    assert tell_extent(np.zeros((4, 5, 6))) == "inline 0 to 3, crossline 0 to 4, sample 0 to 5"
    assert tell_extent(np.zeros((4, 6))) == "trace 0 to 3, sample 0 to 5"
    cube = xr.DataArray(np.zeros((2, 3)), dims=("trace", "time"), coords={"time": [600.0, 604.0, 608.0]})
    assert tell_extent(cube) == "trace 0 to 1, time 600 to 608"
