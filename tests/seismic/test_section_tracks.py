from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from fake_faults import make_section

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.seismic.horizon_search import find_horizons
from seismo3d.seismic.section_tracks import thicken
from seismo3d.seismic.tracks import read_seeds, trace_tracks
from seismo3d.synthetic import fault_section, make_cube, recipe_of

PLAIN: dict[str, Any] = {"population": None, "wavelength": (12.0, 12.0)}


def test_horizon_of_a_folded_line_is_followed_to_its_ends() -> None:
    line = fault_section("folded", seed=2007, shape=(16, 80, 72), **PLAIN)
    truth = line.horizons[2]
    (track,) = trace_tracks(line.seismic, [(40, truth[40])])
    assert track.depth.shape == track.confidence.shape == (80,)
    assert track.seeds.tolist() == [[40.0, float(truth[40])]]
    known = np.isfinite(truth)
    assert (np.abs(track.depth - truth)[known] <= 1.0).mean() > 0.95


def stepped() -> tuple[Any, Any]:
    """The line with one fault, its layers slowly changing so that a cycle is not mistaken for its neighbour."""
    section, faults = make_section()
    i, k = np.meshgrid(np.arange(60), np.arange(50), indexing="ij")
    time = k - 0.11 * i - np.where(i > 30 + (k - 25) * 0.5, 3.0, 0.0)
    values = np.sin(2 * np.pi * time / 9.0) + 0.8 * np.sin(2 * np.pi * time / 23.0)
    return section.copy(data=values.astype(np.float32)), faults


def test_track_crosses_a_fault_by_its_throw() -> None:
    section, faults = stepped()
    (track,) = trace_tracks(section, [(11, 40.0)], faults=faults)
    # layers fall by 0.11 samples of 2 ms a trace, and by three samples across the fault
    layer = 40.0 + 0.22 * (np.arange(60) - 10.0)
    assert np.nanmax(np.abs(track.depth - layer)[:20]) < 0.6
    assert np.isfinite(track.depth[42:]).mean() > 0.9
    assert np.nanmax(np.abs(track.depth - layer - 6.0)[42:]) < 1.5
    assert track.sample_unit == "ms"


def test_thickened_faults_are_sheets_across_the_line() -> None:
    section, faults = stepped()
    cube, sheets = thicken(section, faults)
    assert cube.dims == ("inline", "crossline", "time")
    assert sheets is not None
    (surface,) = sheets.surfaces
    corners = surface.vertices[surface.cells]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert area == pytest.approx(8 * faults.surfaces[0].area, rel=1e-5)
    assert (surface.normals[:, 0] == 0).all()
    np.testing.assert_array_equal(np.asarray(sheets.labels)[3], np.asarray(faults.labels))


def test_refusals() -> None:
    section, faults = stepped()
    for seed in ((1, 11, 40.0), [(20, 36.0), (3,)], "a"):
        with pytest.raises(ShapeError, match=r"seeds\[0\] is .*; expected a point \(trace"):
            trace_tracks(section, [seed])
    with pytest.raises(ShapeError, match="faults are of a section"):
        trace_tracks(section[:30], [(11, 40.0)], faults=faults)
    with pytest.raises(ParameterError, match=r"seeds\[1\] \(11, 4000\) lies outside the section: trace"):
        trace_tracks(section, [(11, 40.0), (11, 4000.0)])
    with pytest.raises(ParameterError, match="layers is given for a section"):
        trace_tracks(section, [(11, 40.0)], layers=object())  # type: ignore[arg-type]
    with pytest.raises(ShapeError, match=r"seeds\[0\] is \(0, 32, 34\.4\); expected a point \(trace"):
        trace_tracks(section, [(0, 32, np.float64(34.4))])


def test_lines_elsewhere_or_on_their_side_are_refused() -> None:
    section, faults = stepped()
    other = section.assign_coords({section.dims[0]: section[section.dims[0]] + 5000})
    with pytest.raises(GeometryError, match="faults are of a section with other"):
        trace_tracks(other, [(5011, 40.0)], faults=faults)
    with pytest.raises(ShapeError, match=r"Give section\.transpose\("):
        trace_tracks(section.T, count=1)


def test_best_horizons_are_found_apart_and_right() -> None:
    cube = make_cube(recipe_of("folded", shape=(24, 24, 80), **PLAIN), seed=2008)
    found = find_horizons(cube.seismic, 3)
    assert 1 <= len(found) <= 3
    for n, track in enumerate(found):
        known = np.isfinite(track.depth)
        assert known.mean() > 0.6
        i, j = np.nonzero(known)
        # one layer all over: its layer time does not change
        k = track.depth[known].astype(float)
        low = np.clip(np.floor(k).astype(int), 0, 78)
        times = cube.layer_time[i, j, low] * (1 - (k - low)) + cube.layer_time[i, j, low + 1] * (k - low)
        assert (np.abs(times - np.median(times)) < 1.0).mean() > 0.9
        assert all(np.nanmedian(np.abs(track.depth - other.depth)) > 1.0 for other in found[:n])


def test_horizons_of_a_line_need_no_seeds() -> None:
    line = fault_section("folded", seed=2007, shape=(16, 60, 64), **PLAIN)
    found = find_horizons(line.to_dataarray(), 2)
    assert 1 <= len(found) <= 2
    assert found[0].depth.shape == (60,)
    assert found[0].seeds.shape[1] == 2
    for count in (0, 2.5, "3"):
        with pytest.raises(ParameterError, match=r"count is .*; expected a"):
            find_horizons(line.seismic, count)  # type: ignore[arg-type]


def test_a_section_keeps_its_unit_and_is_spoken_of_as_it_was_given() -> None:
    section, faults = stepped()
    in_feet = section.rename(time="depth").assign_attrs(sample_unit="ft")
    of_feet = replace(
        faults, **{n: in_feet.copy(data=getattr(faults, n).data) for n in ("likelihood", "labels", "throw")}
    )
    assert trace_tracks(in_feet, [(11, 40.0)], faults=of_feet)[0].sample_unit == "ft"
    assert find_horizons(in_feet, 1)[0].sample_unit == "ft"
    assert trace_tracks(section.values, [(10, 20.0)])[0].sample_unit == "samples"
    dead = section.copy(data=np.where(np.arange(60)[:, None] == 4, 0.0, section.values))
    with pytest.raises(ParameterError, match=r"seeds\[0\] \(5, 40\) lies on a trace without data"):
        trace_tracks(dead, [(5, 40.0)])
    with pytest.raises(ParameterError, match=r"seeds\[0\] has \(11, 40\) and \(11, 60\) on one trace"):
        trace_tracks(section, [[(11, 40.0), (11, 60.0)]])
    with pytest.raises(ShapeError, match=r"section has shape \(2, 50\); expected at least \(8, 16\)"):
        trace_tracks(section[:2], [(1, 40.0)])
    for shape in ((0, 0), (0, 0, 0)):
        with pytest.raises(ShapeError, match="expected at least"):
            trace_tracks(np.zeros(shape), [(0.0,) * len(shape)])
    with pytest.raises(ShapeError, match="section has no live trace"):
        find_horizons(section * 0.0, 1)


def test_one_seed_alone_is_told_to_be_put_in_a_list() -> None:
    section, _ = stepped()
    with pytest.raises(ShapeError, match=r"^seeds\[0\] is \(11\); .* numbers\. Put one point alone in a list\.$"):
        trace_tracks(section, (11, 40.0))


def test_seeds_in_a_table_are_its_rows() -> None:
    section, _ = stepped()
    table = pd.DataFrame({"trace": [11, 30], "time": [40.0, 36.0]})
    for (own, _), row in zip(read_seeds(section, table), table.to_numpy(), strict=True):
        np.testing.assert_array_equal(own[0], row)
