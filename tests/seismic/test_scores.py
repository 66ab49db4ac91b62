from __future__ import annotations

import math

import numpy as np
import pytest

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.seismic.scores import fault_score, throw_score


def sheet(shape=(10, 12, 14), at=5):
    truth = np.zeros(shape, np.int32)
    truth[:, at] = 1
    return truth


@pytest.mark.parametrize(("offset", "expected"), [(0, 1.0), (2, 1.0), (3, 0.0)])
def test_a_parallel_sheet_agrees_up_to_the_tolerance(offset, expected):
    score = fault_score(sheet(at=5 + offset), sheet())
    assert (score.precision, score.recall, score.f1) == (expected, expected, expected)
    assert score.called == pytest.approx(1 / 12)


def test_half_found_and_some_in_vain():
    labels = sheet()
    labels[5:] = 0
    labels[0, 11, :14] = 1
    score = fault_score(labels, sheet(), tolerance=0.0)
    assert score.precision == pytest.approx(70 / 84)
    assert score.recall == pytest.approx(0.5)
    assert score.f1 == pytest.approx(2 * (70 / 84) * 0.5 / (70 / 84 + 0.5))


def test_distance_is_euclidean():
    truth, labels = np.zeros((9, 9)), np.zeros((9, 9))
    truth[4, 4] = 1
    labels[5, 5] = 1
    assert fault_score(labels, truth, tolerance=1.4).precision == 0.0
    assert fault_score(labels, truth, tolerance=1.42).precision == 1.0


def test_nothing_called_and_nothing_true():
    empty = np.zeros((10, 12, 14))
    score = fault_score(empty, sheet())
    assert math.isnan(score.precision)
    assert (score.recall, score.f1, score.called) == (0.0, 0.0, 0.0)
    free = fault_score(sheet(), empty)
    assert free.precision == 0.0
    assert math.isnan(free.recall)
    assert math.isnan(free.f1)


def test_throws_known_answers():
    truth = sheet()
    true_throw = np.where(truth > 0, 6.0, np.nan)
    labels = sheet(at=6)
    throw = np.where(labels > 0, 7.0, np.nan)
    throw[:2][labels[:2] > 0] = 9.0
    throw[2:5][labels[2:5] > 0] = np.nan
    score = throw_score(labels, throw, truth, true_throw)
    assert score.n_found == 140
    assert score.known == pytest.approx(0.7)
    assert score.within == pytest.approx(0.5)
    assert score.median_error == 1.0
    # The sign counts.
    assert throw_score(labels, -throw, truth, true_throw).within == 0.0
    assert throw_score(np.zeros_like(labels), throw, truth, true_throw).n_found == 0


def test_refusals():
    with pytest.raises(ShapeError, match="expected the same shape"):
        fault_score(np.zeros((3, 3)), np.zeros((3, 4)))
    with pytest.raises(ParameterError, match="tolerance"):
        fault_score(sheet(), sheet(), tolerance=-1)
    with pytest.raises(ShapeError, match="throw has shape"):
        throw_score(sheet(), np.zeros(3), sheet(), np.zeros(3))
