from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.blocks.order import count_high, count_low, median, middle_high


def blockwise(blocks):
    counts = sum(count_high([block]) for block in blocks)
    high = middle_high(counts)
    return median(counts, sum(count_low([block], high) for block in blocks))


@pytest.mark.parametrize("n", [1, 2, 3, 1000, 1001])
@pytest.mark.parametrize("shift", [-5.0, 0.0, 1e6])
def test_median_of_blocks_is_that_of_all_values_to_the_bit(rng, n, shift):
    values = (rng.normal(size=n) + shift).astype(np.float32)
    assert blockwise(np.array_split(values, 3)) == float(np.median(values))


def test_signs_and_ties_are_in_order():
    values = np.array([-0.0, 0.0, -1.5, 1.5, 1.5, -1e-40, 1e-40, 0.0], np.float32)
    assert blockwise([values[:3], values[3:]]) == float(np.median(values))


def test_there_is_no_median_of_nothing():
    assert blockwise([np.empty(0, np.float32)]) == 0.0
