from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.seismic.blocks.plan import BlockPlan, Box, Tiling, parse_memory, plan_blocks
from seismo3d.seismic.faults import FaultSettings


def test_boxes_cover_every_trace_once():
    tiling = Tiling((70, 50), (32, 16))
    covered = np.zeros((70, 50), int)
    for number, box in enumerate(tiling):
        covered[box.i0 : box.i1, box.j0 : box.j1] += 1
        assert tiling.holding(box.i0, box.j0) == number == tiling.holding(box.i1 - 1, box.j1 - 1)
    assert (covered == 1).all()


def test_grown_box_ends_with_the_cube():
    box = Box(0, 16, 32, 48).grown((5, 9), (70, 50))
    assert box == Box(0, 21, 23, 50)
    assert box.ends((70, 50)) == ((True, False), (False, True))
    assert Box(0, 16, 32, 48).within(box) == (slice(0, 16), slice(9, 25))


@pytest.mark.parametrize("memory", ["2GB", "4GB", "16GB"])
def test_blocks_grow_with_the_memory_and_are_whole_bricks(memory):
    plan = plan_blocks((1700, 1700, 1700), parse_memory(memory), FaultSettings())
    assert all(edge[0] % plan.brick == 0 and edge[1] % plan.brick == 0 for edge in plan.edges.values())
    more = plan_blocks((1700, 1700, 1700), 2 * parse_memory(memory), FaultSettings())
    assert all(more.edges[stage][0] >= plan.edges[stage][0] for stage in ("dip", "misfit", "scan"))
    assert BlockPlan.from_dict(plan.to_dict()) == plan


def test_a_cube_that_fits_is_one_block():
    plan = plan_blocks((64, 64, 64), parse_memory("8GB"), FaultSettings())
    assert {stage: len(plan.tiling(stage)) for stage in plan.edges} == {
        "dip": 1, "misfit": 1, "register": 1, "carry": 1, "moments": 1, "evidence": 1, "scan": 1,
        "draw": 1, "raw": 2,
    }  # fmt: skip


def test_too_little_memory_is_refused_with_what_is_needed():
    with pytest.raises(ParameterError, match=r"memory is 0\.50 GB; traces of 3000 samples need at least 0\.8\d GB"):
        plan_blocks((500, 500, 3000), 5 * 10**8, FaultSettings())


@pytest.mark.parametrize("text", ["2 apples", "-1GB", "", "GB"])
def test_memory_that_is_no_size_is_refused(text):
    with pytest.raises(ParameterError, match="expected a size such as 2GB"):
        parse_memory(text)
