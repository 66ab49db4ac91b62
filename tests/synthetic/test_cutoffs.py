from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ShapeError
from seismo3d.synthetic import (
    SyntheticFault,
    exact_displacement,
    fault_cube,
    fault_section,
    places_before,
    present_slip,
    sample_faults,
)
from seismo3d.synthetic import _kernels as kernels
from seismo3d.synthetic._kernels_cutoffs import move_on_side, undo_on_side
from seismo3d.synthetic.faulting import FaultPopulation, fault_rows

SHAPE = (32, 32, 48)
POPULATION = FaultPopulation(count=(12, 12), listric=0.3, oblique=0.5, reverse=0.3, curved=0.6, throw=(3.0, 12.0))


def one_fault(*faults, **overrides):
    return fault_cube("clean", seed=2, shape=SHAPE, population=None, faults=faults, **overrides)


def test_sides_agree_with_the_way_cubes_are_made(rng):
    for row in fault_rows(sample_faults(rng, SHAPE, POPULATION)):
        for place in rng.uniform(0, SHAPE, (40, 3)):
            undone = kernels.undo_fault(*place, row)
            np.testing.assert_allclose(undo_on_side(place, row, undone[3] > 0), undone[:3], atol=1e-9)


@pytest.mark.parametrize("hanging", [True, False])
def test_moving_is_the_inverse_of_undoing(rng, hanging):
    for row in fault_rows(sample_faults(rng, SHAPE, POPULATION)):
        for place in rng.uniform(0, SHAPE, (20, 3)):
            np.testing.assert_allclose(undo_on_side(move_on_side(place, row, hanging), row, hanging), place, atol=1e-3)


@pytest.mark.parametrize("rake_deg", [90.0, 70.0])
def test_uniform_throw_is_the_same_then_and_now(rake_deg):
    cube = one_fault(SyntheticFault((16, 16, 24), 30.0, 65.0, 8.0, rake_deg=rake_deg))
    present = present_slip(cube)
    on = cube.faults > 0
    assert np.isnan(present[~on]).all()
    np.testing.assert_allclose(present[on], cube.slip, atol=1e-3)


def test_still_footwall_leaves_the_throw_as_it_was():
    """Only the hanging wall moved, so its grain has come down by the throw where it now lies."""
    cube = one_fault(SyntheticFault((16, 16, 24), 30.0, 65.0, 8.0, "gaussian", (20, 20), share=1.0))
    on = cube.faults > 0
    np.testing.assert_allclose(present_slip(cube)[on, 2], cube.throw[on], atol=1e-2)


def test_where_both_walls_moved_counterparts_moved_by_half_the_throw_each():
    fault = SyntheticFault((16, 16, 24), 0.0, 65.0, 8.0, "gaussian", (1e6, 20), share=0.5)
    cube = one_fault(fault)
    on = np.argwhere(cube.faults > 0)
    now = present_slip(cube)[tuple(on.T)][:, 2]
    here, there = (8.0 * np.exp(-0.5 * ((z - 24.0) / 20.0) ** 2) for z in (on[:, 2], on[:, 2] - now))
    np.testing.assert_allclose(now, 0.5 * (here + there), atol=1e-2)


def test_a_later_fault_parts_what_an_earlier_one_had_brought_together():
    first = SyntheticFault((16, 16, 24), 0.0, 70.0, 6.0)
    later = SyntheticFault((16, 16, 24), 90.0, 80.0, 10.0)
    alone, both = one_fault(first), one_fault(first, later)
    throws = present_slip(both)[both.faults == 1, 2]
    np.testing.assert_allclose(present_slip(alone)[alone.faults == 1, 2], 6.0, atol=1e-3)
    assert np.median(throws) == pytest.approx(6.0, abs=1e-3)
    # near the later fault one of the two lies beyond it and has come down with it
    assert set(np.unique(np.round(throws - 6.0, 3))) <= {-10.0, 0.0, 10.0}
    assert (np.abs(throws - 6.0) > 1).any()


def test_faults_below_an_unconformity_are_left_out():
    buried = SyntheticFault((16, 16, 24), 30.0, 65.0, 8.0, buried=True)
    cube = one_fault(buried, unconformity=(0.3, 0.31))
    assert (cube.faults > 0).any()
    assert np.isnan(present_slip(cube)).all()


def test_section_is_refused():
    with pytest.raises(ShapeError, match="three axes"):
        present_slip(fault_section("clean", shape=SHAPE))


def test_displacement_leads_to_where_grains_lie_today():
    cube = one_fault(*sample_faults(np.random.default_rng(4), SHAPE, POPULATION)[:4])
    moves = exact_displacement(cube)
    known = np.isfinite(moves).all(axis=0)
    assert known.mean() > 0.99
    before = np.argwhere(known).astype(np.float64)
    today = before + moves[:, known].T
    assert np.abs(today - before).max() > 3.0
    np.testing.assert_allclose(places_before(cube, today), before, atol=1e-2)


def test_uniform_throw_moves_the_hanging_wall_alone():
    cube = one_fault(SyntheticFault((16, 16, 24), 0.0, 85.0, 5.0, share=1.0))
    down = exact_displacement(cube)[2]
    assert set(np.round(np.unique(down), 3)) == {0.0, 5.0}


def test_displacement_is_told_of_cubes_alone():
    section = fault_section("clean", shape=SHAPE)
    with pytest.raises(ShapeError, match="expected three axes"):
        exact_displacement(section)
    with pytest.raises(ShapeError, match="expected three axes"):
        places_before(section, np.zeros((1, 3)))
