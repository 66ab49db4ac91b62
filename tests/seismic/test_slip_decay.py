"""How slip dies away off a fault, from the tilt of the layers beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.seismic.fault_ages import HistorySettings
from seismo3d.seismic.fault_motion import FaultMotion, Frame
from seismo3d.seismic.faults import FaultSettings
from seismo3d.seismic.scores import throw_score
from seismo3d.seismic.slip_decay import find_decay
from seismo3d.seismic.throw import SheetSides, SheetThrow
from seismo3d.synthetic import fault_cube

HISTORY = HistorySettings()
STEP, SHAPE = 2, (30, 81)


def beside(
    rng: np.random.Generator, decay: float, *, side: int = 1, share: float = 1.0, scatter: float = 0.02
) -> tuple[SheetThrow, SheetSides, int]:
    """A fault whose throw grows along strike, with layers that dip everywhere and tilt by its slip."""
    columns = (SHAPE[1] - 1) // STEP + 1
    throw = np.broadcast_to(np.linspace(4.0, 16.0, SHAPE[0])[:, None], (SHAPE[0], columns)).astype(np.float32)
    tilts = 0.3 + scatter * rng.standard_normal((2, *SHAPE))
    moved = decay * throw[:, :1]
    hanging, foot = (1, 0) if side > 0 else (0, 1)
    # layers of the hanging wall rise away from the fault, those of the footwall fall away
    tilts[hanging] -= side * share * moved
    tilts[foot] -= side * (1.0 - share) * moved
    sides = SheetSides(np.zeros((2, *SHAPE), np.float32), np.ones((2, *SHAPE), np.float32), tilts.astype(np.float32))
    return SheetThrow(throw, np.ones(throw.shape, np.float32), side), sides, STEP


@pytest.mark.parametrize("side", [1, -1])
def test_the_share_that_is_lost_a_trace(rng: np.random.Generator, side: int) -> None:
    assert find_decay([beside(rng, 0.02, side=side)], HISTORY) == pytest.approx(0.02, rel=0.05)


def test_level_layers_and_what_says_nothing(rng: np.random.Generator) -> None:
    assert find_decay([beside(rng, 0.0)], HISTORY) == 0.0
    assert find_decay([beside(rng, 0.02, share=0.5)], HISTORY) == 0.0
    # layers that rise towards the fault are no slip that dies away
    assert find_decay([beside(rng, -0.02)], HISTORY) == 0.0
    assert find_decay([beside(rng, 0.2)], HISTORY) == HISTORY.most_decay
    throw, sides, step = beside(rng, 0.02)
    assert find_decay([(replace(throw, fit=0.0 * throw.fit), sides, step)], HISTORY) == 0.0
    assert find_decay([(throw, sides._replace(known=0.0 * sides.known), step)], HISTORY) == 0.0


def test_wrong_throws_and_tilts_count_for_little(rng: np.random.Generator) -> None:
    throw, sides, step = beside(rng, 0.02)
    throw.throw.setflags(write=True)
    tilts = sides.tilts.copy()
    tilts[:, ::5] = 2.0 * rng.standard_normal(tilts[:, ::5].shape)
    assert find_decay([(throw, sides._replace(tilts=tilts), step)], HISTORY) == pytest.approx(0.02, rel=0.2)


def test_parts_tell_together(rng: np.random.Generator) -> None:
    parts = [beside(rng, 0.01), beside(rng, 0.03)]
    assert 0.012 < find_decay(parts, HISTORY) < 0.028


def test_what_lies_farther_off_is_moved_back_less() -> None:
    level = np.zeros((20, 20))
    frame = Frame(np.zeros(2), np.array([0.0, 1.0]))
    motion = FaultMotion(frame, (-19.0, 0.0), level, level, level + 8.0, (0.0, 0.0), 1, 0.0, decay=0.02)
    points = np.array([[5.0, off, 15.0] for off in (0.001, 10.0, 50.0, 100.0, 200.0, -10.0)])
    back = motion.undo(points)
    np.testing.assert_allclose(points[:, 2] - back[:, 2], [8.0, 8.0 * 0.81, 8.0 * 0.25, 0.0, 0.0, 0.0], atol=1e-3)


def test_older_faults_are_measured_better_where_the_slip_of_younger_ones_dies_away() -> None:
    cube = fault_cube("folded", shape=(128, 128, 128), seed=203)  # three of five faults have a drag
    within = []
    for history in (HISTORY, replace(HISTORY, least_decay=1.0)):
        faults = s3.trace_faults(cube.seismic, settings=replace(FaultSettings(), history=history))
        within.append(throw_score(faults.labels, faults.throw, cube.faults, cube.throw).within)
    assert within[0] > within[1] + 0.1
