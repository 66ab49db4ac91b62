from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from seismo3d._multiply_add import multiply_add


@njit
def _fuse(a, b, c):
    out = np.empty_like(a)
    for k in range(len(a)):
        out[k] = multiply_add(a[k], b[k], c[k])
    return out


def test_is_rounded_once_in_the_vector_part_of_a_loop_and_in_its_rest(rng):
    a, b, c = rng.standard_normal((3, 1003)).astype(np.float32)
    # products of two float32 are exact in float64, and the sum of such a product is rounded there below float32's half
    exact = (a.astype(np.float64) * b + c).astype(np.float32)
    np.testing.assert_array_equal(_fuse(a, b, c), exact)
    np.testing.assert_array_equal([_fuse(a[k : k + 1], b[k : k + 1], c[k : k + 1])[0] for k in range(1003)], exact)
    assert (exact != a * b + c).any()


def test_python_gives_it_to_rounding(rng):
    a, b, c = rng.standard_normal((3, 50))
    np.testing.assert_allclose(_fuse(a, b, c), multiply_add(a, b, c), rtol=0, atol=1e-15)


def test_numbers_of_two_types_are_refused():
    with pytest.raises(Exception, match="multiply_add"):
        _fuse(np.ones(2, np.float32), np.ones(2), np.ones(2))
