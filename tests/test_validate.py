"""Numbers at the doors of public functions."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import seismo3d as s3
from seismo3d._validate import as_number, as_points, as_real_array
from seismo3d.errors import ParameterError, ShapeError


@pytest.mark.parametrize(
    ("bounds", "value", "expected"),
    [
        ({}, math.inf, "a finite number"),
        ({"low": 0.0}, math.inf, "a finite number of at least 0"),
        ({"low": 0.0, "strict": True}, 0.0, "a finite number greater than 0"),
        ({"high": 2.5}, 3.0, "a finite number of at most 2.5"),
        ({"high": 2.5, "strict": True}, 2.5, "a finite number less than 2.5"),
        ({"low": 0.0, "high": 1.0}, math.nan, "a finite number in [0, 1]"),
        ({"low": 0.0, "high": 1.0, "strict": True}, 1.0, "a finite number in (0, 1)"),
    ],
)
def test_a_number_out_of_bounds_is_refused_in_words(bounds: dict[str, float], value: float, expected: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(f"size is {value:g}; expected {expected}.") + "$"):
        as_number(value, "size", **bounds)  # type: ignore[arg-type]


def test_a_number_within_bounds_comes_back() -> None:
    assert as_number(np.float32(0.5), "size", low=0.5) == 0.5


@pytest.mark.parametrize("value", ["0.5", b"0.5", 10**400, None, 1j], ids=str)
def test_text_is_no_number_even_where_it_could_be_read_as_one(value: object) -> None:
    with pytest.raises(ParameterError, match=r"^size is .*; expected a number\.$"):
        as_number(value, "size")
    with pytest.raises(ParameterError, match=r"^voxel_size is "):
        s3.robot.MapperSettings(voxel_size=value)  # type: ignore[arg-type]


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("take", [as_points, lambda points, _: s3.register(points, points)])
def test_points_in_columns_are_told_how_to_be_turned(take, d: int) -> None:  # type: ignore[no-untyped-def]
    words = rf"has shape \({d}, 50\); expected \(n, {d}\). Give one point a row: transpose a \({d}, n\) array"
    with pytest.raises(ShapeError, match=words):
        take(np.zeros((d, 50)), "points")


@pytest.mark.parametrize("take", [as_points, lambda rows, name: as_real_array(rows, name, ndim=2)])
def test_rows_of_different_lengths_are_refused_by_name(take) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ShapeError, match=r"^points makes no array: .*[^.]\. Give rows of one length\.$"):
        take([[1.0, 2.0], [3.0]], "points")
