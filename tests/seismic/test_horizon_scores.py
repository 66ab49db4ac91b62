from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_faults import make_cube

from seismo3d.errors import GeometryError, ParameterError
from seismo3d.io.horizons import HorizonPoints
from seismo3d.seismic.horizon_scores import same_trace_distance, sample_extent, score_horizon
from seismo3d.seismic.picks import grid_horizon, horizon_seeds


def flat(z: float, *, name: str = "top", n: int = 10) -> HorizonPoints:
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    points = np.column_stack([25.0 * i.ravel(), 25.0 * j.ravel(), np.full(n * n, z)])
    return HorizonPoints(name, points, np.full((n * n, 2), np.nan))


def test_what_is_no_list_of_tracks_is_refused() -> None:
    loose: Any = flat(800.0)
    with pytest.raises(ParameterError, match="tracks is a HorizonPoints; expected a list of HorizonPoints"):
        score_horizon(loose, loose, tolerance=1.0)


def test_horizon_is_scored_against_the_nearest_track() -> None:
    picks = flat(800.0)
    near = flat(803.0, name="track_02")
    part = HorizonPoints("track_02", near.points[:60], near.lines[:60])
    score = score_horizon([flat(900.0, name="track_01"), part], picks, tolerance=2.0)
    assert (score.track, score.n_picks, score.n_common, score.new) == ("track_02", 100, 60, 0)
    assert (score.median, score.p90, score.bias, score.within) == (3.0, 3.0, 3.0, 0.0)
    assert score.missed == pytest.approx(0.4)
    assert score_horizon([part], picks, tolerance=3.0).within == 1.0
    fewer = HorizonPoints("top", picks.points[:20], picks.lines[:20])
    assert score_horizon([near], fewer, tolerance=3.0).new == 80


def test_horizons_of_two_files_meet_by_line_numbers() -> None:
    lines = np.argwhere(np.ones((10, 10))).astype(float)
    picks = replace(flat(800.0), lines=lines, points=flat(800.0).points + np.array([0.4e6, 0, 0]))
    track = replace(flat(798.0), lines=lines)
    assert score_horizon([track], picks, tolerance=4.0).bias == -2.0
    with pytest.raises(GeometryError, match="no pick of top"):
        score_horizon([flat(798.0)], picks, tolerance=4.0)
    with pytest.raises(ParameterError, match="tracks is empty"):
        score_horizon([], picks, tolerance=4.0)


def test_horizon_on_the_traces_of_a_cube_and_as_seeds() -> None:
    cube = make_cube()
    i, j = np.nonzero(np.ones(cube.shape[:2], bool))
    x, y = (cube[name].values[i, j] for name in ("cdp_x", "cdp_y"))
    z = 1040.0 + 0.5 * i
    picks = HorizonPoints("top", np.column_stack([x, y, z]), np.full((len(i), 2), np.nan))
    grid = grid_horizon(picks, cube)
    np.testing.assert_allclose(grid, 1040.0 + 0.5 * np.arange(30)[:, None] + np.zeros(40))
    by_lines = replace(picks, lines=np.column_stack([100.0 + 2.0 * i, 500.0 + j]), points=picks.points * [0, 0, 1.0])
    np.testing.assert_allclose(grid_horizon(by_lines, cube), grid)
    seeds = horizon_seeds(picks, cube, count=9)
    assert seeds.shape == (9, 3)
    np.testing.assert_allclose(seeds[:, 2], 1040.0 + 0.25 * (seeds[:, 0] - 100.0))
    assert np.abs(seeds[0, :2] - [129.0, 519.5]).max() <= 1.0
    # spread: the four corners are among them, dead traces are not
    corners = {(100.0, 500.0), (158.0, 500.0), (100.0, 539.0), (158.0, 539.0)}
    assert corners <= {tuple(seed[:2]) for seed in seeds}
    everywhere = horizon_seeds(picks, cube, count=5000)
    assert len(everywhere) == 30 * 40 - 4
    with pytest.raises(GeometryError, match="no point of top"):
        grid_horizon(replace(picks, points=picks.points + np.array([0, 0, 1e5])), cube)


def test_line_numbers_side_by_side_are_two_traces() -> None:
    lines = np.argwhere(np.ones((10, 10))).astype(float)
    even, odd = lines[:, 1] % 2 == 0, lines[:, 1] % 2 == 1
    track, picks = (
        HorizonPoints(name, flat(800.0).points[chosen], lines[chosen]) for name, chosen in (("a", even), ("top", odd))
    )
    with pytest.raises(GeometryError, match="no pick of top"):
        score_horizon([track], picks, tolerance=4.0)
    every = replace(flat(800.0), lines=lines)
    assert score_horizon([track], every, tolerance=4.0).missed == pytest.approx(0.5)


def test_picks_over_holes_score_alike_by_line_numbers_and_by_places_that_are_line_numbers() -> None:
    lines = np.argwhere(np.ones((10, 10))).astype(float)
    traced = (lines % 3 != 1).all(axis=1)
    points = np.column_stack([lines, 800.0 + 5.0 * lines[:, 0]])
    picks = HorizonPoints("top", points, lines)
    track = HorizonPoints("track_01", points[traced] + [0.0, 0.0, 1.0], lines[traced])
    by_lines = score_horizon([track], picks, tolerance=4.0)
    by_places = score_horizon([track], replace(picks, lines=np.full_like(lines, np.nan)), tolerance=4.0)
    assert by_lines == by_places
    assert (by_lines.n_common, by_lines.p90) == (int(traced.sum()), 1.0)
    assert same_trace_distance([track]) == 0.5
    assert same_trace_distance([flat(800.0)]) == 1.0


@pytest.mark.parametrize(("scale", "shift"), [(1e-3, 0.0), (-1.0, 0.0), (1.0, 5000.0)])
def test_picks_in_another_unit_or_sign_are_refused(scale: float, shift: float) -> None:
    picks = flat(800.0)
    other = replace(picks, points=picks.points * [1.0, 1.0, scale] + [0.0, 0.0, shift])
    assert score_horizon([flat(803.0)], picks, tolerance=4.0, extent=(598.0, 1402.0)).median == 3.0
    with pytest.raises(GeometryError, match="between 598 and 1402, where the cube lies; expected its own unit"):
        score_horizon([flat(803.0)], other, tolerance=4.0, extent=(598.0, 1402.0))
    # one pick inside is enough, as for seeds
    mixed = replace(other, points=np.vstack([other.points[:-1], picks.points[-1:]]))
    assert score_horizon([flat(803.0)], mixed, tolerance=4.0, extent=(598.0, 1402.0)).n_common == 100


def test_extent_reaches_half_a_sample_beyond_the_ends() -> None:
    cube = make_cube()
    z = cube[cube.dims[2]].values
    half = 0.5 * (z[1] - z[0])
    assert sample_extent(cube) == (z[0] - half, z[-1] + half)
    assert sample_extent(np.zeros((4, 9))) == (-0.5, 8.5)
