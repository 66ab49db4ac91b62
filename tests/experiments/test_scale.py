from __future__ import annotations

import numpy as np

from seismo3d.experiments.scale import large_cube


def test_any_part_of_the_large_cube_is_the_same_whichever_other_is_made():
    small, large = np.asarray(large_cube((32, 32, 96))), np.asarray(large_cube((40, 48, 96)))
    assert large.shape == (40, 48, 96)
    np.testing.assert_array_equal(large[:32, :32], small)
    assert np.isfinite(large).all()
