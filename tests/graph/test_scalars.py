"""Relative measurements: gathered from arrays, joined, refused."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ShapeError
from seismo3d.graph.scalars import ScalarEdges


def test_scalars_stand_for_every_edge() -> None:
    edges = ScalarEdges.from_arrays([0, 1, 1], [1, 2, 3], measured=[2.0, 4.0, 1.0], first_share=[0, 0, 0.25])
    assert len(edges) == 3
    np.testing.assert_array_equal(edges.variance, [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(edges.second_share, [0.0, 0.0, 0.0])
    assert (edges.first.dtype, edges.measured.dtype) == (np.int32, np.float32)


def test_joined_edges_are_all_there() -> None:
    one = ScalarEdges.from_arrays([0], [1], measured=[1.0])
    two = ScalarEdges.from_arrays([1], [2], measured=[3.0], variance=4.0)
    joined = ScalarEdges.join(ScalarEdges.none(), one, two)
    np.testing.assert_array_equal(joined.second, [1, 2])
    np.testing.assert_array_equal(joined.measured, [1.0, 3.0])
    np.testing.assert_array_equal(joined.variance, [1.0, 4.0])


def test_refusals() -> None:
    with pytest.raises(ShapeError, match="one length"):
        ScalarEdges.from_arrays([0, 1], [1, 2, 3], measured=[1.0])
    with pytest.raises(ShapeError, match=r"expected \(n,\)"):
        ScalarEdges.from_arrays([[0]], [[1]], measured=[[1.0]])
    with pytest.raises(ShapeError, match="not positive"):
        ScalarEdges.from_arrays([0], [1], measured=[1.0], variance=0.0)
