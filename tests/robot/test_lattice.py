from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.robot.lattice import DIRECTIONS, lattice_motions
from seismo3d.robot.motions import SIDE, grid_motions


@pytest.mark.parametrize("radius", [0.3, 2.0, 7.5, 25.0])
def test_motions_join_cells_and_headings_without_a_kink_and_turn_no_tighter_than_asked(radius):
    motions = lattice_motions(radius)
    assert len(motions.steps) == 48
    assert len(set(DIRECTIONS)) == 16
    for step in motions.steps:
        x, y, heading, s = step.points.T
        np.testing.assert_allclose([x[0], y[0]], 0.0, atol=1e-12)
        np.testing.assert_allclose([x[-1], y[-1]], [step.columns, step.rows], atol=1e-9)
        for at, number in ((heading[0], step.start), (heading[-1], step.end)):
            assert np.cos(at - motions.headings[number]) == pytest.approx(1.0, abs=1e-12)
        assert np.abs(step.curvature).max() <= 1.0 / radius + 1e-9
        np.testing.assert_allclose(np.diff(heading), step.curvature * np.diff(s), atol=1e-12)
        chord = np.hypot(np.diff(x), np.diff(y))
        turn = np.diff(heading)
        np.testing.assert_allclose(chord, np.diff(s) * np.sinc(turn / (2 * np.pi)), atol=1e-9)
        along = np.arctan2(np.diff(y), np.diff(x)) - (heading[:-1] + 0.5 * turn)
        np.testing.assert_allclose(np.cos(along), 1.0, atol=1e-9)  # forwards, along the tangent


@pytest.mark.parametrize("motions", [grid_motions(), lattice_motions(3.0)])
def test_swept_cells_hold_the_whole_way_and_weigh_its_length(motions):
    for step in motions.steps:
        cells = {(r, c) for r, c, _ in step.swept}
        for fraction in np.linspace(0.0, 1.0, 97):
            s = fraction * step.points[-1, 3]
            x, y = (np.interp(s, step.points[:, 3], step.points[:, n]) for n in (0, 1))
            near = {
                (int(np.floor(y + 0.5 + e)), int(np.floor(x + 0.5 + f))) for e in (-0.05, 0.05) for f in (-0.05, 0.05)
            }
            assert near & cells  # chords of half a cell leave the arcs by less than 0.05
        weight = sum(w for _, _, w in step.swept)
        length = step.points[-1, 3]
        price = 1.0 if step.start == step.end else 1.1
        assert price * SIDE * length - 0.1 <= weight <= price * SIDE * length + len(cells)


@pytest.mark.parametrize("motions", [grid_motions(), lattice_motions(0.3), lattice_motions(8.0)])
def test_bound_never_exceeds_a_way_and_obeys_the_triangle(motions, rng):
    from seismo3d.robot._kernels_search import least_cost

    for step in motions.steps:
        assert least_cost(step.rows, step.columns, motions.table) <= 128 * sum(w for _, _, w in step.swept)
    for _ in range(300):
        a, b = rng.integers(-60, 60, (2, 2))
        one, two, both = (least_cost(*v, motions.table) for v in (a, b, a + b))
        assert both <= one + two
    assert least_cost(30, 40, motions.table) > 0.97 * 128 * SIDE * 50


def test_too_wide_a_turn_is_refused():
    with pytest.raises(ParameterError, match="the least turning radius is 300 cells"):
        lattice_motions(300.0)
    with pytest.raises(ParameterError, match="radius is 0"):
        lattice_motions(0.0)
