from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.levelling import bridge_unknown, fill_absent, find_footprint, level, level_reach, trace_medians
from seismo3d.seismic.misfit_settings import MisfitSettings


def test_evidence_of_some_traces_is_bridged_and_levelled_as_that_of_all(rng):
    evidence = rng.random((30, 28, 17)).astype(np.float32)
    weight = (rng.random((30, 28, 17)) > 0.2).astype(np.float32)
    inner, settings = (slice(9, 21), slice(4, 28)), MisfitSettings(background=(2.0, 4.0))
    assert level_reach(settings) == 5
    filled = bridge_unknown(evidence, weight)
    assert (filled[weight < 0.5] != evidence[weight < 0.5]).all()
    np.testing.assert_array_equal(bridge_unknown(evidence, weight, within=inner), filled[inner])
    whole, sums = level(filled, settings)
    part, part_sums = level(filled, settings, within=inner)
    np.testing.assert_array_equal(part, whole[inner])
    np.testing.assert_array_equal(part_sums, sums[inner])


def test_what_is_far_from_all_evidence_is_absent_and_gets_the_mean():
    evidence = np.full((12, 12, 20), 2.0, np.float32)
    weight = np.ones_like(evidence)
    weight[:, :, :12] = 0.0
    weight[5, 5] = 0.0
    bridged = bridge_unknown(evidence, weight)
    absent = np.isnan(bridged)
    assert absent[:, :, :8].all()
    assert not absent[:, :, 11:].any()
    np.testing.assert_allclose(bridged[~absent], 2.0, rtol=1e-5)
    fill_absent(bridged, 0.5)
    assert (bridged[absent] == 0.5).all()


def test_medians_of_traces_are_those_of_what_is_there(rng):
    bridged = rng.random((6, 7, 15)).astype(np.float32)
    for n, (i, j) in enumerate(np.ndindex(5, 7)):
        bridged[i, j, : n % 15] = np.nan
    bridged[2, 3] = np.nan
    found = trace_medians(bridged)
    assert np.isnan(found[2, 3])
    told = np.isfinite(found)
    assert told.sum() == 41
    np.testing.assert_allclose(found[told], np.nanmedian(bridged[told], axis=1), rtol=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
def test_footprint_of_lines_is_told_beside_those_without_evidence(axis):
    medians = np.full((60, 60), 1.0, np.float32)
    lines = np.moveaxis(medians, axis, 0)
    lines[30] = 1.3
    whole = find_footprint(medians, axis, 0.2, MisfitSettings())
    lines[40:] = np.nan
    lines[:, 20:50] = np.nan
    found = find_footprint(medians, axis, 0.2, MisfitSettings())
    np.testing.assert_allclose(found[:40], whole[:40], atol=1e-3)
    assert np.abs(found[40:]).max() < 0.02
    assert find_footprint(np.full_like(medians, np.nan), axis, 0.2, MisfitSettings()) is None
