"""Bounds on single degrees of freedom of a transform."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d._validate import as_number, as_numbers, is_among, told
from seismo3d.errors import ParameterError
from seismo3d.registration.result import MODELS

Bound = float | tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class Constraints:
    """Fix or bound any degree of freedom, relative to the start (the identity where none is given).

    Each entry is None (free), one number (at most so far from the start, either way; 0 fixes it), or a pair (low,
    high).

    Attributes
    ----------
    rotation : tuple of length 3 (in space) or 1 (in the plane), or None
        Components of the rotation vector about the target's axes, in radians, up to pi either way.
    translation : tuple of length d, or None
        Displacement of the source's centre along the target's axes, in the input's units.
    scale : tuple (low, high), or None
        Factors of scale, for the models ``similarity`` and ``scaled``. None leaves the scale of given pairs free;
        scans may shrink or grow to ten times what the start, or the ratio of their extents, says.

    Examples
    --------
    Only turn about the vertical axis, and never leave the plane:

    >>> level = Constraints(rotation=(0, 0, None), translation=(None, None, 0))
    """

    rotation: tuple[Bound, ...] | None = None
    translation: tuple[Bound, ...] | None = None
    scale: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("rotation", "translation"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _as_bounds(getattr(self, name), name))
        ends = [end for bound in self.rotation or () for end in (bound if isinstance(bound, tuple) else (bound,))]
        turns = [abs(end) for end in ends if end is not None and math.pi < abs(end) < math.inf]
        if turns:
            raise ParameterError(
                f"rotation goes up to {max(turns):g}; expected radians, up to pi either way. Convert degrees by "
                "numpy.radians, or give None where it is free."
            )
        if self.scale is not None:
            object.__setattr__(self, "scale", as_numbers(self.scale, "scale", n=2))

    def limits(
        self, model: str, dim: int, size: float, *, usual_scale: tuple[float, float] | None = None
    ) -> tuple[Float64Array, Float64Array]:
        """Return the lowest and highest parameters, translation in units of ``size``; scale as logarithms.

        ``usual_scale`` bounds the scale where no bounds are given; None leaves it free then.
        """
        if model == "affine":
            if self != Constraints():
                raise ParameterError(
                    "constraints are given with model 'affine'; expected a model with rotation and scale."
                )
            n = dim * dim + dim
            return np.full(n, -math.inf), np.full(n, math.inf)
        n_rotation = 0 if model == "translation" else (3 if dim == 3 else 1)
        if model == "translation" and self.rotation is not None:
            raise ParameterError("constraints fix rotation with model 'translation'; that model has none. Drop them.")
        rotation = _pairs(self.rotation, n_rotation, "rotation", 1.0)
        translation = _pairs(self.translation, dim, "translation", size)
        n_scale = {"similarity": 1, "scaled": dim}.get(model, 0)
        if self.scale is not None and n_scale == 0:
            raise ParameterError(f"constraints bound scale with model {model!r}; expected 'similarity' or 'scaled'.")
        if self.scale is not None and not 0.0 < self.scale[0] <= self.scale[1] < math.inf:
            low, high = self.scale
            raise ParameterError(f"scale is bounded by ({low:g}, {high:g}); expected 0 < low <= high.")
        with np.errstate(divide="ignore"):
            scale = np.log(self.scale or usual_scale or (0.0, math.inf))
        table = np.array([*rotation, *translation, *[tuple(scale)] * n_scale], dtype=np.float64).reshape(-1, 2)
        return np.ascontiguousarray(table[:, 0]), np.ascontiguousarray(table[:, 1])


def model_number(model: str) -> int:
    """Return the number of a model in the kernels, or refuse its name."""
    if not is_among(model, MODELS):
        raise ParameterError(f"model is {told(model)}; expected one of {', '.join(MODELS)}.")
    return MODELS.index(model)


def _as_bounds(bounds: Any, name: str) -> tuple[Bound, ...]:
    """Return a bound an axis, or refuse what is none."""
    if not isinstance(bounds, (tuple, list)) and getattr(bounds, "ndim", 0) != 1:
        raise ParameterError(f"{name} is {told(bounds)}; expected one bound an axis: None, a number or (low, high).")
    return tuple(_as_bound(bound, name) for bound in bounds)


def _as_bound(bound: Any, name: str) -> Bound:
    if bound is None:
        return None
    if not isinstance(bound, (tuple, list, np.ndarray)):
        return _as_end(bound, name)
    if len(bound) != 2:
        raise ParameterError(f"{name} is bounded by {told(bound)}; expected None, a number or (low, high).")
    return _as_end(bound[0], name), _as_end(bound[1], name)


def _as_end(end: Any, name: str) -> float:
    """Return a number, be it infinite: a range may be open."""
    return end if isinstance(end, float) and math.isinf(end) else as_number(end, name)


def _pairs(bounds: tuple[Bound, ...] | None, count: int, name: str, unit: float) -> list[tuple[float, float]]:
    if bounds is None:
        return [(-math.inf, math.inf)] * count
    if len(bounds) != count:
        raise ParameterError(f"{name} has {len(bounds)} bounds; expected {count}, one an axis, None where it is free.")
    pairs = []
    for bound in bounds:
        low, high = (-math.inf, math.inf)
        if isinstance(bound, tuple):
            low, high = bound
        elif bound is not None:
            low, high = -abs(bound), abs(bound)
        if not low <= 0.0 <= high:
            raise ParameterError(f"{name} is bounded by ({low:g}, {high:g}); expected a range that holds the start, 0.")
        pairs.append((low / unit, high / unit))
    return pairs
