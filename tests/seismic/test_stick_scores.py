from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube, make_faults, make_section

from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.io.fault_sticks import FaultStick
from seismo3d.seismic.picks import place_stick
from seismo3d.seismic.stick_scores import _dense_in, score_sticks
from seismo3d.seismic.sticks import cut_sticks


def moved(stick: FaultStick, by: tuple[float, float, float]) -> FaultStick:
    return replace(stick, points=stick.points + np.array(by))


def test_own_sticks_agree_and_nothing_is_missed_or_new() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    score = score_sticks(faults, cut_sticks(faults, cube))
    assert score.within == 1.0
    assert score.p90 < 0.3
    assert [row.traced_as for row in score.faults] == [1, 2]
    assert (score.missed, score.new, score.outside) == ((), (), 0.0)
    assert score.confirmed > 0.9


def test_far_sticks_are_missed_and_faults_without_sticks_are_new() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    own = [stick for stick in cut_sticks(faults, cube) if stick.fault == "fault_001"]
    # a picked fault 12 crosslines of 12.5 m beside the first, along the turned crossline axis
    along = np.array([np.cos(np.radians(30.0)), -np.sin(np.radians(30.0))]) * 12.5
    ghost = [replace(moved(stick, (*(12.0 * along), 0.0)), fault="ghost") for stick in own]
    score = score_sticks(faults, own + ghost)
    assert score.missed == ("ghost",)
    assert score.new == (2,)
    by_name = {row.name: row for row in score.faults}
    assert by_name["fault_001"].traced_as == 1
    # across the plane: 12 crosslines times its normal's share
    alone = score_sticks(replace(faults, surfaces=faults.surfaces[:1]), ghost)
    assert alone.median == pytest.approx(12.0 * np.sin(np.radians(63.43)), abs=0.3)
    near = [moved(stick, (*(2.0 * along), 0.0)) for stick in own]
    shifted = score_sticks(faults, near)
    assert shifted.median == pytest.approx(2.0 * np.sin(np.radians(63.43)), abs=0.15)
    assert score_sticks(faults, near, tolerance=1.0).missed == ("fault_001",)


def test_picked_faults_outside_the_cube_are_named() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    own = cut_sticks(faults, cube)
    below = [replace(moved(stick, (0.0, 0.0, 1000.0)), fault="below") for stick in own if stick.fault == "fault_001"]
    score = score_sticks(faults, own + below)
    assert score.elsewhere == ("below",)
    assert [row.name for row in score.faults] == ["fault_001", "fault_002"]
    assert score.missed == ()
    assert score_sticks(faults, own).elsewhere == ()


def test_two_sticks_far_apart_still_confirm_the_surface_between() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    own = [stick for stick in cut_sticks(faults, cube) if stick.fault == "fault_001"]
    ends = sorted(own, key=lambda stick: float(place_stick(stick, cube)[0, 0]))
    assert 1 not in score_sticks(faults, [ends[-1], ends[0]]).new
    assert 1 in score_sticks(faults, [ends[0]]).new


def test_no_traced_fault_at_all() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    score = score_sticks(replace(faults, surfaces=()), cut_sticks(faults, cube))
    assert score.within == 0.0
    assert np.isnan(score.median)
    assert score.missed == ("fault_001", "fault_002")


@pytest.mark.parametrize("far", [1e7, 1e9, 1e30])
def test_wild_nodes_count_only_where_their_stick_is_in_the_cube(far: float) -> None:
    cube = make_cube()
    faults = make_faults(cube)
    own = cut_sticks(faults, cube)
    wild = [replace(own[0], points=np.vstack([own[0].points, [*own[0].points[-1, :2], far]])), *own[1:]]
    score, known = score_sticks(faults, wild), score_sticks(faults, own)
    # the stick goes on straight down to the floor of the cube, beside its dipping fault
    assert known.within == 1.0
    assert 0.5 < score.within <= 1.0
    assert score.outside == pytest.approx(1.0 / sum(len(stick.points) for stick in wild))
    apart = [moved(own[0], (far, 0.0, 0.0)), *own]
    assert score_sticks(faults, apart).median == pytest.approx(known.median, abs=1e-6)


def test_segments_are_clipped_to_the_cube() -> None:
    shape = np.array([10, 10, 10])
    through = _dense_in(np.array([[4.0, 4.0, -1e6], [4.0, 4.0, 1e6]]), shape)
    assert through[:, 2].min() == pytest.approx(-0.5, abs=1.0)
    assert through[:, 2].max() == pytest.approx(9.5, abs=1.0)
    assert np.diff(through[:, 2]).max() <= 1.0 + 1e-6
    assert len(_dense_in(np.array([[20.0, 4.0, 0.0], [20.0, 4.0, 9.0]]), shape)) == 0
    assert len(_dense_in(np.array([[-5.0, 12.0, 5.0], [5.0, 22.0, 5.0]]), shape)) == 0
    # nodes closer than voxels weigh no more than their length
    fine = np.column_stack([np.ones(41), np.ones(41), np.linspace(1.0, 5.0, 41)])
    np.testing.assert_allclose(_dense_in(fine, shape)[:, 2], [1.0, 2.0, 3.0, 4.0, 5.0])
    np.testing.assert_allclose(
        _dense_in(np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 4.0]]), shape)[:, 2], [1.0, 2.0, 3.0, 4.0], atol=1e-12
    )


def test_sticks_elsewhere_are_refused() -> None:
    cube = make_cube()
    faults = make_faults(cube)
    far = [moved(stick, (1e6, 0.0, 0.0)) for stick in cut_sticks(faults, cube)]
    with pytest.raises(GeometryError, match="no stick lies in the cube"):
        score_sticks(faults, far)
    with pytest.raises(ShapeError, match="section"):
        score_sticks(make_section()[1], far)


def test_what_is_no_list_of_picks_is_refused() -> None:
    faults = make_faults(make_cube())
    own = cut_sticks(faults, make_cube())
    loose: Any
    for loose, told in (("x", "a str"), (own[0], "a FaultStick"), ([*own, None], "a list with a NoneType")):
        with pytest.raises(ParameterError, match=f"sticks is {told}; expected a list of FaultStick"):
            score_sticks(faults, loose)
