from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest
from fake_faults import BINS, DT, make_cube, make_faults, make_section, plane_surface

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.flow_paths import flow_path
from seismo3d.seismic.index_frame import IndexFrame
from seismo3d.seismic.network import fracture_network
from seismo3d.seismic.network_exports import summarise_network, write_network

COT63, COT75 = 0.5, 1.0 / np.tan(np.radians(75.0))


def depth_cube():
    cube = make_cube().rename(time="depth")
    cube.attrs["sample_unit"] = "m"
    return cube


def cut_short(surface: FaultSurface, keep: np.ndarray) -> FaultSurface:
    """The part of a surface whose triangles have all their corners kept."""
    return replace(surface, cells=surface.cells[keep[surface.cells].all(axis=1)])


def without_loose(surface: FaultSurface) -> FaultSurface:
    used = np.unique(surface.cells)
    number = np.full(len(surface.vertices), -1)
    number[used] = np.arange(len(used))
    arrays = {
        name: getattr(surface, name)[used]
        for name in ("vertices", "normals", "likelihood", "throw", "separation", "throw_fit", "strike_deg", "dip_deg")
    }
    return replace(surface, cells=number[surface.cells].astype(np.int32), **arrays)


def network_of(faults: FaultSet, *surfaces: FaultSurface, **more: object):
    return fracture_network(replace(faults, surfaces=surfaces), **more)  # type: ignore[arg-type]


def test_two_planes_meet_in_the_line_that_geometry_tells() -> None:
    network = fracture_network(make_faults(make_cube()))
    (line,) = network.intersections
    assert (line.first, line.second, line.kind, line.abutting) == (1, 2, "cross", 0)
    # samples 5 to 44 along (cot 75, cot 63.4, 1)
    assert line.length == pytest.approx(39.0 * np.sqrt(COT75**2 + COT63**2 + 1.0), abs=0.5)
    k = line.points[:, 2]
    np.testing.assert_allclose(line.points[:, 0], 15.0 + (k - 24.5) * COT75, atol=0.01)
    np.testing.assert_allclose(line.points[:, 1], 20.0 + (k - 24.5) * COT63, atol=0.01)
    a, b = (s.normals[0].astype(float) for s in make_faults(make_cube()).surfaces)
    assert line.angle_deg == pytest.approx(np.degrees(np.arccos(abs(a @ b))), abs=0.01)


def test_lengths_areas_and_angles_are_true_ones_in_a_depth_cube() -> None:
    cube = depth_cube()
    faults = make_faults(cube)
    network = fracture_network(faults, cell=10)
    assert network.unit == "m"
    (line,) = network.intersections
    step = np.array([COT75 * BINS[0], COT63 * BINS[1], DT])
    assert line.length == pytest.approx(39.0 * np.linalg.norm(step), rel=0.02)
    normals = np.array([[0.0, 1.0 / BINS[1], -COT63 / DT], [1.0 / BINS[0], 0.0, -COT75 / DT]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert line.angle_deg == pytest.approx(np.degrees(np.arccos(abs(normals[0] @ normals[1]))), abs=0.01)
    # the first dips by 1 down in 0.5 crosslines: 4 m in 6.25 m
    dips = {entry.surfaces: entry.dip_deg for entry in network.sets}
    assert dips[(1,)] == pytest.approx(np.degrees(np.arctan2(DT, COT63 * BINS[1])), abs=0.01)
    total = sum(facts["area"] for _, facts in network.graph.nodes(data=True))
    voxel = BINS[0] * BINS[1] * DT
    assert network.intensity == pytest.approx(total / (30 * 40 * 50 * voxel), rel=1e-6)
    assert network.density.sum() * 1000 * voxel == pytest.approx(total, rel=1e-5)


def test_who_ends_at_whom() -> None:
    faults = make_faults(make_cube())
    first, second = faults.surfaces
    _, j, k = second.vertices.T
    off = j - (20.0 + (k - 24.5) * COT63)
    half = without_loose(cut_short(second, off >= 0.0))
    (line,) = network_of(faults, first, half).intersections
    assert (line.kind, line.abutting) == ("abut", 2)
    # lost a few traces before it meets the first, it still does; nine before, it does not
    near, far = (without_loose(cut_short(second, off >= gap)) for gap in (0.8, 9.0))
    (line,) = network_of(faults, first, near).intersections
    assert (line.kind, line.abutting) == ("abut", 2)
    assert network_of(faults, first, far).intersections == ()
    assert len(network_of(faults, first, far).zones) == 2
    # each ends at the other
    off = first.vertices[:, 0] - (15.0 + (first.vertices[:, 2] - 24.5) * COT75)
    corner = without_loose(cut_short(first, off >= -1.6))
    (line,) = network_of(faults, corner, half).intersections
    assert (line.kind, line.abutting) == ("corner", 0)


@pytest.mark.parametrize("gap", [-0.3, 0.0, 1.0, 2.5])
def test_two_that_both_end_meet_over_a_gap(gap: float) -> None:
    faults = make_faults(make_cube())
    first, second = faults.surfaces
    (whole,) = network_of(faults, first, second).intersections
    ends = []
    for surface, (axis, centre, cot) in ((first, (0, 15.0, COT75)), (second, (1, 20.0, COT63))):
        off = surface.vertices[:, axis] - (centre + (surface.vertices[:, 2] - 24.5) * cot)
        ends.append(without_loose(cut_short(surface, off >= gap)))
    (line,) = network_of(faults, *ends).intersections
    assert (line.kind, line.abutting) == ("corner", 0)
    # an edge of triangles two voxels wide, at either end
    assert line.length == pytest.approx(whole.length, abs=5.0)


def test_a_reach_beyond_the_cube_is_one_across_it() -> None:
    faults = make_faults(make_cube())
    (across,), (beyond,) = (
        fracture_network(faults, reach=reach).intersections for reach in (max(faults.labels.shape), 10**9)
    )
    np.testing.assert_array_equal(across.points, beyond.points)


def test_one_fault_cut_in_two_and_a_near_parallel_one_do_not_meet_as_corners() -> None:
    faults = make_faults(make_cube())
    first = plane_surface(axis=1, centre=20.0, dip_deg=70.0, throw=4.0)
    beside = plane_surface(axis=1, centre=22.0, dip_deg=74.0, throw=4.0)
    upper, lower = (
        without_loose(cut_short(s, keep))
        for s, keep in ((first, first.vertices[:, 2] <= 23.0), (beside, beside.vertices[:, 2] >= 25.0))
    )
    assert network_of(faults, upper, lower).intersections == ()


def test_parallel_faults_do_not_meet_and_are_one_set() -> None:
    faults = make_faults(make_cube())
    surfaces = [plane_surface(axis=1, centre=c, dip_deg=70.0, throw=4.0) for c in (10.0, 16.0, 30.0)]
    network = network_of(faults, *surfaces)
    assert network.intersections == ()
    assert {zone.surfaces for zone in network.zones} == {(1,), (2,), (3,)}
    (entry,) = network.sets
    assert entry.surfaces == (1, 2, 3)
    assert entry.share == pytest.approx(1.0)
    assert entry.dip_deg == pytest.approx(70.0, abs=0.01)


def test_density_counts_area_where_it_lies() -> None:
    faults = make_faults(make_cube())
    upright = plane_surface(axis=1, centre=20.3, dip_deg=90.0, throw=4.0)
    network = network_of(faults, upright, cell=(10, 10, 10))
    # the cell of crosslines 20 to 29 and inlines 10 to 19 holds the whole plane, 10 x 10 over 10 x 10 x 10
    assert network.density.shape == (3, 4, 5)
    assert network.density[1, 2, 2] == pytest.approx(0.1, rel=0.06)  # triangles are two voxels wide
    assert network.density[:, [0, 1, 3]].sum() == 0.0
    cut = network_of(faults, upright, cell=(10, 35, 50))
    # the last cell along the crosslines has 5 of 35: no fault there
    assert cut.density.shape == (3, 2, 1)
    assert cut.density[1, 0, 0] == pytest.approx(39.0 / (35.0 * 50.0), rel=0.06)
    whole = network_of(faults, upright, cell=10**30).density
    assert whole.shape == (1, 1, 1)
    np.testing.assert_array_equal(whole, network_of(faults, upright, cell=1000).density)


def test_same_whatever_the_order_of_faults() -> None:
    faults = make_faults(make_cube())
    one, other = network_of(faults, *faults.surfaces), network_of(faults, *faults.surfaces[::-1])
    assert one.intersections[0].length == pytest.approx(other.intersections[0].length, abs=0.6)
    assert one.intersections[0].angle_deg == pytest.approx(other.intersections[0].angle_deg, abs=0.01)
    np.testing.assert_allclose(one.density, other.density, rtol=1e-5)


def test_graph_comes_back_from_graphml_and_tables_hold_it(tmp_path: Path) -> None:
    cube = make_cube()
    network = fracture_network(make_faults(cube))
    files = write_network(network, cube, directory=tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {file.name for file in files}
    read = nx.read_graphml(tmp_path / "network.graphml", node_type=int)
    assert set(read.nodes) == {1, 2}
    assert read.nodes[2]["kind"] == "reverse"
    assert read.edges[1, 2]["length"] == pytest.approx(network.intersections[0].length)
    rows = (tmp_path / "intersections.csv").read_text().splitlines()
    assert rows[0].split(",")[:4] == ["first", "second", "kind", "abutting"]
    assert rows[1].startswith("1,2,cross,,")
    names, first = (row.split(",") for row in (tmp_path / "zones.csv").read_text().splitlines()[:2])
    assert float(first[names.index("intensity")]) == pytest.approx(network.zones[0].intensity, rel=1e-5)
    assert summarise_network(network)["intersections_per_fault"] == 1.0


def test_no_faults_is_a_network_without_vertices(tmp_path: Path) -> None:
    cube = make_cube()
    network = network_of(make_faults(cube))
    assert network.graph.number_of_nodes() == 0
    assert network.density.max() == 0.0
    assert network.sets == ()
    assert summarise_network(network)["faults"] == 0
    write_network(network, cube, directory=tmp_path)
    assert (tmp_path / "zones.csv").read_text().count("\n") == 1


def test_refusals() -> None:
    section, lines = make_section()
    with pytest.raises(ShapeError, match="section of shape"):
        fracture_network(lines)
    with pytest.raises(ShapeError, match="section of shape"):
        flow_path(lines, (0, 0, 0), (1, 1, 1))
    faults = make_faults(make_cube())
    with pytest.raises(ParameterError, match="cell is 0"):
        fracture_network(faults, cell=0)
    with pytest.raises(ParameterError, match=r"cell is 2\.5; expected a whole number"):
        fracture_network(faults, cell=2.5)  # type: ignore[arg-type]
    with pytest.raises(ShapeError, match="start is 'a'; expected a point"):
        flow_path(faults, "a", (110, 520, 1100))
    with pytest.raises(ParameterError, match=r"end is .*nan.*; expected finite"):
        flow_path(faults, (110, 520, 1100), (np.nan, 520, 1100))
    with pytest.raises(ParameterError, match=r"start \(0\.0, 0\.0, 0\.0\) lies outside the cube"):
        flow_path(faults, np.zeros(3), (110, 520, 1100))
    with pytest.raises(ParameterError, match=r"start .* outside the cube"):
        flow_path(faults, (0, 0, 0), (110, 520, 1100))
    with pytest.raises(ShapeError, match="end has shape"):
        flow_path(faults, (110, 520, 1100), np.zeros((4, 4)))
    with pytest.raises(ParameterError, match="end lies nowhere"):
        flow_path(faults, (110, 520, 1100), np.full((30, 40), 9000.0))
    with pytest.raises(GeometryError, match="share a voxel"):
        flow_path(faults, (110, 520, 1100), (110, 520, 1100))
    assert section.ndim == 2


def sheet_faults() -> FaultSet:
    """A bare cube with one vertical sheet at crossline 12 that has a hole, and nothing else."""
    labels = np.zeros((20, 24, 30), np.int32)
    labels[:, 12, :] = 1
    labels[6:14, 12, 10:20] = 0
    likelihood = np.where(labels > 0, 0.9, 0.0).astype(np.float32)
    return FaultSet((), likelihood, labels, np.full(labels.shape, np.nan, np.float32), settings={})


def test_path_runs_along_the_sheet_and_around_its_hole() -> None:
    path = flow_path(sheet_faults(), (10, 12, 2), (10, 12, 27))
    assert (path.voxels[:, 1] == 12).all()
    assert path.share_on_faults == 1.0
    assert path.surfaces == (1,)
    i, k = path.voxels[:, 0], path.voxels[:, 2]
    assert not ((i >= 6) & (i < 14) & (k >= 10) & (k < 20)).any()
    assert path.resistance == pytest.approx(path.length / (1.0 + 49.0 * 0.9), rel=1e-5)
    np.testing.assert_array_equal(path.points, path.voxels)


def test_path_in_plain_rock_is_straight() -> None:
    # the ridge is no fault, and conducts nothing
    faults = replace(sheet_faults(), labels=np.zeros((20, 24, 30), np.int32))
    path = flow_path(faults, (3, 4, 5), (3, 4, 25))
    assert path.length == pytest.approx(20.0)
    assert path.straight == pytest.approx(1.0)
    assert path.share_on_faults == 0.0
    # nor does a fault that conducts as rock does
    assert flow_path(sheet_faults(), (3, 4, 5), (3, 4, 25), contrast=1.0).straight == pytest.approx(1.0)
    with pytest.raises(ParameterError, match=r"contrast is 0\.5"):
        flow_path(faults, (3, 4, 5), (3, 4, 25), contrast=0.5)


def bare_rock(cube: Any) -> FaultSet:
    nothing = (cube.copy(data=np.zeros(cube.shape, dtype)) for dtype in (np.float32, np.int32, np.float32))
    return FaultSet((), *nothing, settings={})


def skewed_cube() -> Any:
    """A cube in depth whose lines meet at 79 degrees."""
    cube = depth_cube()
    i, j = np.meshgrid(np.arange(30), np.arange(40), indexing="ij")
    places = {"cdp_x": 5e5 + 20.0 * i + 12.5 * j, "cdp_y": 6e6 + 30.0 * i - 5.0 * j}
    return cube.assign_coords({name: (("inline", "crossline"), xy) for name, xy in places.items()})


@pytest.mark.parametrize("end", [(130, 515, 1120), (104, 539, 1196), (158, 501, 1004)])
def test_no_way_through_unbroken_rock_is_easier_than_straight_through_it(end: tuple[float, ...]) -> None:
    for cube in (make_cube(), depth_cube(), skewed_cube()):
        path = flow_path(bare_rock(cube), (102, 520, 1040), end)
        assert path.straight == pytest.approx(1.0, abs=1e-12)
        assert path.resistance == pytest.approx(path.length, rel=1e-12)


def test_resistance_is_of_true_lengths_where_lines_meet_at_no_right_angle() -> None:
    cube = skewed_cube()[:6, :7, :8]
    labels = np.random.default_rng(3).uniform(size=cube.shape) < 0.3
    faults = replace(bare_rock(cube), labels=cube.copy(data=labels.astype(np.int32)))
    path = flow_path(faults, (100, 506, 1000), (110, 500, 1028))
    step = np.array([[20.0, 30.0, 0.0], [12.5, -5.0, 0.0], [0.0, 0.0, 4.0]])
    lengths = np.linalg.norm(np.diff(path.voxels, axis=0) @ step, axis=1)
    across = np.where(labels, 1.0 / (1.0 + 49.0 * 0.5), 1.0)[tuple(path.voxels.T)]
    assert path.length == pytest.approx(lengths.sum(), rel=1e-9)
    assert path.resistance == pytest.approx((lengths * (across[1:] + across[:-1]) / 2).sum(), rel=1e-6)


def test_path_between_horizons_takes_the_fault_wherever_it_meets_them() -> None:
    faults = sheet_faults()
    top, foot = np.full((20, 24), 3.2), np.full((20, 24), 26.8)
    top[:, 20:] = np.nan
    path = flow_path(faults, top, foot)
    assert (path.voxels[0, 2], path.voxels[-1, 2]) == (3, 27)
    assert path.voxels[len(path.voxels) // 2, 1] == 12
    # no point to point path between them is cheaper
    assert path.resistance <= flow_path(faults, (10, 12, 3), (10, 12, 27)).resistance + 1e-6
    assert path.straight > 30.0


def test_metres_count_in_a_depth_cube() -> None:
    cube = depth_cube()
    path = flow_path(bare_rock(cube), (110, 510, 1040), (110, 510, 1140))
    assert (path.length, path.unit) == (pytest.approx(100.0), "m")
    assert IndexFrame.of(cube).steps == pytest.approx((25.0, 12.5, 4.0))
    # a map in feet: bins are as many feet, and so many feet are four metres
    for name in ("cdp_x", "cdp_y"):
        cube[name].attrs["units"] = "ft"
    frame = IndexFrame.of(cube)
    assert (frame.unit, frame.steps) == ("ft", pytest.approx((25.0, 12.5, 4.0 / 0.3048)))
