"""Medians of the whole cube in two passes over its blocks: one that finds where they lie roughly, one exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array
from seismo3d.seismic.blocks.order import count_high, count_low, median, middle_high
from seismo3d.seismic.blocks.plan import Box
from seismo3d.seismic.blocks.run import BlockRun

Values = Sequence[Iterable[Float32Array]]
"""For each median, the arrays whose values it is of."""


@dataclass(frozen=True, slots=True)
class BlockMedians:
    """One or several medians, and the two stages that count their values.

    Attributes
    ----------
    first, second : str
        The stages. A block of the first one leaves :meth:`count` among what it comes to, and its fact is
        :meth:`locate`; a block of the second one is :meth:`count_near`, and its fact has :meth:`find`.
    tiling : str
        Blocks of both.
    read : callable
        Gives the values of a box, from what is stored when the second stage runs.
    """

    first: str
    second: str
    tiling: str
    read: Callable[[BlockRun, Box], Values]

    def count(self, values: Values) -> dict[str, AnyArray]:
        """Count a block's values roughly, for its record."""
        return {"counts": np.stack([count_high(one) for one in values])}

    def locate(self, run: BlockRun) -> dict[str, Any]:
        """Find where the medians lie roughly, for the first stage's fact."""
        counts = run.add_up(self.first, "counts", self.tiling)
        return {"counts": counts} | {f"high{n}": middle_high(part) for n, part in enumerate(counts)}

    def count_near(self, run: BlockRun, number: int) -> None:
        """Count a block's values near the medians: all that the second stage does."""
        values, facts = self.read(run, run.plan.tiling(self.tiling).box(number)), run.fact(self.first)
        low = {f"low{n}": count_low(one, facts[f"high{n}"]) for n, one in enumerate(values)}
        run.write_part(self.second, number, low)

    def find(self, run: BlockRun) -> list[float]:
        """Return the medians, when both stages have worked on all blocks; 0 of no values."""
        counts = run.fact(self.first)["counts"]
        return [median(part, run.add_up(self.second, f"low{n}", self.tiling)) for n, part in enumerate(counts)]
