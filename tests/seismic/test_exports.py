from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section

from seismo3d.errors import ShapeError
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.exports import write_faults
from seismo3d.seismic.fault_table import list_columns, mean_strike_deg, tabulate_faults
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.track_exports import write_tracks
from seismo3d.seismic.tracks import Track


def read_gocad(path: Path) -> list[dict[str, Any]]:
    """An independent reader of the format's grammar."""
    objects: list[dict[str, Any]] = []
    for line in path.read_text(encoding="ascii").splitlines():
        words = line.split()
        if words[0] == "GOCAD":
            objects.append({"kind": words[1], "points": [], "cells": [], "values": []})
        current = objects[-1]
        if line.startswith("name:"):
            current["name"] = line[5:]
        elif words[0] in ("PROPERTIES", "UNITS", "NO_DATA_VALUES", "ESIZES", "ZPOSITIVE", "AXIS_UNIT"):
            current[words[0]] = words[1:]
        elif words[0] == "PVRTX":
            assert int(words[1]) == len(current["points"]) + 1
            current["points"].append([float(w) for w in words[2:5]])
            current["values"].append([float(w) for w in words[5:]])
        elif words[0] in ("TRGL", "SEG"):
            current["cells"].append([int(w) for w in words[1:]])
    return objects


def test_gocad_surfaces(tmp_path: Path) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    write_faults(faults, cube, directory=tmp_path)
    objects = read_gocad(tmp_path / "surfaces.ts")
    assert [(o["kind"], o["name"]) for o in objects] == [("TSurf", "fault_001"), ("TSurf", "fault_002")]
    survey = SurveyGeometry.from_cube(cube)
    for written, surface in zip(objects, faults.surfaces, strict=True):
        assert written["ZPOSITIVE"] == ["Depth"]
        assert written["AXIS_UNIT"] == ['"m"', '"m"', '"ms"']
        assert written["PROPERTIES"] == [
            "throw", "throw_ms", "throw_fit", "heave", "strike_slip", "rake", "heave_m", "strike_slip_m", "likelihood",
            "strike", "dip",
        ]  # fmt: skip
        assert written["UNITS"] == [
            "samples", "ms", "none", "traces", "traces", "deg", "m", "m", "none", "deg", "deg",
        ]  # fmt: skip
        np.testing.assert_allclose(written["points"], survey.index_to_map(surface.vertices), atol=1e-3)
        np.testing.assert_array_equal(np.array(written["cells"]) - 1, surface.cells)
        throw = np.array(written["values"])[:, 0]
        assert (throw[:3] == -99999).all()
        np.testing.assert_allclose(throw[3:], surface.throw[3:], rtol=1e-5)
        np.testing.assert_allclose(np.array(written["values"])[:, 2], surface.throw_fit, atol=1e-5)
        np.testing.assert_allclose(np.array(written["values"])[:, 8], surface.likelihood, rtol=1e-5)


def test_vtk_surfaces_are_read_by_vtk(tmp_path: Path) -> None:
    import pyvista as pv

    cube = make_cube()
    faults = make_faults(cube)
    write_faults(faults, cube, directory=tmp_path)
    mesh = pv.read(tmp_path / "surfaces.vtp")
    points = np.concatenate([SurveyGeometry.from_cube(cube).index_to_map(s.vertices) for s in faults.surfaces])
    np.testing.assert_allclose(mesh.points, points)
    n = len(faults.surfaces[0].vertices)
    cells = np.concatenate([faults.surfaces[0].cells, faults.surfaces[1].cells + n])
    np.testing.assert_array_equal(mesh.regular_faces, cells)
    np.testing.assert_array_equal(mesh["surface"], np.repeat([1, 2], [n, n]))
    for name, attribute in {
        "throw": "throw",
        "likelihood": "likelihood",
        "strike": "strike_deg",
        "dip": "dip_deg",
    }.items():
        np.testing.assert_array_equal(mesh[name], np.concatenate([getattr(s, attribute) for s in faults.surfaces]))
    assert mesh.field_data["z"][0] == "z: two-way time in ms, positive down"
    assert mesh.field_data["xy"][0] == "x, y: metres on the map"


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [("time", "s", "time in s"), ("depth", "km", "depth in km"), ("time", "samples", "sample number")],
)
def test_vtk_surfaces_name_the_unit_of_z_as_the_cube_does(tmp_path: Path, name: str, unit: str, words: str) -> None:
    import pyvista as pv

    cube = make_cube().assign_attrs(sample_unit=unit)
    cube = cube if name == "time" else cube.rename(time=name)
    write_faults(make_faults(cube), cube, directory=tmp_path)
    assert pv.read(tmp_path / "surfaces.vtp").field_data["z"][0] == f"z: {words}, positive down"


def test_stick_files_have_the_columns_of_their_formats(tmp_path: Path) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    write_faults(faults, cube, directory=tmp_path)
    survey = SurveyGeometry.from_cube(cube)
    rows = [line.split() for line in (tmp_path / "sticks_opendtect.txt").read_text().splitlines()]
    assert all(len(row) == 6 for row in rows)
    assert {row[0] for row in rows} == {"fault_001", "fault_002"}
    nodes = [(row[0], int(row[4]), int(row[5])) for row in rows]
    assert len(set(nodes)) == len(nodes)
    charisma = [line.split() for line in (tmp_path / "sticks_petrel.txt").read_text().splitlines()]
    assert len(charisma) == len(rows)
    for row, other in zip(charisma, rows, strict=True):
        assert row[0] == "INLINE-"
        assert len(row) == 8
        assert row[3:6] == other[1:4]
        assert row[6] == other[0]
        assert row[7] == other[4]
        lines = survey.index_to_lines(survey.map_to_index([[float(w) for w in row[3:6]]]))[0]
        # whole line numbers; the step of the inlines is 2, x and y have two decimals
        assert abs(lines[0] - int(row[1])) < 0.51
        assert abs(lines[1] - int(row[2])) < 0.51


def test_table_has_the_known_numbers(tmp_path: Path) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    write_faults(faults, cube, directory=tmp_path)
    with (tmp_path / "faults.csv").open(newline="") as file:
        first, second = csv.DictReader(file)
    assert float(first["dip_deg"]) == pytest.approx(63.4349, abs=1e-3)
    assert (float(first["strike_deg"]), float(second["strike_deg"])) == (0.0, 270.0)
    assert float(first["throw_mean_samples"]) == pytest.approx(4.0, rel=0.01)
    assert float(first["throw_mean_ms"]) == pytest.approx(16.0, rel=0.01)
    assert float(first["throw_fit"]) == pytest.approx(0.5, abs=0.05)
    # but for where the sides do not match, or throw is not known at all
    unmatched = faults.surfaces[0]
    fit = np.where(unmatched.vertices[:, 2] < unmatched.vertices[:, 2].mean(), 0.0, unmatched.throw_fit)
    half = replace(faults, surfaces=(replace(unmatched, throw_fit=fit.astype(np.float32)),))
    assert float(first["throw_known"]) > 0.98
    assert tabulate_faults(half, cube)[0]["throw_known"] == pytest.approx(0.5, abs=0.03)
    # the first dips two samples a crossline, and these are 12.5 m apart
    assert float(first["heave_mean_m"]) == pytest.approx(4.0 * 0.5 * 12.5, rel=0.01)
    assert float(second["throw_max_samples"]) == pytest.approx(-3.0)
    assert (first["kind"], second["kind"]) == ("normal", "reverse")
    assert float(first["length_m"]) == pytest.approx(25 * 25.0, rel=1e-3)
    assert [float(first[k]) for k in ("inline_min", "inline_max", "time_min", "time_max")] == [104, 154, 1020, 1176]
    assert float(first["area_index"]) == pytest.approx(25 * 39 * np.hypot(1, 0.5), rel=1e-3)
    assert float(first["confidence"]) == 0.8


def test_depth_cube_has_square_metres() -> None:
    cube = make_cube().rename(time="depth").assign_attrs(sample_unit="m").assign_coords(depth=5.0 * np.arange(50))
    row = tabulate_faults(make_faults(cube), cube)[0]
    # 25 inlines of 25 m along strike; down the plane 39 samples of 5 m and 19.5 crosslines of 12.5 m
    assert row["area_m2"] == pytest.approx(625 * np.hypot(39 * 5, 19.5 * 12.5), rel=1e-3)
    assert "depth_min" in row


def test_survey_in_feet_is_told_in_feet(tmp_path: Path) -> None:
    cube = make_cube().rename(time="depth").assign_attrs(sample_unit="ft").assign_coords(depth=5.0 * np.arange(50))
    for name in ("cdp_x", "cdp_y"):
        cube[name].attrs["units"] = "ft"
    faults = make_faults(cube)
    faults = replace(faults, surfaces=tuple(replace(s, sample_unit="ft", sample_interval=5.0) for s in faults.surfaces))
    row = tabulate_faults(faults, cube)[0]
    assert not [name for name in row if name.endswith(("_m", "_m2", "_ms"))]
    assert row["area_ft2"] == pytest.approx(625 * np.hypot(39 * 5, 19.5 * 12.5), rel=1e-3)
    assert row["length_ft"] == pytest.approx(625, rel=1e-3)
    assert row["throw_mean_ft"] == pytest.approx(20.0, rel=0.01)
    assert row["heave_mean_ft"] == pytest.approx(25.0, rel=0.01)
    np.testing.assert_allclose(faults.surfaces[0].throw_m, faults.surfaces[0].throw * 5 * 0.3048, rtol=1e-6)
    write_faults(faults, cube, directory=tmp_path)
    surfaces = (tmp_path / "surfaces.ts").read_text()
    assert 'AXIS_UNIT "ft" "ft" "ft"' in surfaces
    assert "heave_ft strike_slip_ft" in surfaces
    import pyvista as pv

    assert "feet on the map" in str(pv.read(tmp_path / "surfaces.vtp").field_data["xy"][0])


def test_section_exports_polylines(tmp_path: Path) -> None:
    section, faults = make_section()
    files = write_faults(faults, section, directory=tmp_path)
    assert [file.name for file in files if file.suffix in (".ts", ".pl")] == ["surfaces.pl"]
    (line,) = read_gocad(tmp_path / "surfaces.pl")
    assert line["kind"] == "PLine"
    assert len(line["cells"]) == len(line["points"]) - 1
    import pyvista as pv

    assert pv.read(tmp_path / "surfaces.vtp").n_lines == len(line["cells"])
    with (tmp_path / "faults.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert float(row["throw_mean_ms"]) == 6.0
    assert "strike_deg" not in row


def test_a_section_without_a_map_has_trace_numbers(tmp_path: Path) -> None:
    section, _ = make_section()
    bare = section.drop_vars(["cdp_x", "cdp_y"]).assign_coords(trace=2001 + 2 * np.arange(60))
    depth, sure = np.full(60, 40.0, np.float32), np.ones(60, np.float32)
    write_tracks([Track(depth, sure, np.array([[2001.0, 40.0]]), "ms")], bare, directory=tmp_path)
    places = np.loadtxt(tmp_path / "track_01.xyz")
    np.testing.assert_array_equal(places[:, 0], 2001 + 2 * np.arange(60))
    assert (places[:, 1:] == [0.0, 40.0]).all()


def test_columns_are_those_of_rows() -> None:
    cube = make_cube()
    bare = cube.values
    for of, faults in ((cube, make_faults(cube)), (bare, make_faults(cube)), make_section()):
        if of is bare:
            faults = replace(
                faults, surfaces=tuple(replace(s, sample_unit="samples", sample_interval=1.0) for s in faults.surfaces)
            )
        assert list_columns(of) == list(tabulate_faults(faults, of)[0])


def test_no_faults_give_whole_files(tmp_path: Path) -> None:
    cube = make_cube()
    empty = FaultSet((), cube.copy(data=np.zeros(cube.shape)), cube.copy(data=np.zeros(cube.shape, int)), cube)
    write_faults(empty, cube, directory=tmp_path)
    import pyvista as pv

    assert pv.read(tmp_path / "surfaces.vtp").n_points == 0
    # a script that reads columns by name finds them
    whole = tabulate_faults(make_faults(cube), cube)[0]
    assert (tmp_path / "faults.csv").read_text() == ",".join(whole) + "\n"
    assert (tmp_path / "sticks_petrel.txt").read_text() == ""


def test_faults_of_another_cube_are_refused(tmp_path: Path) -> None:
    cube = make_cube()
    with pytest.raises(ShapeError, match="Give the cube that they were traced in"):
        write_faults(make_faults(cube), cube[:-1], directory=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_mean_strike_wraps() -> None:
    assert mean_strike_deg(np.array([359.0, 1.0]), np.ones(2)) % 360 == pytest.approx(0.0, abs=1e-9)
    assert mean_strike_deg(np.array([10.0, 90.0, np.nan]), np.array([1.0, 0.0, 5.0])) == pytest.approx(10.0)
    assert np.isnan(mean_strike_deg(np.array([np.nan]), np.ones(1)))


def test_seeds_of_tracks_keep_line_numbers_of_seven_digits(tmp_path: Path) -> None:
    cube = make_cube()
    cube = cube.assign_coords(inline=cube.inline.values + 1_234_000)
    depth = np.full(cube.shape[:2], 1100.0, np.float32)
    seeds = np.array([[1_234_102.0, 501.0, 1100.25]])
    write_tracks([Track(depth, np.ones_like(depth), seeds, "ms")], cube, directory=tmp_path)
    assert "1234102 501 1100.25" in (tmp_path / "tracks.csv").read_text()
