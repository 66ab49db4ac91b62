"""Settings of the fused loop."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Settings of the fused loop; the defaults are right.

    Attributes
    ----------
    max_iterations : int
        Most passes a level.
    tolerance : float
        The finest level ends where a step moves no parameter by more than this share of a voxel, in radians and in
        shares of the scan's size; coarser levels end at five times that.
    max_elements : int
        Most source elements that a pass looks at, drawn evenly.
    observability : float
        Directions whose curvature is below this share of the largest are left as they are.
    symmetric : bool
        Measure along the mean of both surfaces' normals.
    acceleration : int
        Steps that are remembered to extrapolate from; 0 for none.
    alpha : float or None
        Fixed share of the features as in Eq. (16), or None to weigh by measured variance.
    n_threads : int
        Threads to match on; the result does not depend on them.
    wide_search : bool
        Search the coarsest level without a limit of distance first.
    """

    max_iterations: int = 30
    tolerance: float = 0.004
    max_elements: int = 5000
    observability: float = 1e-6
    symmetric: bool = False
    acceleration: int = 4
    alpha: float | None = None
    n_threads: int = 1
    wide_search: bool = True
