"""How far a map may be off where a camera looks, on views and graphs whose covariances are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.geometry.rotations import adjoint, exp_rotation, invert_transform, make_transform
from seismo3d.graph.poses import PoseGraph
from seismo3d.robot.drift import map_covariance, step_covariance, tie_covariances
from seismo3d.robot.landmarks import View


def make_view(place: list[float], variance: float) -> View:
    nothing = np.empty((0, 0), np.uint8), np.empty((0, 2)), np.empty((0, 3))
    return replace(View(make_transform(np.eye(3), place), *nothing), covariance=variance * np.eye(6))


def test_a_map_is_as_sure_as_the_surest_view_that_shows_nearly_the_same() -> None:
    views = [make_view([0.0, 0.0, 0.0], 1e-6), make_view([0.0, 0.0, 0.6], 4e-6), make_view([0.0, 0.0, 1.2], 9e-6)]
    here = make_transform(np.eye(3), [0.0, 0.0, 0.7])
    np.testing.assert_array_equal(map_covariance(views, here), views[0].covariance)
    there = make_transform(np.eye(3), [0.0, 0.0, 1.3])
    np.testing.assert_array_equal(map_covariance(views, there), views[1].covariance)
    turned = make_transform(exp_rotation([0.0, 2.0, 0.0]), [0.0, 0.0, 1.3])  # sees nothing of any: the nearest
    np.testing.assert_array_equal(map_covariance(views, turned), views[2].covariance)
    np.testing.assert_array_equal(map_covariance([], here), np.zeros((6, 6)))


def test_a_moved_view_is_as_sure_as_before_in_its_own_frame(rng: np.random.Generator) -> None:
    root = rng.normal(size=(6, 6))
    view = replace(make_view([0.3, -0.2, 1.0], 0.0), covariance=root @ root.T)
    moved = view.moved(make_transform(exp_rotation([0.3, 1.2, -0.5]), [4.0, 1.0, -2.0]))
    own = [adjoint(invert_transform(v.T_world_camera)) @ v.covariance @ adjoint(invert_transform(v.T_world_camera)).T
           for v in (view, moved)]  # fmt: skip
    np.testing.assert_allclose(own[0], own[1], atol=1e-9)


def test_a_step_is_as_unsure_as_one_end_is_surer_than_the_other() -> None:
    sure, unsure = np.diag([1e-6] * 5 + [1e-6]), np.diag([1e-6] * 5 + [0.04])  # along z
    T = make_transform(exp_rotation([0.0, np.pi / 2, 0.0]), [0.0, 0.0, 3.0])  # whose own x is the world's -z
    for before, after in ((sure, unsure), (unsure, sure)):
        np.testing.assert_allclose(
            step_covariance(before, after, T), np.diag([0.0, 0.0, 0.0, 0.04 - 1e-6, 0.0, 0.0]), atol=1e-12
        )
    np.testing.assert_array_equal(step_covariance(sure, sure, T), np.zeros((6, 6)))


@pytest.mark.parametrize("known", [4, 2])
def test_edges_tie_poses_to_surer_ones(known: int) -> None:
    """Four poses in a row, each less sure than the one before; an edge from the first to the last closes the loop."""
    poses = [make_transform(np.eye(3), [0.0, 0.0, 0.0])] * 4
    step, link = 1e-4 * np.eye(6), 2e-5 * np.eye(6)
    edges = [(k, k + 1, np.eye(4), np.linalg.inv(step), False) for k in range(3)]
    graph = PoseGraph.of(poses, [*edges, (0, 3, np.eye(4), np.linalg.inv(link), True)])
    before = np.array([k * 1e-4 * np.eye(6) for k in range(4)])
    told, used = np.arange(4) < known, np.ones(4, dtype=bool)
    after = tie_covariances(graph, before, known=told, used=used)
    np.testing.assert_allclose(after[:, 0, 0], [0.0, 1e-4, 1.2e-4, 2e-5], rtol=1e-9)
    used[3] = False
    after = tie_covariances(graph, before, known=told, used=used)
    np.testing.assert_allclose(after[:, 0, 0], [0.0, 1e-4, 2e-4, 3e-4], rtol=1e-9)
