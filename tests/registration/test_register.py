"""Registering scans: known answers, perturbed starts, invariance, degeneracy, named states, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import seismo3d
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry.rotations import exp_rotation, make_transform, random_rotation, rotation_angle, transform_points
from seismo3d.registration.constraints import Constraints
from seismo3d.registration.register import register
from seismo3d.registration.settings import LoopSettings
from seismo3d.scan import Scan

SMALL = make_transform(exp_rotation([0.05, -0.08, 0.1]), [0.05, -0.03, 0.04])


def hill(rng, n=6000):
    u, v = rng.uniform(-1, 1, size=(2, n))
    return np.column_stack([u, v, 0.25 * np.sin(4 * u) * np.cos(3 * v) + 0.1 * u * v])


def figure(rng, n=8000):
    """A body without symmetry: a box with a ball and a rod."""
    box = rng.uniform(-1, 1, size=(n, 3)) * [1.0, 0.7, 0.4]
    side = rng.integers(0, 3, n)
    box[np.arange(n), side] = np.sign(box[np.arange(n), side]) * np.array([1.0, 0.7, 0.4])[side]
    ball = rng.normal(size=(n // 4, 3))
    ball = 0.35 * ball / np.linalg.norm(ball, axis=1, keepdims=True) + [0.6, 0.3, 0.6]
    angle, along = rng.uniform(0, 2 * np.pi, n // 4), rng.uniform(0, 1.2, n // 4)
    rod = np.column_stack([-0.6 + 0.12 * np.cos(angle), -0.3 + 0.12 * np.sin(angle), 0.4 + along])
    return np.vstack([box, ball, rod])


def pair(rng, make=hill, T=SMALL, noise=0.002):
    """Two samples of one surface, each with its own points and noise."""
    target, source = transform_points(T, make(rng)), make(rng)
    return target + noise * rng.normal(size=target.shape), source + noise * rng.normal(size=source.shape)


def assert_near(found, T, angle=0.004, shift=0.004):
    off = np.linalg.inv(T) @ found.T_target_source
    assert rotation_angle(off[:-1, :-1]) < angle
    assert np.linalg.norm(off[:-1, -1]) < shift


def test_two_samples_of_a_surface_are_aligned(rng):
    found = register(*pair(rng))
    assert found.state == "converged"
    assert found.stage == "local"
    assert found.certificate.holds
    assert found.overlap > 0.9
    assert not found.unobservable
    assert found.inliers.mean() > 0.9
    assert len(found.energies) == len(found.path) > 3
    assert_near(found, SMALL)


def test_any_number_of_passes_gives_an_answer(rng):
    """Also where the last one is the one on which the search at any distance comes to rest."""
    far = make_transform(exp_rotation([0.15, -0.1, 0.2]), [0.5, -0.4, 0.3])
    target, source = pair(rng, T=far)
    for n in range(1, 14):
        found = register(target, source, stages=("local",), settings=LoopSettings(max_iterations=n))
        assert np.isfinite(found.T_target_source).all(), n


def test_threads_change_nothing(rng):
    target, source = pair(rng)
    one, two = (register(target, source, n_threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.T_target_source, two.T_target_source)
    np.testing.assert_array_equal(one.covariance, two.covariance)


def test_answer_moves_with_the_frames(rng):
    target, source = pair(rng)
    S = make_transform(np.eye(3), [3e5, -2e5, 100.0])
    shifted = register(transform_points(S, target), transform_points(S, source)).T_target_source
    np.testing.assert_allclose(np.linalg.inv(S) @ shifted @ S, register(target, source).T_target_source, atol=1e-4)


def test_global_stage_finds_any_rotation(rng):
    T = make_transform(random_rotation(rng), rng.normal(size=3))
    found = register(*pair(rng, figure, T))
    assert found.stage == "global"
    assert_near(found, T, 0.01, 0.01)


@pytest.mark.parametrize("seed", [3, 4])
def test_parts_of_a_body_that_share_two_fifths_are_found_and_believed(seed):
    rng = np.random.default_rng(seed)

    def body(n):
        d = rng.normal(size=(n, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        radius = 1 + 0.25 * np.sin(3 * d[:, 0] + 1) * np.cos(4 * d[:, 1]) + 0.15 * np.sin(5 * d[:, 2] + 0.5 * d[:, 0])
        return d * radius[:, None] * [1.0, 0.8, 0.6]

    cut = np.array([0.8, 0.6, 0.0])
    one, other = body(8000), body(8000)
    one, other = one[one @ cut <= np.quantile(one @ cut, 0.62)], other[other @ cut >= np.quantile(other @ cut, 0.38)]
    truth = make_transform(exp_rotation([1.2, -1.5, 0.8]), [0.4, -0.3, 0.2])
    target = transform_points(truth, one) + 0.005 * rng.normal(size=one.shape)
    found = register(target, other + 0.005 * rng.normal(size=other.shape))
    off = transform_points(found.T_target_source, other) - transform_points(truth, other)
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.02
    assert found.converged


def test_start_is_used(rng):
    T = make_transform(random_rotation(rng), rng.normal(size=3))
    near = T @ make_transform(exp_rotation([0.05, 0.0, 0.05]), [0.03, 0.0, 0.0])
    found = register(*pair(rng, figure, T), start=near, stages=("local",))
    assert_near(found, T, 0.01, 0.01)


def test_the_same_samples_are_aligned_to_the_last_digits(rng):
    points = hill(rng)
    grown = make_transform(1.04 * exp_rotation([0.02, 0.03, 0.1]), [0.1, 0.0, 0.05])
    found = register(transform_points(grown, points), points, model="similarity")
    np.testing.assert_allclose(found.T_target_source, grown, atol=1e-10)
    np.testing.assert_allclose(found.scale, 1.04, atol=1e-10)


def test_plane_reports_three_directions_and_stays_at_the_start_along_them(rng):
    def plane(r):
        return np.column_stack([r.uniform(-1, 1, size=(4000, 2)), np.zeros(4000)])

    T = make_transform(exp_rotation([0.05, 0.03, 0.0]), [0.0, 0.0, 0.1])
    found = register(*pair(rng, plane, T), stages=("local",))
    assert len(found.unobservable) == 3
    assert np.isinf(np.diag(found.covariance)).any()
    moved = transform_points(found.T_target_source, plane(rng))
    normal = T[:3, 2]
    assert np.abs(moved @ normal - T[:3, 3] @ normal).max() < 0.005
    assert np.abs(found.T_target_source[:2, 3]).max() < 0.1


def test_features_lead_where_surfaces_do_not_tell(rng):
    def plane(r):
        return np.column_stack([r.uniform(-1, 1, size=(4000, 2)), np.zeros(4000)])

    T = make_transform(exp_rotation([0.05, 0.03, 0.3]), [0.2, -0.1, 0.1])
    f = np.column_stack([rng.uniform(-1, 1, size=(40, 2)), np.zeros(40)])
    g = transform_points(T, f) + 0.01 * rng.normal(size=f.shape)
    g[:8] = rng.uniform(-1, 1, size=(8, 3))  # wrong matches
    found = register(*pair(rng, plane, T), matches=(g, f), stages=("local",))
    assert not found.unobservable
    assert_near(found, T, 0.02, 0.02)


@pytest.mark.parametrize("angle", [0.1, 2.0])
def test_scans_in_the_plane(rng, angle):
    def outline(r):
        s = r.uniform(0, 2 * np.pi, 3000)
        radius = 1 + 0.3 * np.cos(3 * s) + 0.15 * np.sin(2 * s)
        return np.column_stack([radius * np.cos(s), radius * np.sin(s)])

    T = make_transform(exp_rotation([angle]), [0.05, -0.04])
    found = register(*pair(rng, outline, T))
    assert found.T_target_source.shape == (3, 3)
    assert_near(found, T, 0.005, 0.005)


def test_images_are_aligned_by_their_edges():
    rows, columns = np.mgrid[:120, :160].astype(float)

    def scene(x, y):
        return np.tanh(20 * (np.sin(x / 11) + np.cos(y / 9 + x / 40) - 0.3))

    found = register(scene(columns, rows), scene(columns + 2.3, rows - 1.6))
    np.testing.assert_allclose(found.T_target_source, make_transform(np.eye(2), [2.3, -1.6]), atol=0.1)


def test_constraints_hold(rng):
    found = register(*pair(rng), constraints=Constraints(rotation=(0, 0, None), translation=(None, None, 0.02)))
    np.testing.assert_allclose(found.T_target_source[2, :3], [0, 0, 1], atol=1e-9)
    assert found.certificate is None


@pytest.mark.parametrize("given", [False, True])
def test_a_translation_never_turns_whatever_a_search_finds(rng, given):
    # scans that a rotation alone would bring together: poses of features and of shape all turn
    T = make_transform(exp_rotation([0.1, 0.2, 1.0]), [0.3, 0.1, 0.1])
    f = hill(rng, 300)
    matches = (transform_points(T, f), f) if given else None
    found = register(*pair(rng, T=T), model="translation", matches=matches)
    np.testing.assert_array_equal(found.T_target_source[:3, :3], np.eye(3))
    moved = register(f + 0.4, f, model="translation", stages=("global", "polish"))
    np.testing.assert_allclose(moved.T_target_source, make_transform(np.eye(3), [0.4, 0.4, 0.4]), atol=1e-6)


def test_symmetric_option_agrees(rng):
    target, source = pair(rng)
    both = register(target, source, settings=LoopSettings(symmetric=True))
    assert_near(both, SMALL)


def test_a_loop_of_no_passes_is_refused(rng):
    with pytest.raises(ParameterError, match=r"settings\.max_iterations is 0; expected a whole number in \[1, "):
        register(*pair(rng), settings=LoopSettings(max_iterations=0))


def test_threads_that_cannot_be_are_refused_by_name(rng):
    with pytest.raises(ParameterError, match=r"settings\.n_threads is 0; expected .* \[1, 256\]"):
        register(*pair(rng), settings=LoopSettings(n_threads=0))
    with pytest.raises(ParameterError, match=r"n_threads is 1\.5; expected a whole number"):
        register(*pair(rng), n_threads=1.5)


def test_normals_and_weights_of_a_scan_are_used(rng):
    target, source = pair(rng)
    wrong = rng.uniform(size=len(target)) < 0.3
    target[wrong, 2] += 0.08
    weights = np.where(wrong, 0.0, 1.0)
    found = register(Scan.from_points(target, weights=weights), source, stages=("local",))
    assert_near(found, SMALL, 0.01, 0.01)
    slopes = Scan.from_points(hill(rng), np.tile([0.0, 0.0, 1.0], (6000, 1)))
    assert len(register(slopes, slopes, stages=("local",)).unobservable) == 3  # normals say: a plane


@pytest.mark.parametrize("moved", [False, True])
def test_a_thinned_and_a_filtered_copy_lie_where_their_samples_are_the_same(rng, moved):
    # trees above a hill: the ground alone has other surfaces, and coarse samples others than fine ones
    ground = hill(rng, 4000) * [3.0, 3.0, 1.0]
    trees = hill(rng, 4000) * [3.0, 3.0, 1.0] + np.column_stack([np.zeros((4000, 2)), rng.uniform(0.0, 0.8, 4000)])
    whole = np.vstack([ground, trees])
    T = make_transform(exp_rotation([0.0, 0.01, 0.02]), [0.01, -0.01, 0.005]) if moved else np.eye(4)
    for part in (ground, whole[::4]):
        found = register(transform_points(T, whole), part)
        np.testing.assert_allclose(found.T_target_source, T, atol=1e-9)


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_stray_points_far_off_change_nothing(rng, far):
    target, source = pair(rng)
    plain = register(target, source)
    stray = np.array([[far, 0.0, 0.0], [0.0, -far, far]])
    found = register(np.vstack([stray, target]), np.vstack([source, stray]))
    assert found.state == "converged"
    np.testing.assert_allclose(found.T_target_source, plain.T_target_source, atol=1e-3)
    assert len(found.inliers) == len(source) + 2
    assert not found.inliers[-2:].any()


def test_disjoint_scans_are_a_named_state(rng):
    source = hill(rng)
    settings = LoopSettings(wide_search=False)
    found = register(source + np.array([50.0, 0, 0]), source, stages=("local",), settings=settings)
    assert found.state == "no_overlap"
    assert not found.converged
    assert found.overlap == 0.0


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 2.0, 0.3)])
def test_points_on_one_line_are_refused_whatever_its_direction(rng, direction):
    line = np.outer(np.linspace(0.0, 1.0, 100), direction)
    with pytest.raises(GeometryError, match="source's points lie on one line"):
        register(hill(rng, 3000), line)


def test_refusals(rng):
    points = hill(rng, 100)
    bad = points.copy()
    bad[3, 1] = np.nan
    with pytest.raises(ShapeError, match="source has 1 rows with NaN"):
        register(points, bad)
    crowd = np.vstack([hill(rng, 2000), [[0.0, np.inf, 0.0]], hill(rng, 2000)])
    with pytest.raises(ShapeError, match="source has 1 rows with NaN"):
        register(points, crowd)
    with pytest.raises(ShapeError, match="empty"):
        register(points, np.zeros((0, 3)))
    with pytest.raises(GeometryError, match="at least 10"):
        register(points, points[:5])
    with pytest.raises(GeometryError, match="on one line"):
        register(np.outer(np.arange(50.0), [1, 2, 3]), points)
    with pytest.raises(GeometryError, match="coincide"):
        register(points, np.ones((20, 3)))
    with pytest.raises(ShapeError, match="3 dimensions and source 2"):
        register(points, points[:, :2])
    with pytest.raises(ShapeError, match=r"source has shape \(3, 100\); expected \(n, 3\)"):
        register(points, points.T)
    with pytest.raises(ParameterError, match="stages"):
        register(points, points, stages=("best",))
    with pytest.raises(ParameterError, match="Drop alpha"):
        register(points, points, alpha=0.5)
    with pytest.raises(ParameterError, match="matches is a str"):
        register(points, points, matches="here")
    with pytest.raises(ParameterError, match="millionth"):
        register(points, points, voxel_size=1e-9)


def test_public_names():
    assert seismo3d.register is register
    assert seismo3d.Scan is Scan


def test_frames_without_given_matches_are_led_by_their_keypoints(rng):
    from seismo3d.experiments.rotated_frames import draw_room, rotate_frame

    pair = rotate_frame(draw_room(size=(180, 240)), 80.0, rng)
    found = register(pair.target, pair.source)
    assert found.stage == "global"
    assert_near(found, pair.T_target_source, 0.01, 0.02)


def test_images_turned_far_are_found_by_their_keypoints(rng):
    from scipy.ndimage import gaussian_filter, map_coordinates

    image = 255.0 * (gaussian_filter(rng.normal(size=(220, 220)), 3) > 0)
    image = gaussian_filter(image, 1.0)
    R = exp_rotation([1.2])
    columns, rows = np.meshgrid(np.arange(220.0), np.arange(220.0))
    places = np.stack([columns - 110, rows - 110], axis=-1) @ R.T + 110
    turned = map_coordinates(image, [places[..., 1], places[..., 0]], order=1, mode="nearest")
    found = register(image[:, :210], turned[:, :210])
    assert rotation_angle(found.T_target_source[:2, :2].T @ R) < 0.01
