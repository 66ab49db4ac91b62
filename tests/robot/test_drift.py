"""How far a map may be off where a camera looks, on views and graphs whose covariances are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.geometry.rotations import exp_rotation, invert_transform, make_transform
from seismo3d.graph.poses import PoseGraph
from seismo3d.robot.drift import step_covariance, step_errors, surest_view, tie_covariances
from seismo3d.robot.landmarks import View
from seismo3d.robot.pose_errors import PoseErrors


def make_view(place: list[float], variance: float) -> View:
    nothing = np.empty((0, 0), np.uint8), np.empty((0, 2)), np.empty((0, 3))
    return replace(
        View(make_transform(np.eye(3), place), *nothing),
        errors=PoseErrors(0.5 * variance * np.eye(6), 0.5 * variance * np.eye(6)),
    )


def test_a_map_is_as_sure_as_the_surest_view_that_shows_nearly_the_same() -> None:
    views = [make_view([0.0, 0.0, 0.0], 1e-6), make_view([0.0, 0.0, 0.4], 4e-6), make_view([0.0, 0.0, 0.8], 9e-6)]
    here = make_transform(np.eye(3), [0.0, 0.0, 0.5])
    assert surest_view(views, here) is views[0]
    there = make_transform(np.eye(3), [0.0, 0.0, 0.95])
    assert surest_view(views, there) is views[1]
    turned = make_transform(exp_rotation([0.0, 2.0, 0.0]), [0.0, 0.0, 0.95])  # sees nothing of any: the nearest
    assert surest_view(views, turned) is views[2]
    assert surest_view([], here) is None


def test_a_moved_view_is_as_sure_as_before_in_its_own_frame(rng: np.random.Generator) -> None:
    root = rng.normal(size=(6, 6))
    errors = PoseErrors(root @ root.T, 0.3 * root @ root.T, rng.normal(size=(6, 4)))
    view = replace(make_view([0.3, -0.2, 1.0], 0.0), errors=errors)
    moved = view.moved(make_transform(exp_rotation([0.3, 1.2, -0.5]), [4.0, 1.0, -2.0]))
    own = [v.errors.moved(invert_transform(v.T_world_camera)) for v in (view, moved)]
    for name in ("covariance", "alike", "by_lens"):
        np.testing.assert_allclose(getattr(own[0], name), getattr(own[1], name), atol=1e-9)


def test_a_step_is_as_unsure_as_one_end_is_surer_than_the_other() -> None:
    sure, unsure = np.diag([1e-6] * 5 + [1e-6]), np.diag([1e-6] * 5 + [0.04])  # along z
    T = make_transform(exp_rotation([0.0, np.pi / 2, 0.0]), [0.0, 0.0, 3.0])  # whose own x is the world's -z
    for before, after in ((sure, unsure), (unsure, sure)):
        np.testing.assert_allclose(
            step_covariance(before, after, T), np.diag([0.0, 0.0, 0.0, 0.04 - 1e-6, 0.0, 0.0]), atol=1e-12
        )
    np.testing.assert_array_equal(step_covariance(sure, sure, T), np.zeros((6, 6)))


def test_what_goes_all_the_same_way_grows_by_a_steps_standard_deviation() -> None:
    """From 30 to 32 mm it has grown by 2, not by the root of 32^2 - 30^2."""
    before, after = (PoseErrors(1e-6 * np.eye(6), sigma**2 * np.eye(6)) for sigma in (0.030, 0.032))
    np.testing.assert_allclose(step_errors(before, after, np.eye(4)), 0.002**2 * np.eye(6), atol=1e-9)


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
