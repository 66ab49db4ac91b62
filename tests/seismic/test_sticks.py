from __future__ import annotations

import numpy as np
from fake_faults import make_cube, make_faults, make_section

from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.sticks import cut_sticks, stick_axis


def test_planes_cross_the_strike() -> None:
    faults = make_faults(make_cube())
    # the first fault strikes along the inline axis and is crossed by inlines, the second the other way round
    assert [stick_axis(surface) for surface in faults.surfaces] == [0, 1]


def test_sticks_lie_on_their_fault_and_run_down() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    sticks = cut_sticks(faults, cube)
    first = [stick for stick in sticks if stick.fault == "fault_001"]
    assert [stick.number for stick in first] == [1, 2, 3, 4, 5]  # indices 5, 10, ... 25 of 2 to 27
    survey = SurveyGeometry.from_cube(cube)
    for stick in sticks:
        assert np.all(np.diff(stick.points[:, 2]) > 0)
        index = survey.map_to_index(stick.points)
        np.testing.assert_allclose(
            index, survey.lines_to_index(np.column_stack([stick.lines, stick.points[:, 2]])), atol=1e-5
        )
        if stick.fault == "fault_001":
            np.testing.assert_allclose(index[:, 1], 20 + (index[:, 2] - 24.5) * 0.5, atol=1e-3)
            assert np.ptp(index[:, 0]) < 1e-6
            assert round(float(index[0, 0])) % 5 == 0
        else:
            assert np.ptp(index[:, 1]) < 1e-6
        assert len(stick.points) == 2  # a straight line needs its ends only


def test_spacing_and_narrow_faults() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    every = [s for s in cut_sticks(faults, cube, spacing=1) if s.fault == "fault_001"]
    assert len(every) == 25  # 3 to 27: the plane through the first row of points only touches it
    wide = [s for s in cut_sticks(faults, cube, spacing=100) if s.fault == "fault_001"]
    assert len(wide) == 3  # 25 inlines wide: every 8th, at 8, 16, 24


def test_section_fault_is_one_stick() -> None:
    section, faults = make_section()
    (stick,) = cut_sticks(faults, section)
    np.testing.assert_allclose(stick.points[0], [1200.0, 2000.0, 10.0], atol=1e-3)
    np.testing.assert_allclose(stick.points[-1], [1395.0, 2000.0, 88.0], atol=1e-3)
    np.testing.assert_allclose(stick.lines, [[0.0, 21.0], [0.0, 40.5]], atol=1e-4)


def test_section_sticks_have_the_numbers_of_their_lines() -> None:
    section, faults = make_section()
    cdp = section.assign_coords(cdp=("trace", 1001 + 2 * np.arange(60)))
    np.testing.assert_allclose(cut_sticks(faults, cdp)[0].lines, [[0.0, 1041.0], [0.0, 1080.0]], atol=1e-3)
    # a random line through a cube, and one of its inlines
    crossing = cdp.assign_coords(inline=("trace", 300 - np.arange(60)), crossline=("trace", 7 + np.arange(60)))
    np.testing.assert_allclose(cut_sticks(faults, crossing)[0].lines, [[280.0, 27.0], [260.5, 46.5]], atol=1e-3)
    inline = section.assign_coords(inline=12)
    np.testing.assert_allclose(cut_sticks(faults, inline)[0].lines, [[12.0, 21.0], [12.0, 40.5]], atol=1e-4)


def test_bare_array_gives_indices() -> None:
    cube = make_cube().values
    stick = cut_sticks(make_faults(cube), cube)[0]
    np.testing.assert_allclose(stick.points[0], [5.0, 20 + (5 - 24.5) * 0.5, 5.0], atol=1e-3)
