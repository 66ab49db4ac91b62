"""Slopes of a block, from what of the cube they depend on."""

from __future__ import annotations

from collections.abc import Callable

from seismo3d._typing import BoolArray, Float32Array
from seismo3d.seismic.blocks.cleaning import read_clean
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.dip import block_slopes, dip_reach


def estimate_block(
    run: BlockRun, box: Box, *, leave_out: Callable[[BoolArray, tuple[int, int]], BoolArray] | None = None
) -> tuple[Float32Array, BoolArray, tuple[Float32Array, Float32Array]]:
    """Return the amplitudes of a block, where they are valid, and its slopes.

    `leave_out` takes where amplitudes are valid around the block, and the first inline and crossline there, and returns
    where slopes may see them.
    """
    wide = box.grown((dip_reach(run.settings.dip),) * 2, run.plan.shape)
    volume, valid = read_clean(run, wide)
    seen = valid if leave_out is None else leave_out(valid, (wide.i0, wide.j0))
    inner = box.within(wide)
    slopes = block_slopes(volume, seen, wide.ends(run.plan.shape), run.settings.dip, inner)
    return volume[inner], valid[inner], slopes
