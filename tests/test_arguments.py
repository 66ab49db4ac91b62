"""Arguments of a wrong kind at the doors of public functions: one short line that names what came."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube, make_faults
from matplotlib.figure import Figure

import seismo3d as s3
from seismo3d._stages import as_progress
from seismo3d._validate import told
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.io.horizons import HorizonPoints
from seismo3d.plot.map_pictures import surface_picture
from seismo3d.seismic.loop_closure import LoopClosure
from seismo3d.seismic.picks import horizon_seeds

CUBE = np.random.default_rng(1).normal(size=(24, 24, 48)).astype(np.float32)
RNG = np.random.default_rng(4)
IMAGE = np.random.default_rng(2).integers(0, 255, (64, 64)).astype(np.uint8)
POINTS = np.random.default_rng(2).normal(size=(200, 3))
SEEDS = [(12, 12, 24.0)]
MAP = np.random.default_rng(3).normal(size=(80, 80)).cumsum(0).cumsum(1)
PLACED = make_cube()
FAULTS = make_faults(PLACED)
OPEN = s3.robot.Occupancy(np.zeros((60, 60)), np.zeros((60, 60)), 0.05)
SEQUENCE = s3.synthetic.rgbd_sequence(frames=1, size=(32, 24))
CAMERA = s3.robot.Camera(SEQUENCE.camera)
CLOSURE = LoopClosure(0.0, 0.0, 0, 1, np.zeros(PLACED.shape[:2], np.float32))
LINES = s3.terrain.LineamentSet((), MAP, s3.terrain.MapGrid.from_elevation(MAP))
PICKS = HorizonPoints("top", POINTS, np.full((200, 2), np.nan))
WRONG: dict[str, Any] = {
    "array": np.zeros((4, 5)),
    "cube": PLACED,
    "faults": FAULTS,
    "word": "nonsense",
    "list": [object()],
}
CALLS: dict[str, Callable[[Any], Any]] = {
    "trace_faults evidence": lambda wrong: s3.trace_faults(CUBE, evidence=wrong),
    "trace_faults memory": lambda wrong: s3.trace_faults(CUBE, memory=wrong),
    "trace_faults progress": lambda wrong: s3.trace_faults(CUBE, progress=wrong),
    "trace_tracks event": lambda wrong: s3.trace_tracks(CUBE, SEEDS, event=wrong),
    "trace_tracks layers": lambda wrong: s3.trace_tracks(CUBE, SEEDS, layers=wrong),
    "trace_tracks progress": lambda wrong: s3.trace_tracks(CUBE, SEEDS, progress=wrong),
    "find_horizons count": lambda wrong: s3.find_horizons(CUBE, wrong),
    "find_horizons layers": lambda wrong: s3.find_horizons(CUBE, layers=wrong),
    "find_horizons progress": lambda wrong: s3.find_horizons(CUBE, progress=wrong),
    "layer_time progress": lambda wrong: s3.layer_time(CUBE, progress=wrong),
    "loop_closure progress": lambda wrong: s3.loop_closure(CUBE, progress=wrong),
    "align_cubes progress": lambda wrong: s3.align_cubes(CUBE, CUBE, progress=wrong),
    "unfault progress": lambda wrong: s3.unfault(PLACED, FAULTS, progress=wrong),
    "fracture_network progress": lambda wrong: s3.fracture_network(FAULTS, progress=wrong),
    "fault_cube kind": s3.synthetic.fault_cube,
    "fault_cube progress": lambda wrong: s3.synthetic.fault_cube(shape=(8, 8, 16), progress=wrong),
    "rgbd_sequence kind": s3.synthetic.rgbd_sequence,
    "rgbd_sequence moving": lambda wrong: s3.synthetic.rgbd_sequence(moving=wrong),
    "rgbd_sequence seed": lambda wrong: s3.synthetic.rgbd_sequence(seed=wrong),
    "rgbd_sequence size": lambda wrong: s3.synthetic.rgbd_sequence(size=wrong),
    "rgbd_sequence blackout": lambda wrong: s3.synthetic.rgbd_sequence(frames=2, size=(32, 24), blackout=wrong),
    "rgbd_sequence camera": lambda wrong: s3.synthetic.rgbd_sequence(frames=2, camera=wrong),
    "rgbd_sequence noise": lambda wrong: s3.synthetic.rgbd_sequence(frames=2, noise=wrong),
    "fault_cube seed": lambda wrong: s3.synthetic.fault_cube(shape=(8, 8, 16), seed=wrong),
    "Mapper.add frame": lambda wrong: s3.robot.Mapper(CAMERA).add(wrong),
    "calibrate_timing frame": lambda wrong: s3.robot.calibrate_timing([wrong], CAMERA),
    "calibrate_timing camera": lambda wrong: s3.robot.calibrate_timing([], wrong),
    "plan_path occupancy": lambda wrong: s3.robot.plan_path(wrong, (1.0, 1.0), (2.0, 2.0)),
    "plan_path start": lambda wrong: s3.robot.plan_path(OPEN, wrong, (2.0, 2.0)),
    "plan_path robot": lambda wrong: s3.robot.plan_path(OPEN, (1.0, 1.0), (2.0, 2.0), robot=wrong),
    "plan_path unknown": lambda wrong: s3.robot.plan_path(OPEN, (1.0, 1.0), (2.0, 2.0), unknown=wrong),
    "Planner.update_map occupancy": lambda wrong: s3.robot.Planner(OPEN, (1.0, 1.0), (2.0, 2.0)).update_map(wrong),
    "PlaceIndex.query until": lambda wrong: s3.PlaceIndex().query(s3.describe(IMAGE), until=wrong),
    "RgbdSequence.write progress": lambda wrong: SEQUENCE.write("none", progress=wrong),
    "occupancy_map occupancy": s3.plot.occupancy_map,
    "Camera lens": s3.robot.Camera,
    "Camera clock_offset": lambda wrong: s3.robot.Camera(CAMERA.lens, clock_offset=wrong),
    "PinholeCamera cx": lambda wrong: PinholeCamera(500.0, 500.0, wrong, 240.0),
    "PinholeCamera distortion": lambda wrong: PinholeCamera(500.0, 500.0, 320.0, 240.0, wrong),
    "PinholeCamera width": lambda wrong: PinholeCamera(500.0, 500.0, 320.0, 240.0, width=wrong),
    "Occupancy origin": lambda wrong: s3.robot.Occupancy(np.zeros((4, 4)), np.zeros((4, 4)), 0.05, wrong),
    "MapperSettings terms": lambda wrong: s3.robot.MapperSettings(terms=wrong),
    "MapperSettings measure": lambda wrong: s3.robot.MapperSettings(measure=wrong),
    "MapperSettings filtered": lambda wrong: s3.robot.MapperSettings(filtered=wrong),
    "MapperSettings keep_every": lambda wrong: s3.robot.MapperSettings(keep_every=wrong),
    "Scan.from_elevation spacing": lambda wrong: s3.Scan.from_elevation(MAP, wrong),
    "Scan.from_points features": lambda wrong: s3.Scan.from_points(POINTS, features=wrong),
    "CubeRecipe shape": lambda wrong: s3.synthetic.CubeRecipe(shape=wrong),
    "CubeRecipe wavelength": lambda wrong: s3.synthetic.CubeRecipe(wavelength=wrong),
    "CubeRecipe unconformity": lambda wrong: s3.synthetic.CubeRecipe(unconformity=wrong),
    "CubeRecipe noise": lambda wrong: s3.synthetic.CubeRecipe(noise=wrong),
    "CubeRecipe smiles": lambda wrong: s3.synthetic.CubeRecipe(smiles=wrong),
    "CubeRecipe population": lambda wrong: s3.synthetic.CubeRecipe(population=wrong),
    "CubeRecipe faults": lambda wrong: s3.synthetic.CubeRecipe(faults=wrong),
    "SyntheticFault centre": lambda wrong: s3.synthetic.SyntheticFault(wrong, 0.0, 60.0, 5.0),
    "SyntheticFault throw": lambda wrong: s3.synthetic.SyntheticFault((1.0, 1.0, 1.0), 0.0, 60.0, wrong),
    "SyntheticFault profile": lambda wrong: s3.synthetic.SyntheticFault((1.0, 1.0, 1.0), 0.0, 60.0, 5.0, wrong),
    "FaultPopulation count": lambda wrong: s3.synthetic.FaultPopulation(count=wrong),
    "FaultPopulation families": lambda wrong: s3.synthetic.FaultPopulation(families=wrong),
    "coloured_noise rng": lambda wrong: s3.synthetic.coloured_noise(wrong, (4, 8), 0.1),
    "coloured_noise shape": lambda wrong: s3.synthetic.coloured_noise(RNG, wrong, 0.1),
    "coloured_noise lateral": lambda wrong: s3.synthetic.coloured_noise(RNG, (4, 8), 0.1, lateral=wrong),
    "migration_smiles shape": lambda wrong: s3.synthetic.migration_smiles(RNG, wrong, 0.1, count=1),
    "migration_smiles count": lambda wrong: s3.synthetic.migration_smiles(RNG, (4, 4, 16), 0.1, count=wrong),
    "sample_faults population": lambda wrong: s3.synthetic.sample_faults(RNG, (8, 8, 16), wrong),
    "sample_folding slope": lambda wrong: s3.synthetic.sample_folding(RNG, (8, 8, 16), slope=wrong, tilt=0.1),
    "sample_folding width": lambda wrong: s3.synthetic.sample_folding(
        RNG, (8, 8, 16), slope=0.1, tilt=0.1, width=wrong
    ),
    "present_slip cube": s3.synthetic.present_slip,
    "exact_displacement cube": s3.synthetic.exact_displacement,
    "places_before cube": lambda wrong: s3.synthetic.places_before(wrong, POINTS),
    "make_cube recipe": s3.synthetic.make_cube,
    "score_horizon picks": lambda wrong: s3.score_horizon([PICKS], wrong, tolerance=4.0),
    "score_horizon extent of": lambda wrong: s3.score_horizon([PICKS], PICKS, tolerance=4.0, extent=(0.0, wrong)),
    "horizon_seeds horizon": lambda wrong: horizon_seeds(wrong, PLACED),
    "score_horizon extent": lambda wrong: s3.score_horizon([PICKS], PICKS, tolerance=4.0, extent=wrong),
    "align_pairs model": lambda wrong: s3.align_pairs(POINTS, POINTS, model=wrong),
    "align_pairs features": lambda wrong: s3.align_pairs(POINTS, POINTS, features=wrong),
    "align_pairs constraints": lambda wrong: s3.align_pairs(POINTS, POINTS, constraints=wrong),
    "register model": lambda wrong: s3.register(POINTS, POINTS, model=wrong),
    "register stages": lambda wrong: s3.register(POINTS, POINTS, stages=wrong),
    "register constraints": lambda wrong: s3.register(POINTS, POINTS, constraints=wrong),
    "register correspondences": lambda wrong: s3.register(POINTS, POINTS, correspondences=wrong),
    "match tilts": lambda wrong: s3.match(IMAGE, IMAGE, tilts=wrong),
    "terrain.register model": lambda wrong: s3.terrain.register(MAP, MAP, model=wrong),
    "terrain.register vertical": lambda wrong: s3.terrain.register(MAP, MAP, vertical=wrong),
    "lineaments progress": lambda wrong: s3.terrain.lineaments(MAP, progress=wrong),
    "compare registration": lambda wrong: s3.terrain.compare(MAP, MAP, registration=wrong),
    "compare least_patch": lambda wrong: s3.terrain.compare(MAP, MAP, least_patch=wrong),
    "scarps found": lambda wrong: s3.terrain.scarps(MAP, wrong),
    "to_geojson found": s3.terrain.to_geojson,
    "to_geojson scarps": lambda wrong: s3.terrain.to_geojson(LINES, wrong),
    "make_elevation nodata": lambda wrong: s3.terrain.make_elevation(MAP, nodata=wrong),
    "make_elevation crs_unit": lambda wrong: s3.terrain.make_elevation(MAP, crs_unit=wrong),
    "terrain.register matches": lambda wrong: s3.terrain.register(MAP, MAP, matches=wrong),
    "plot.terrain outcrops": lambda wrong: s3.plot.terrain(MAP, outcrops=wrong),
    "strike_rose from_north": lambda wrong: s3.plot.strike_rose(FAULTS, from_north=wrong),
    "time_lapse_section alignment": lambda wrong: s3.plot.time_lapse_section(PLACED, PLACED, wrong),
    "plot.matches found": lambda wrong: s3.plot.matches(IMAGE, IMAGE, wrong),
    "plot.cube size": lambda wrong: s3.plot.cube(PLACED, size=wrong, off_screen=True),
    "surface_picture size": lambda wrong: surface_picture(None, T_world_map=np.eye(4), size=wrong),
    "save_scene size": lambda wrong: s3.plot.save_scene("none.png", PLACED, size=wrong),
    "Constraints rotation": lambda wrong: s3.Constraints(rotation=wrong),
    "Constraints translation": lambda wrong: s3.Constraints(translation=(0.0, wrong, 0.0)),
    "Constraints scale": lambda wrong: s3.Constraints(scale=wrong),
    "section inline": lambda wrong: s3.plot.section(PLACED, inline=wrong),
    "section colour": lambda wrong: s3.plot.section(PLACED, colour=wrong),
    "section cmap": lambda wrong: s3.plot.section(PLACED, cmap=wrong, ax=Figure().subplots()),
    "section ax": lambda wrong: s3.plot.section(PLACED, ax=wrong),
    "time_slice time": lambda wrong: s3.plot.time_slice(PLACED, time=wrong),
    "throw_map ax": lambda wrong: s3.plot.throw_map(FAULTS, PLACED, ax=wrong),
    "strike_rose ax": lambda wrong: s3.plot.strike_rose(FAULTS, from_north=True, ax=wrong),
    "throw_histogram ax": lambda wrong: s3.plot.throw_histogram(FAULTS, ax=wrong),
    "network_map network": lambda wrong: s3.plot.network_map(wrong, FAULTS, PLACED),
    "density_map network": lambda wrong: s3.plot.density_map(wrong, PLACED),
    "stereonet network": lambda wrong: s3.plot.stereonet(wrong, from_north=True),
    "flow_path_views path": lambda wrong: s3.plot.flow_path_views(wrong, FAULTS, PLACED),
    "track_map track": lambda wrong: s3.plot.track_map(wrong, PLACED),
    "loop_map closure": lambda wrong: s3.plot.loop_map(wrong, PLACED),
    "loop_map most": lambda wrong: s3.plot.loop_map(CLOSURE, PLACED, most=wrong),
    "unfaulted_section axes": lambda wrong: s3.plot.unfaulted_section(PLACED, PLACED, axes=wrong),
    "plot.cube inline": lambda wrong: s3.plot.cube(PLACED, inline=wrong, off_screen=True),
    "plot.cube cmap": lambda wrong: s3.plot.cube(PLACED, cmap=wrong, off_screen=True),
    "plot.cube off_screen": lambda wrong: s3.plot.cube(PLACED, off_screen=wrong),
    "plot.terrain lines": lambda wrong: s3.plot.terrain(MAP, lines=wrong),
    "lineament_rose lines": s3.plot.lineament_rose,
    "change_map change": s3.plot.change_map,
    "scarp_profile scarp": s3.plot.scarp_profile,
    "as_cube domain": lambda wrong: s3.as_cube(CUBE, domain=wrong),
    "open_cube scan": lambda wrong: s3.open_cube("none.sgy", scan=wrong),
    "open_cube lazy": lambda wrong: s3.open_cube("none.sgy", lazy=wrong),
}


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("name", CALLS)
def test_an_argument_of_a_wrong_kind_is_named_in_one_short_line(name: str, kind: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{name.split()[1]} ") as error:
        CALLS[name](WRONG[kind])
    assert "expected" in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 300


@pytest.mark.parametrize("draw", [s3.plot.throw_histogram, lambda wrong: s3.plot.strike_rose(wrong, from_north=True)])
@pytest.mark.parametrize("wrong", [None, PLACED, "faults"], ids=["none", "cube", "word"])
def test_what_draws_faults_alone_needs_some(draw: Callable[[Any], Any], wrong: Any) -> None:
    with pytest.raises(ParameterError, match=r"faults is .*; expected a FaultSet"):
        draw(wrong)


@pytest.mark.parametrize(
    "draw", [lambda none: s3.plot.throw_map(none, PLACED), lambda none: s3.plot.likelihood(PLACED, faults=none)]
)
def test_what_draws_faults_on_a_cube_needs_some(draw: Callable[[Any], Any]) -> None:
    with pytest.raises(ParameterError, match="faults is None; expected a FaultSet"):
        draw(None)


def test_one_track_in_place_of_a_list_is_refused() -> None:
    track = s3.Track(np.full(PLACED.shape[:2], 1100.0, np.float32), np.ones(PLACED.shape[:2], np.float32), POINTS)
    for draw in (
        s3.plot.track_section,
        lambda cube, tracks: s3.plot.cube(cube, tracks=tracks, off_screen=True),
        lambda cube, tracks: s3.viewer.Session(cube, tracks=tracks),
    ):
        with pytest.raises(ParameterError, match=r"tracks is .*; expected a list of Track\. Give a list, be it of one"):
            draw(PLACED, track)


def test_no_tracks_are_drawn_as_none() -> None:
    axes = Figure().subplots()
    s3.plot.track_section(PLACED, None, ax=axes)  # type: ignore[arg-type]
    assert not axes.lines


@pytest.mark.parametrize(
    "take",
    [
        s3.as_cube,
        s3.trace_faults,
        s3.layer_time,
        s3.loop_closure,
        s3.find_horizons,
        s3.describe,
        s3.Scan.from_volume,
        s3.plot.section,
        s3.terrain.make_elevation,
        s3.terrain.lineaments,
        lambda rows: s3.trace_tracks(rows, SEEDS),
        lambda rows: s3.align_cubes(rows, CUBE),
        lambda rows: s3.describe(IMAGE, mask=rows),
        lambda rows: s3.match(rows, IMAGE),
        lambda rows: s3.register(rows, POINTS),
        lambda rows: s3.terrain.register(rows, MAP),
        lambda rows: s3.write_segy("none.sgy", rows),
    ],
)
def test_rows_of_different_lengths_are_no_cube(take: Callable[[Any], Any]) -> None:
    with pytest.raises(ShapeError, match=r"^[\w ]+ makes no array: .* Give rows of one length\.$"):
        take([[[1.0, 2.0], [3.0]], [[1.0, 2.0], [3.0]]])


@pytest.mark.parametrize("draw", [s3.plot.section, s3.plot.time_slice, s3.plot.cube, s3.viewer.Session])
@pytest.mark.parametrize("kind", [complex, str, object])
def test_cubes_that_are_no_real_numbers_are_not_drawn(draw: Callable[[Any], Any], kind: type) -> None:
    with pytest.raises(ShapeError, match=r"^cube has elements of type .*; expected real numbers\. Convert it first"):
        draw(np.zeros((4, 5, 6), kind))


@pytest.mark.parametrize("points", ["points", None, [[1, 2], [3, 4]], POINTS[0], POINTS * 1j], ids=str)
def test_a_scan_of_no_points_is_told_how_to_be_made(points: Any) -> None:
    with pytest.raises(ShapeError, match=r"^points is .*; expected rows of float64\. Make it by Scan\.from_points\.$"):
        s3.Scan(points)


@pytest.mark.parametrize("name", ["wavelength", "tilt", "noise", "dead_traces"])
@pytest.mark.parametrize("wrong", [None, {4.0, 5.0}, {"low": 4.0, "high": 5.0}], ids=["none", "set", "dict"])
def test_a_recipe_needs_its_numbers_in_their_order(name: str, wrong: Any) -> None:
    with pytest.raises(
        ParameterError,
        match=rf"^{name} is .*; expected \(?(a number in .*, a number in .*|a number in .*) for CubeRecipe",
    ):
        s3.synthetic.CubeRecipe(**{name: wrong})


def test_an_open_range_of_constraints_is_kept() -> None:
    bounds = s3.Constraints(translation=([-np.inf, 0.5], np.array([-1, 1]), None))  # type: ignore[arg-type]
    assert bounds.translation == ((-np.inf, 0.5), (-1.0, 1.0), None)


def test_a_rendered_frame_is_told_from_a_camera_s() -> None:
    rendered = s3.synthetic.rgbd_sequence(frames=1, size=(32, 24))[0]
    with pytest.raises(ParameterError, match=r"expected RgbdFrame\. Give seismo3d\.robot\.RgbdFrame\.of\(rgb, depth"):
        s3.robot.Mapper(CAMERA).add(rendered)  # type: ignore[arg-type]


def test_a_rose_wants_polar_axes() -> None:
    with pytest.raises(ParameterError, match="expected PolarAxes"):
        s3.plot.strike_rose(FAULTS, from_north=True, ax=Figure().subplots())


def test_layers_say_where_they_come_from() -> None:
    words = r"layers is an array of shape \(24, 24, 48\); expected LayerModel\. Give what model_layers returned"
    with pytest.raises(ParameterError, match=words):
        s3.trace_tracks(CUBE, SEEDS, layers=s3.layer_time(CUBE))


@pytest.mark.parametrize("wrong", [None, 7, object(), CUBE, ["a"]], ids=["none", "number", "object", "array", "list"])
@pytest.mark.parametrize(
    "take",
    [
        s3.open_cube,
        s3.read_horizon,
        s3.read_sticks,
        s3.terrain.read_elevation,
        s3.robot.read_sequence,
        s3.FaultSet.load,
        s3.Scan.from_file,
        FAULTS.save,
        OPEN.save,
        SEQUENCE.write,
        s3.robot.Mapper(CAMERA).save,
        s3.robot.Trajectory(np.zeros(0), np.zeros((0, 4, 4)), np.zeros(0, int), np.zeros(0, int)).save_tum,
        lambda wrong: s3.write_segy(wrong, PLACED, like=None),
        lambda wrong: s3.terrain.write_elevation(wrong, MAP),
    ],
)
def test_what_is_no_path_is_refused(take: Callable[[Any], Any], wrong: Any) -> None:
    with pytest.raises(ParameterError, match=r"(path|directory|folder) is .*; expected the name of a file or folder"):
        take(wrong)


@pytest.mark.parametrize("byte", ["inline_byte", "crossline_byte"])
@pytest.mark.parametrize("wrong", ["189", 9.5, CUBE], ids=["text", "fraction", "array"])
def test_a_header_byte_that_is_no_whole_number_is_refused(byte: str, wrong: Any, tmp_path: Path) -> None:
    path = s3.write_segy(tmp_path / "cube.sgy", PLACED, like=None)
    with pytest.raises(ParameterError, match=f"{byte} is .*; expected a (whole )?number"):
        s3.open_cube(path, **{byte: wrong})
    with pytest.raises(ParameterError, match=r"x_byte is .*; expected a (whole )?number"):
        s3.open_cube(path, x_byte=wrong, y_byte=185)


def test_values_are_told_in_one_short_line() -> None:
    assert told("peek") == "'peek'"
    assert told(np.float64(2.5)) == repr(np.float64(2.5))
    assert told(CUBE) == told(s3.as_cube(CUBE)) == "an array of shape (24, 24, 48)"
    assert told(list(range(1000))).endswith("...")
    assert len(told(FAULTS)) < 100


def test_results_name_themselves_in_one_line_and_not_by_all_their_numbers() -> None:
    assert repr(FAULTS) == "<FaultSet: 2 surfaces, volumes of shape (30, 40, 50)>"
    assert re.fullmatch(r"<FaultSurface: 280 vertices, area \d+, confidence 0\.80>", repr(FAULTS.surfaces[0]))
    depth = np.where(np.arange(40) < 10, np.nan, np.float32(1100.0)) * np.ones((30, 1), np.float32)
    assert repr(s3.Track(depth, depth, POINTS[:2], "ms")) == "<Track: 2 seeds, on 75% of 1200 traces, in ms>"


def test_no_progress_is_asked_for_by_none() -> None:
    assert as_progress(None)("stage", 0.5) is None
    assert as_progress(print) is print
