from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import seismo3d as s3
from seismo3d.errors import Seismo3dWarning, ShapeError
from seismo3d.seismic.preparing import (
    check_period,
    clean_volume,
    find_valid,
    mark_data,
    print_traces,
    refuse_dead,
    repeats_itself,
)
from seismo3d.seismic.section_tracks import thicken

SHAPE = (64, 48, 64)


def stepped(*, axis: int = 0, dip: float = 0.0) -> NDArray[np.float32]:
    """Level layers without noise, eight samples lower behind a fault across an axis, the same along the other."""
    trace = np.convolve(np.random.default_rng(2).normal(size=200), np.hanning(9), "same")
    along = np.moveaxis(np.broadcast_to(np.arange(SHAPE[axis])[:, None], (SHAPE[axis], SHAPE[1 - axis])), 0, axis)
    k = np.arange(SHAPE[2])
    behind = along[..., None] > SHAPE[axis] // 2 + dip * (k - SHAPE[2] // 2)
    return np.interp(k - 8.0 * behind, np.arange(-50, 150), trace).astype(np.float32)


@pytest.mark.parametrize("axis", [0, 1])
def test_layers_without_noise_are_data(axis: int) -> None:
    cube = stepped(axis=axis)
    faults = s3.trace_faults(cube)
    assert len(faults.surfaces) == 1
    assert np.median(np.abs(faults.surfaces[0].throw)) == pytest.approx(8.0, abs=0.5)
    assert np.isfinite(s3.layer_time(cube, faults=faults)).all()


@pytest.mark.parametrize(("axis", "dip"), [(0, 0.0), (1, 0.0), (0, 0.5), (1, 0.5)])
def test_all_of_a_noise_free_cube_is_kept(axis: int, dip: float) -> None:
    assert find_valid(stepped(axis=axis, dip=dip)).all()


def test_all_of_a_noise_free_section_is_kept() -> None:
    assert find_valid(stepped(axis=1)[:1]).all()


def test_zeros_at_the_ends_of_traces_are_no_data_however_few(rng: np.random.Generator) -> None:
    cube = (rng.normal(size=(8, 24, 64)) + 10.0).astype(np.float32)
    first, last = np.arange(24), 60 - np.arange(24) // 2
    k = np.arange(64)
    data = np.broadcast_to((k >= first[:, None]) & (k < last[:, None]), cube.shape)
    cube[~data] = 0.0
    cube[:, :, 30:33] = 0.0  # as they come in coarse amplitudes
    np.testing.assert_array_equal(find_valid(cube), data)


def framed(rng: np.random.Generator, width: int) -> NDArray[np.float32]:
    """Traces that all differ, and the outer ones repeated outwards along their inlines."""
    inner = rng.normal(size=(12, 24, 32)).astype(np.float32)
    return np.pad(inner, ((0, 0), (width, width), (0, 0)), mode="edge")


def test_padding_by_repeated_traces_is_no_data(rng: np.random.Generator) -> None:
    cube = framed(rng, 8)
    valid = find_valid(cube)
    # the trace that is repeated goes with its copies
    assert valid[:, 9:-9].all()
    assert not valid[:, :9].any()
    assert not valid[:, -9:].any()
    assert not cube[~valid].any()


def test_padding_of_more_than_half_of_the_traces_is_taken_for_data(rng: np.random.Generator) -> None:
    assert find_valid(framed(rng, 13)).all()


def test_missing_traces_do_not_count_as_alike(rng: np.random.Generator) -> None:
    cube = framed(rng, 8)
    wide = np.full((60, *cube.shape[1:]), np.nan, np.float32)
    wide[:12] = cube
    assert not find_valid(wide)[:12, :9].any()
    assert not find_valid(np.full((8, 8, 16), np.nan, np.float32)).any()


def test_prints_are_those_of_the_traces(rng: np.random.Generator) -> None:
    values: Any = rng.normal(size=(20, 30, 16)).astype(np.float32)
    values[3, 4], values[7] = values[15, 21], values[6]
    valid, _ = mark_data(values)
    prints = print_traces(values)
    _, of_bits = np.unique(values.reshape(-1, 16), axis=0, return_inverse=True)
    _, of_prints = np.unique(prints, return_inverse=True)
    # as many different ones, and equal wherever the traces are
    assert len(np.unique(of_bits)) == len(np.unique(of_prints)) == 20 * 30 - 31
    assert len(np.unique(np.stack([of_bits.ravel(), of_prints.ravel()]), axis=1).T) == 20 * 30 - 31
    # whole blocks of a cube have the prints of the whole
    np.testing.assert_array_equal(print_traces(np.ascontiguousarray(values[5:9, 10:])), prints[5:9, 10:])
    assert not repeats_itself(prints, valid.any(axis=2))


def test_padding_of_a_line_is_no_data_where_it_is_made_a_cube(rng: np.random.Generator) -> None:
    line = framed(rng, 8)[0]
    thick, _ = thicken(line, None)
    kept = find_valid(np.array(thick, np.float32)).all(axis=2)
    np.testing.assert_array_equal(kept, np.broadcast_to(find_valid(line[None].copy()).all(axis=2), kept.shape))
    assert not kept[:, :9].any()
    assert kept[:, 9:-9].all()


def test_traces_far_denser_than_their_wavelet_are_told_with_what_to_do(rng: np.random.Generator) -> None:
    t = np.arange(-100, 101) / 50.0
    wavelet = (1.0 - 2.0 * (np.pi * t) ** 2) * np.exp(-((np.pi * t) ** 2))
    trace = np.convolve(rng.normal(size=800), wavelet, "same")[150:650]
    dense = (trace + 0.01 * rng.normal(size=(12, 12, 500))).astype(np.float32)
    with pytest.warns(Seismo3dWarning, match=r"samples long; expected 3 to 16.*cube\[\.\.\., ::3\].*--every 3"):
        clean_volume(dense.copy())
    with pytest.warns(Seismo3dWarning, match="Traces are too short to be thinned"):
        check_period(20.0, 30)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        clean_volume(np.ascontiguousarray(dense[..., ::3]))
        # reflections on a drift are no denser for that
        drift = 5.0 * dense.std() * np.sin(2.0 * np.pi * np.arange(167) / 80.0).astype(np.float32)
        clean_volume(dense[..., ::3] + drift)
        # what was integrated, as to impedances, is mostly slow and still has the reflections' own detail
        clean_volume(np.cumsum(dense[..., ::3], axis=2))


def test_a_cube_of_one_value_is_refused_as_what_it_is() -> None:
    with pytest.raises(ShapeError, match="cube has no live trace: all are missing, or of one value throughout"):
        s3.trace_faults(np.full((20, 20, 40), 3.0, np.float32))
    with pytest.raises(ShapeError, match="section has no live trace: all are missing, or of one value"):
        refuse_dead(np.zeros(20, bool), "section")
