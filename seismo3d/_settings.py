"""Settings at the door: each field is annotated with what it may be, and checked against that.

A number's interval stands beside its type, ``Annotated[int, "[1, far]"]``: a bracket takes its end in, a parenthesis
leaves it out, and an end may be another field. A rule for all numbers of a tuple, one of `RULES` or
``"among"`` those of another field, stands there just so.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import lru_cache
from itertools import pairwise
from types import NoneType, UnionType
from typing import Annotated, Any, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from seismo3d._validate import LONGEST, told
from seismo3d.errors import ParameterError

_Settings = TypeVar("_Settings")

Share: TypeAlias = Annotated[float, "[0, 1]"]
"""Part of a whole; scores and fits that are 1 at best."""
Correlation: TypeAlias = Annotated[float, "[-1, 1]"]
Degrees: TypeAlias = Annotated[float, "[0, 90]"]
"""Angle between lines or planes, or a dip."""
Threshold: TypeAlias = Annotated[float, "[0, inf]"]
"""What is to be reached; endless where nothing shall reach it, or nothing exceed it."""
Amount: TypeAlias = Annotated[float, "[0, inf)"]
Stiffness: TypeAlias = Annotated[float, "[0, 1000000]"]
"""Of a fit, against what single precision would lose."""
Positive: TypeAlias = Annotated[float, "(0, inf)"]
Width: TypeAlias = Annotated[float, "(0, 1000]"]
"""Width of a window; the longest is wider than nearly all cubes."""
Smoothing: TypeAlias = Annotated[float, "[0, 1000]"]
"""The same where 0 means none."""
Count: TypeAlias = Annotated[int, "[1, 1000000]"]
Steps: TypeAlias = Annotated[int, "[1, 100]"]
"""Traces, samples or rounds, of which there is at least one."""
Side: TypeAlias = Annotated[int, f"[1, {LONGEST}]"]
"""Side of a cube to be made."""
Many: TypeAlias = Annotated[int, "[0, 10000]"]
"""Faults, bodies and the like that a cube is made with."""
StepsOrNone: TypeAlias = Annotated[int, "[0, 100]"]

RULES: dict[str, Callable[[Any], Any]] = {
    "not empty": bool,
    "rising from 1": lambda numbers: numbers and numbers[0] == 1 and RULES["rising"](numbers),
    "rising": lambda numbers: all(a < b for a, b in pairwise(numbers)),
    "not falling": lambda numbers: all(a <= b for a, b in pairwise(numbers)),
    "of sum 1": lambda numbers: math.isclose(sum(numbers), 1.0),
    "halving to 1": lambda numbers: numbers and numbers[-1] == 1 and all(a == 2 * b for a, b in pairwise(numbers)),
}

INTERVAL = re.compile(r"([\[(])(\S+), (\S+)([\])])")
_NAMES = {int: "a whole number", float: "a number", bool: "True or False", str: "a word", NoneType: "None"}
_KINDS: dict[Any, Any] = {
    int: (int, np.integer),
    float: (int, np.integer, float, np.floating),
    bool: (bool, np.bool_),
    str: str,
    NoneType: NoneType,
}


def as_settings(settings: _Settings | None, kind: type[_Settings], name: str = "settings") -> _Settings:
    """Return settings as they are, the usual ones for none, or refuse what cannot be some."""
    if settings is None:
        return kind()
    if not isinstance(settings, kind):
        names = f"**{told(settings)}" if isinstance(settings, dict) else "..."
        raise ParameterError(
            f"{name} is of type {type(settings).__name__}; expected {kind.__name__}. "
            f"Give {kind.__name__}({names}), or leave it out."
        )
    if is_dataclass(settings):
        check_fields(settings, f"{name}.")
    return settings


def check_fields(settings: Any, name: str = "") -> None:
    """Refuse settings with a field that is not what its annotation says."""
    kind: Any = type(settings)
    for field, hint in hints_of(kind).items():
        value = getattr(settings, field)
        if not may_be(value, hint, settings):
            usual = getattr(kind(), field)
            made = f"{type(usual).__name__}(...)" if is_dataclass(usual) else f"{usual!r}"
            raise ParameterError(
                f"{name}{field} is {told(value)}; expected {in_words(hint)} for {kind.__name__}. "
                f"Leave it out for {made}."
            )
        if is_dataclass(value):
            check_fields(value, f"{name}{field}.")


@lru_cache
def hints_of(kind: type) -> dict[str, Any]:
    """Return what each field of a dataclass is annotated with, by name."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in fields(kind)}


def may_be(value: Any, hint: Any, settings: Any) -> bool:
    """Tell whether a value of some settings is what its annotation says, if that says anything of numbers or words."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return may_be(value, inner[0], settings) and all(_obeys(value, rule, settings) for rule in inner[1:])
    if origin is tuple:
        if not isinstance(value, (tuple, list)):
            return False
        hints = (inner[0],) * len(value) if inner[-1] is ... else inner
        return len(hints) == len(value) and all(map(may_be, value, hints, [settings] * len(value)))
    if origin in (Union, UnionType):
        return any(may_be(value, part, settings) for part in inner)
    if is_dataclass(hint):
        return isinstance(value, hint)  # type: ignore[arg-type]
    if hint not in _KINDS:
        return True
    return isinstance(value, _KINDS[hint]) and isinstance(value, (bool, np.bool_)) == (hint is bool)


def _obeys(value: Any, rule: str, settings: Any) -> bool:
    """Tell whether a value lies in an interval, which no NaN does, or numbers keep a rule."""
    found = INTERVAL.fullmatch(rule)
    if rule.startswith("among "):
        return set(value) <= set(getattr(settings, rule.removeprefix("among ")))
    if not found:
        return bool(RULES[rule](value))
    opening, low, high, closing = found.groups()
    least, most = _end(low, settings), _end(high, settings)
    is_over = least <= value if opening == "[" else least < value
    return bool(is_over and (value <= most if closing == "]" else value < most))


def _end(word: str, settings: Any) -> float:
    try:
        return float(word)
    except ValueError:
        end = getattr(settings, word)
        return end if isinstance(end, _KINDS[float]) else math.nan


def in_words(hint: Any) -> str:
    """Tell what a value may be, as a sentence goes on."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        words = in_words(inner[0])
        for rule in inner[1:]:
            words += f" in {rule}" if INTERVAL.fullmatch(rule) else f", {rule}"
        return words
    if origin is tuple:
        parts = [in_words(part) for part in inner if part is not ...]
        return f"({', '.join(parts)}{', ...' if inner[-1] is ... else ''})"
    if origin in (Union, UnionType):
        return " or ".join(map(in_words, inner))
    return _NAMES.get(hint) or str(hint.__name__)
