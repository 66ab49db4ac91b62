"""Settings of the fused loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from seismo3d._settings import Amount, Count, Share, StepsOrNone

MOST_THREADS = 256


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Settings of the fused loop; the defaults are right.

    Attributes
    ----------
    max_iterations : int in [1, 1000000]
        Most passes a level.
    tolerance : float in [0, inf)
        The finest level ends where a step moves no parameter by more than this share of a voxel, in radians and in
        shares of the scan's size; coarser levels end at five times that.
    max_elements : int in [1, 1000000]
        Most source elements that a pass looks at, drawn evenly.
    observability : float in [0, 1]
        Directions whose curvature is below this share of the largest are left as they are.
    symmetric : bool
        Measure along the mean of both surfaces' normals.
    acceleration : int in [0, 100]
        Steps that are remembered to extrapolate from; 0 for none.
    alpha : float or None in [0, 1]
        Fixed share of the features as in Eq. (16), or None to weigh by measured variance.
    n_threads : int in [1, 256]
        Threads to match on; the result does not depend on them.
    wide_search : bool
        Search the coarsest level without a limit of distance first.
    """

    max_iterations: Count = 30
    tolerance: Amount = 0.004
    max_elements: Count = 5000
    observability: Share = 1e-6
    symmetric: bool = False
    acceleration: StepsOrNone = 4
    alpha: Share | None = None
    n_threads: Annotated[int, f"[1, {MOST_THREADS}]"] = 1
    wide_search: bool = True
