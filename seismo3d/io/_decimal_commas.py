"""Decimal commas: where a comma is a decimal sign, and where it parts numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable

_NUMBER = re.compile(r"[+-]?\d+(,\d+)?([eE][+-]?\d+)?|nan", re.IGNORECASE)


def may_have_decimal_commas(words: Iterable[str]) -> bool:
    """Tell whether all words are numbers if a comma is their decimal sign: none has a point, or two commas."""
    return all(_NUMBER.fullmatch(word) for word in words)
