from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.doubles import part_doubles
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetThrow

SETTINGS = ChoiceSettings()


def candidate(first, rows, *, columns=30, w=20.0, dip=70.0, across=(1.0, 0.0), fit=0.8):
    """A plane of rows traces along its strike, from a first one on, by 2 * columns samples, and its throw."""
    shape = (rows, columns)
    depth = 2.0 * np.arange(columns) / np.tan(np.radians(dip))
    place = np.broadcast_to(w + depth, shape).astype(np.float32)
    sheet = Sheet(np.zeros(2), np.array(across), 0, 2, float(first), place, np.ones(shape, np.float32))
    return sheet, SheetThrow(np.full(shape, 6.0, np.float32), np.full(shape, fit, np.float32), 1)


def parted(*candidates):
    sheets, throws = [c[0] for c in candidates], [c[1] for c in candidates]
    found, thrown, today = part_doubles(sheets, throws, list(throws), SETTINGS)
    assert len(found) == len(thrown) == len(today)
    assert all(a is b for a, b in zip(thrown, today, strict=True))
    return found, thrown


def test_what_lies_on_a_fault_found_before_is_left_to_the_one_that_matches_best():
    better, worse = candidate(40, 60, fit=0.9), candidate(0, 60, w=21.0, fit=0.6)
    (first, second), _ = parted(worse, better)
    np.testing.assert_array_equal(second.w, better[0].w)
    rows = np.flatnonzero(first.inside.any(axis=1))
    # the two overlap from row 40 on, a trace apart
    assert rows.min() == 0
    assert 36 <= rows.max() < 40
    assert first.inside[rows].all()
    np.testing.assert_array_equal(first.w[rows], worse[0].w[rows])
    assert np.isnan(first.score[~first.inside]).all()
    apart, _ = cKDTree(second.nodes()).query(first.nodes())
    assert apart.min() > 1.5


def test_what_has_hardly_more_than_another_is_that_other():
    whole, most = candidate(0, 60), candidate(30, 34, fit=0.7)
    found, thrown = parted(whole, most)
    assert len(found) == 1
    assert found[0] is whole[0]
    assert thrown[0] is whole[1]


def test_size_counts_beside_fit():
    small, large = candidate(0, 12, fit=0.9), candidate(0, 60, fit=0.7)
    found, _ = parted(small, large)
    assert len(found) == 1
    assert found[0] is large[0]


def test_faults_that_cross_keep_all_of_themselves():
    host = candidate(0, 60)
    for other in (
        candidate(-40, 60, across=(0.0, 1.0)),
        candidate(0, 60, w=42.0, dip=110.0),
        candidate(0, 60, w=24.0, dip=40.0),
        candidate(0, 60, w=25.0),
    ):
        found, _ = parted(host, other)
        assert found == [host[0], other[0]]


def test_a_sheet_turned_round_is_the_same_fault():
    host = candidate(0, 60)
    turned = candidate(-60, 60, w=-20.0, dip=110.0, across=(-1.0, 0.0), fit=0.5)
    apart, _ = cKDTree(host[0].nodes()).query(turned[0].nodes())
    assert apart.max() < 1.5
    found, _ = parted(turned, host)
    assert found == [host[0]]


def test_a_throw_that_is_known_nowhere_matches_least():
    unknown = candidate(0, 60)
    nowhere = SheetThrow(np.full_like(unknown[1].throw, np.nan), np.zeros_like(unknown[1].fit), 1)
    small = candidate(0, 30, fit=0.3)
    found, _ = parted((unknown[0], nowhere), small)
    assert len(found) == 2
    assert found[1] is small[0]
    assert found[0].inside.sum() < 31 * 30


def test_without_faults_there_is_nothing_to_part():
    assert part_doubles([], [], [], SETTINGS) == ([], [], [])
