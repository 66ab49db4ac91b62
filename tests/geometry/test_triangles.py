from __future__ import annotations

import numpy as np
import pytest
from fake_faults import plane_surface

from seismo3d.geometry.triangles import (
    cut_mesh,
    join_segments,
    measure_cells,
    merge_vertices,
    simplify_line,
    weigh_vertices,
)


def test_cut_of_a_plane_is_its_line() -> None:
    surface = plane_surface(axis=1, centre=20.0, dip_deg=63.4349488, throw=1.0)
    cut = cut_mesh(surface.vertices, surface.cells, axis=0, value=7.3)
    assert np.all(cut.points[:, 0] == 7.3)
    # crossline = 20 + (sample - 24.5) / tan(dip); float32 vertices
    np.testing.assert_allclose(cut.points[:, 1], 20 + (cut.points[:, 2] - 24.5) * 0.5, atol=1e-5)
    lines = join_segments(cut.segments)
    assert len(lines) == 1
    ends = np.sort(cut.points[lines[0]][[0, -1], 2])
    np.testing.assert_allclose(ends, [5.0, 44.0], atol=1e-6)


@pytest.mark.parametrize("value", [2.0, 5.0, 27.0])
def test_cut_through_vertices_has_no_double_segments(value: float) -> None:
    points = np.array([[i, j, 0.0] for i in range(4) for j in range(4)], dtype=float) * [5.0, 1.0, 1.0] + [2.0, 0, 0]
    n = np.arange(16).reshape(4, 4)
    a, b, c, d = n[:-1, :-1].ravel(), n[1:, :-1].ravel(), n[:-1, 1:].ravel(), n[1:, 1:].ravel()
    cells = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    cut = cut_mesh(points, cells, axis=0, value=value)
    length = np.linalg.norm(np.diff(cut.points[cut.segments], axis=1)[:, 0], axis=1).sum()
    # a vertex on the plane counts as above it: the lowest row is missed, every other cut is whole
    expected = 0.0 if value in (2.0, 27.0) else 3.0
    assert length == pytest.approx(expected)


def test_cut_interpolates_values_and_skips_what_is_not_known() -> None:
    vertices = np.array([[0.0, 0, 0], [4.0, 0, 0], [0.0, 4, 0]])
    cut = cut_mesh(vertices, np.array([[0, 1, 2]]), axis=0, value=1.0)
    x = cut.interpolate(vertices[:, 0])
    np.testing.assert_allclose(x, 1.0)
    np.testing.assert_allclose(sorted(cut.interpolate(np.array([np.nan, 8.0, 4.0]))), [5.0, 8.0])
    assert np.isnan(cut.interpolate(np.full(3, np.nan))).all()


def test_cut_that_misses_is_empty() -> None:
    cut = cut_mesh(np.eye(3), np.array([[0, 1, 2]]), axis=2, value=5.0)
    assert cut.points.shape == (0, 3)
    assert join_segments(cut.segments) == []


def test_joining_does_not_depend_on_order_and_closes_loops(rng: np.random.Generator) -> None:
    loop = np.stack([np.arange(10), (np.arange(10) + 1) % 10], axis=1)
    turned = np.where(rng.random(10)[:, None] < 0.5, loop, loop[:, ::-1])[rng.permutation(10)]
    (line,) = join_segments(turned)
    assert len(line) == 11
    assert line[0] == line[-1]
    assert set(line.tolist()) == set(range(10))
    star = np.array([[0, 1], [0, 2], [0, 3]])
    assert sorted(sorted(line.tolist()) for line in join_segments(star)) == [[0, 1], [0, 2], [0, 3]]


def test_simplified_line_stays_within_the_tolerance() -> None:
    t = np.linspace(0, 10, 300)
    line = np.stack([t, np.sin(t), 0.1 * t], axis=1)
    kept = simplify_line(line, tolerance=0.05)
    assert kept[0] == 0
    assert kept[-1] == 299
    assert len(kept) < 40
    rebuilt = np.stack([np.interp(t, t[kept], line[kept, k]) for k in range(3)], axis=1)
    # distance to the chord is at most that at equal parameter, which a parabola's bend exceeds slightly
    assert np.linalg.norm(rebuilt - line, axis=1).max() < 0.1
    assert simplify_line(np.array([[0.0, 0], [1, 1], [2, 2]]), tolerance=1e-9).tolist() == [0, 2]


def test_areas_and_weights() -> None:
    assert measure_cells(np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]]), np.array([[0, 1, 2]])) == pytest.approx(6.0)
    assert measure_cells(np.array([[0.0, 0], [3, 4]]), np.array([[0, 1]])) == pytest.approx(5.0)
    surface = plane_surface(axis=0, centre=15.0, dip_deg=70.0, throw=1.0)
    weights = weigh_vertices(surface.vertices, surface.cells)
    assert weights.sum() == pytest.approx(surface.area, rel=1e-6)
    assert len(weights) == len(surface.vertices)


def test_merged_mesh_keeps_its_place_and_groups_apart() -> None:
    surface = plane_surface(axis=1, centre=20.0, dip_deg=63.4349488, throw=1.0)
    n = len(surface.vertices)
    vertices = np.concatenate([surface.vertices, surface.vertices])
    cells = np.concatenate([surface.cells, surface.cells + n])
    merged, coarse = merge_vertices(vertices, cells, group=np.repeat([0, 1], n), size=6.0)
    assert not set(merged[:n]) & set(merged[n:])
    count = np.bincount(merged)
    means = np.stack([np.bincount(merged, weights=vertices[:, k]) / count for k in range(3)], axis=1)
    assert len(coarse) < len(cells) / 4
    # the mean of points of a plane lies on it
    np.testing.assert_allclose(means[:, 1], 20 + (means[:, 2] - 24.5) * 0.5, atol=1e-4)
    # borders shrink by half a box at most
    assert measure_cells(means, coarse).sum() > 0.6 * 2 * surface.area
