"""Numbers at the doors of public functions."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

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


NOISE, CUBE = np.random.default_rng(1), np.random.default_rng(2).normal(size=(8, 8, 32)).astype(np.float32)
BEYOND = {
    "count of bowls": lambda far: s3.synthetic.migration_smiles(NOISE, (8, 8, 16), 0.1, count=far),
    "shape of bowls": lambda far: s3.synthetic.migration_smiles(NOISE, (8, 8, far), 0.1, count=1),
    "window": lambda far: s3.synthetic.apply_agc(CUBE, window=far),
    "shape of noise": lambda far: s3.synthetic.coloured_noise(NOISE, (8, far), 0.1),
    "lateral": lambda far: s3.synthetic.coloured_noise(NOISE, (8, 16), 0.1, lateral=far),
    "n_bumps": lambda far: s3.synthetic.sample_folding(NOISE, (8, 8, 16), slope=0.1, tilt=0.1, n_bumps=far),
    "shape of folds": lambda far: s3.synthetic.sample_folding(NOISE, (8, far, 16), slope=0.1, tilt=0.1),
    "shape of faults": lambda far: s3.synthetic.sample_faults(NOISE, (8, far, 16), s3.synthetic.FaultPopulation()),
    "shape of a cube": lambda far: s3.synthetic.fault_cube(shape=(8, 8, far)),
    "smiles": lambda far: s3.synthetic.CubeRecipe(smiles=far),
    "wavelength": lambda far: s3.synthetic.CubeRecipe(wavelength=(12.0, far)),
    "count of faults": lambda far: s3.synthetic.FaultPopulation(count=(5, far)),
    "count of horizons": lambda far: s3.find_horizons(CUBE, far),
}


@pytest.mark.parametrize("far", [10**9, 1e30])
@pytest.mark.parametrize("name", BEYOND)
def test_a_number_far_beyond_the_data_is_refused_before_any_work(name: str, far: float) -> None:
    with pytest.raises(ParameterError, match=rf"^{name.split(maxsplit=1)[0]} is .*; expected "):
        BEYOND[name](far)


def test_a_gain_may_be_longer_than_a_short_trace() -> None:
    assert np.isfinite(s3.synthetic.apply_agc(CUBE[..., :6])).all()
    assert np.isfinite(s3.synthetic.apply_agc(CUBE, window=128.0)).all()


@pytest.mark.parametrize("profiles", [(0.5, 0.5, 0.5), (0.0, 0.0, 0.0)])
def test_shares_of_a_population_are_all_of_it(profiles: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError, match=r"^profiles is .*, of sum 1 for FaultPopulation\."):
        s3.synthetic.FaultPopulation(profiles=profiles)  # type: ignore[arg-type]


PATHLESS = [
    s3.trace_faults,
    s3.layer_time,
    s3.describe,
    s3.plot.section,
    lambda wrong: s3.match(wrong, wrong),
    lambda wrong: s3.terrain.compare(wrong, wrong),
]


@pytest.mark.parametrize("wrong", ["f3.sgy", Path("f3.sgy"), b"f3.sgy"], ids=["text", "path", "bytes"])
@pytest.mark.parametrize("take", PATHLESS)
def test_a_path_in_place_of_an_array_is_told_to_be_read(take, wrong: object) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ShapeError, match=r"^\w+ is .*f3\.sgy'\)?; expected an array of numbers\. Read it first"):
        take(wrong)


@pytest.mark.parametrize("wrap", [dict, lambda arrays: xr.Dataset({"first": ("x", arrays["first"])})])
@pytest.mark.parametrize("take", [s3.trace_faults, s3.layer_time, s3.plot.section])
def test_arrays_by_name_are_no_array(wrap, take) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ShapeError, match=r"^cube is of type \w+ with first; expected one array\."):
        take(wrap({"first": np.zeros(4)}))


def test_degrees_in_place_of_radians_are_told() -> None:
    with pytest.raises(ParameterError, match=r"^rotation goes up to 45; expected radians, .* numpy\.radians"):
        s3.Constraints(rotation=(0, (-1.0, 45.0), None))
    assert s3.Constraints(rotation=(math.pi, math.inf, (-math.inf, 0.1))).rotation is not None
