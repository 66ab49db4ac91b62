from __future__ import annotations

import numpy as np
import pytest

from seismo3d.features.growth import check_pairs
from seismo3d.features.pairs import Pairs


@pytest.mark.parametrize(("apart", "kept"), [(0.5, False), (20.0, True)])
def test_matches_off_the_plane_need_witnesses_whose_patches_do_not_overlap(rng, apart, kept):
    # Layers that repeat are alike all over one patch, which agrees with itself; a body off the plane is wider.
    on_plane = rng.uniform(0, 400, (60, 2))
    k = np.arange(14)
    off = np.column_stack([150.0 + apart * (k % 4), 900.0 + apart * (k // 4) + 1.1 * k])
    target = np.concatenate([on_plane, off])
    source = target + np.where(np.arange(74) < 60, 0.0, 25.0)[:, None]
    pairs = Pairs(np.arange(74), target, source, np.repeat(np.eye(2)[None], 74, axis=0), np.ones(74))
    checked = check_pairs(pairs, np.full(74, 15.0), min_agreeing=4, max_misfit=2.0)
    assert set(range(60)) <= set(checked.row)
    assert (set(range(60, 74)) <= set(checked.row)) == kept
    assert set(range(60, 74)).isdisjoint(checked.row) == (not kept)
