"""Convert or refuse: the checks at the door of every public function."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from typing import Any, TypeVar

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float32Array, Float64Array
from seismo3d.errors import ParameterError, ShapeError

_Kind = TypeVar("_Kind")

LONGEST = 100_000
"""Traces or samples along the longest side of a cube to be made."""

# characters of a value that an error shows
_SHOWN = 80
# a thousand times the least number that single precision holds to all its digits
_WEAKEST = 1e-35


def told(value: Any) -> str:
    """Name a value in an error, in one short line: an array by its shape, anything else by how it begins."""
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and shape:
        return f"an array of shape {shape}"
    words = " ".join(repr(value).split())
    return words if len(words) <= _SHOWN else f"{words[:_SHOWN]}..."


def is_among(value: Any, choices: Iterable[str]) -> bool:
    """Tell whether a value is one of some words; what is no word, such as an array, is none of them."""
    return isinstance(value, str) and value in choices


def as_kind(value: Any, kind: type[_Kind], name: str, *, remedy: str) -> _Kind:
    """Return a value as it is, or refuse what is of another kind."""
    if not isinstance(value, kind):
        raise ParameterError(f"{name} is {told(value)}; expected {kind.__name__}. {remedy}")
    return value


def as_flag(value: Any, name: str) -> bool:
    """Return a truth value, or refuse by name what is none, such as a word or an array."""
    if not isinstance(value, (bool, np.bool_)):
        raise ParameterError(f"{name} is {told(value)}; expected True or False.")
    return bool(value)


def check_generator(rng: Any) -> None:
    """Refuse what is no source of randomness."""
    as_kind(rng, np.random.Generator, "rng", remedy="Give numpy.random.default_rng(seed).")


def check_list(values: Any, name: str, kind: type) -> None:
    """Refuse what is no list of things of a kind."""
    words = f"a {type(values).__name__}"
    if isinstance(values, Sequence) and not isinstance(values, (str, bytes)):
        words = next((f"a list with a {type(value).__name__}" for value in values if not isinstance(value, kind)), "")
    if words:
        raise ParameterError(f"{name} is {words}; expected a list of {kind.__name__}. Put one alone in a list.")


def as_single(values: AnyArray, name: str) -> Float32Array:
    """Convert to single precision, a copy, or refuse finite numbers that it cannot hold."""
    with np.errstate(over="ignore"):
        single = np.array(values, np.float32, order="C")
    if values.dtype.kind == "f" and values.dtype.itemsize > single.itemsize:
        largest = float(np.max(np.abs(values), where=np.isfinite(values), initial=0.0))
        if largest > float(np.finfo(np.float32).max):
            raise ParameterError(
                f"{name} has samples up to {largest:.3g}; expected at most 3.4e+38, all that single precision holds. "
                "Scale them down."
            )
    return single


def as_strong(values: AnyArray, name: str) -> Float32Array:
    """Convert a whole cube to single precision, a copy, or refuse one that this rounds, be it all to zero."""
    single = as_single(values, name)
    words = tell_weak(values, name)
    if words:
        raise ParameterError(words)
    return single


def tell_weak(values: AnyArray, name: str) -> str:
    """Say that amplitudes are so small that single precision rounds them all; nothing where they are not."""
    if values.dtype.kind != "f" or not values.size:
        return ""
    largest = float(max(np.fmax.reduce(values, axis=None), -np.fmin.reduce(values, axis=None)))
    if not 0.0 < largest < _WEAKEST:
        return ""
    return (
        f"{name} has no sample larger than {largest:.3g}; expected {_WEAKEST:g} or more, below which single precision "
        "rounds amplitudes, to zero at last. Scale them up."
    )


def as_number(value: Any, name: str, *, low: float = -math.inf, high: float = math.inf, strict: bool = False) -> float:
    """Return a finite number within bounds, or refuse it by name."""
    if isinstance(value, (str, bytes)):  # float would take "0.5", and whoever keeps the value as it came would not
        raise ParameterError(f"{name} is {told(value)}; expected a number.")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{name} is {told(value)}; expected a number.") from error
    inside = low < number < high if strict else low <= number <= high
    if not math.isfinite(number) or not inside:
        raise ParameterError(f"{name} is {number:g}; expected a finite number{_bounds(low, high, strict=strict)}.")
    return number


def _bounds(low: float, high: float, *, strict: bool) -> str:
    """Tell the bounds of a number as a sentence goes on; nothing where it has none."""
    if math.isfinite(low) and math.isfinite(high):
        return f" in ({low:g}, {high:g})" if strict else f" in [{low:g}, {high:g}]"
    if math.isfinite(low):
        return f" greater than {low:g}" if strict else f" of at least {low:g}"
    if math.isfinite(high):
        return f" less than {high:g}" if strict else f" of at most {high:g}"
    return ""


def as_whole_number(value: Any, name: str, *, low: float = -math.inf, high: float = math.inf) -> int:
    """Return a whole number within bounds, or refuse it by name."""
    if isinstance(value, (str, bytes)):
        raise ParameterError(f"{name} is {told(value)}; expected a whole number.")
    number = as_number(value, name, low=low, high=high)
    if number != int(number):
        raise ParameterError(f"{name} is {number:g}; expected a whole number.")
    return int(number)


def as_numbers(values: Any, name: str, *, n: int, low: float = -math.inf, high: float = math.inf) -> tuple[float, ...]:
    """Return so many finite numbers within bounds, or refuse them by name."""
    try:
        given = () if isinstance(values, (str, bytes, set, dict)) else tuple(values)
    except TypeError:
        given = ()
    if len(given) != n:
        raise ParameterError(f"{name} is {told(values)}; expected {n} numbers.")
    return tuple(as_number(value, name, low=low, high=high) for value in given)


def as_whole_numbers(
    values: Any, name: str, *, n: int, low: float = -math.inf, high: float = math.inf
) -> tuple[int, ...]:
    """Return so many whole numbers within bounds, or refuse them by name."""
    return tuple(as_whole_number(value, name, low=low, high=high) for value in as_numbers(values, name, n=n))


def as_cube_shape(shape: Any) -> tuple[int, int, int]:
    """Return the sides of a cube to be made, or refuse what is none."""
    i, x, s = as_whole_numbers(shape, "shape", n=3, low=1, high=LONGEST)
    return i, x, s


def as_array(values: ArrayLike, name: str) -> AnyArray:
    """Return values as an array, or refuse what is none: rows of different lengths, a path, or arrays by name."""
    if isinstance(values, (str, bytes, PathLike)):
        raise ShapeError(f"{name} is {told(values)}; expected an array of numbers. Read it first if it names a file.")
    if isinstance(values, Mapping):
        names = ", ".join(map(str, values))
        raise ShapeError(f"{name} is of type {type(values).__name__} with {names}; expected one array. Give one of it.")
    try:
        return np.asarray(values)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"{name} makes no array: {str(error).rstrip('.')}. Give rows of one length.") from error


def check_array(values: Any, name: str) -> None:
    """Refuse what makes no array; what is one already, be it on disk, is not read."""
    if not hasattr(values, "dtype"):
        as_array(values, name)


def as_real_array(values: ArrayLike, name: str, *, ndim: int | tuple[int, ...]) -> AnyArray:
    """Return a real numeric array with one of the wanted numbers of axes and at least one element."""
    array = as_array(values, name)
    wanted = (ndim,) if isinstance(ndim, int) else ndim
    if array.dtype.kind not in "fiub":
        raise ShapeError(f"{name} has elements of type {array.dtype}; expected real numbers. Convert it first.")
    if array.ndim not in wanted:
        axes = " or ".join(str(n) for n in wanted)
        raise ShapeError(f"{name} has shape {array.shape}; expected {axes} axes.")
    if array.size == 0:
        raise ShapeError(f"{name} has shape {array.shape}: it is empty. Give at least one element.")
    return array


def as_points(
    values: ArrayLike, name: str, *, dim: int | tuple[int, ...] = (2, 3), finite: bool = True
) -> Float64Array:
    """Return points as a C-ordered float64 array of shape (n, d), one point a row."""
    dims = (dim,) if isinstance(dim, int) else dim
    points = as_array(values, name)
    wanted = " or ".join(f"(n, {d})" for d in dims)
    if points.dtype.kind not in "fiu":
        raise ShapeError(
            f"{name} has elements of type {points.dtype}; expected real numbers in an array of shape {wanted}."
        )
    if points.ndim != 2 or points.shape[1] not in dims:
        remedy = "Give one point a row."
        if points.ndim == 2 and points.shape[0] in dims:
            d = points.shape[0]
            wanted, remedy = f"(n, {d})", f"Give one point a row: transpose a ({d}, n) array."
        raise ShapeError(f"{name} has shape {points.shape}; expected {wanted}. {remedy}")
    points = np.ascontiguousarray(points, dtype=np.float64)
    if finite and not np.isfinite(points).all():
        n_bad = int((~np.isfinite(points).all(axis=1)).sum())
        raise ShapeError(
            f"{name} has {n_bad} rows with NaN or infinite values; expected finite points. Drop those rows first."
        )
    return points


def freeze(array: AnyArray) -> AnyArray:
    """Make an array read-only and return it: results are not to be changed in place."""
    array.flags.writeable = False
    return array
