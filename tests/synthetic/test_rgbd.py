from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import cv2
import numba
import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import exp_rotation, invert_transform, rotation_from_quaternion, transform_points
from seismo3d.scan import Scan
from seismo3d.synthetic import _kernels_render as k
from seismo3d.synthetic._kernels_depth import measure_colour, measure_depth
from seismo3d.synthetic.rgbd import NOISE_FREE, DepthNoise, rgbd_sequence
from seismo3d.synthetic.rooms import Scene, ball, box, shape_row

SMALL = (160, 120)


def points_of(frame, camera):
    """World points of the exact depth, (rows, columns, 3)."""
    grid = camera.back_project(frame.true_depth)
    return transform_points(frame.T_world_camera, grid.reshape(-1, 3)).reshape(grid.shape)


def trace(rows, T, *, size=SMALL):
    """Exact depth, incidence and owner of what a camera sees of a few shapes."""
    camera = PinholeCamera(130.0, 130.0, (size[0] - 1) / 2, (size[1] - 1) / 2, (), 1.0, *size)
    grid = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)
    rays = np.ascontiguousarray(camera.rays(grid.astype(float)).reshape(size[1], size[0], 2))
    rays.flags.writeable = False
    empty, tiles = np.zeros((0, 0)), np.zeros((0, 0, 2))
    empty.flags.writeable = tiles.flags.writeable = False
    depth, facing, owner, paint = (
        np.empty(size[::-1] + s, t) for s, t in (((), "f8"), ((), "f8"), ((), "i4"), ((3,), "f8"))
    )
    k.render(
        rays, T, np.array(rows), empty, (0.0, 0.0, 1.0), tiles, (0.0,) * 4, (0.0, 0.0, 1.0), 1 / 130.0, depth, facing,
        paint, owner,
    )  # fmt: skip
    return camera, depth, facing, owner


FORWARD_X = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def test_a_wall_and_a_ball_have_the_depths_that_they_must_have():
    wall, sphere = box([3.25, 0.0, 0.0], [0.25, 9.0, 9.0]), ball([1.5, 0.0, 0.0], 0.5)
    camera, depth, facing, owner = trace([wall, sphere], FORWARD_X)
    assert set(np.unique(owner)) == {0, 1}
    np.testing.assert_allclose(depth[owner == 0], 3.0, atol=1e-12)
    middle = camera.back_project(depth)[59:61, 79:81].reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(middle - [0.0, 0.0, 1.5], axis=1), 0.5, atol=1e-12)
    x, y = (np.array([0.0, 0.0]) - [camera.cx, camera.cy]) / 130.0
    assert facing[0, 0] == pytest.approx(1.0 / np.sqrt(1.0 + x * x + y * y))


def test_a_turned_box_is_hit_where_its_planes_are():
    R = exp_rotation([0.3, 0.5, -0.7])
    row = shape_row(k.BOX, [2.0, 0.1, -0.1], [0.4, 0.3, 0.2], R, [90, 90, 90], 3)
    camera, depth, _, owner = trace([row], FORWARD_X)
    assert (owner == k.SKY).any()
    assert np.isnan(depth[owner == k.SKY]).all()
    p = transform_points(FORWARD_X, camera.back_project(depth)[owner == 0])
    reach = np.abs((p - [2.0, 0.1, -0.1]) @ R) / [0.4, 0.3, 0.2]
    np.testing.assert_allclose(reach.max(axis=1), 1.0, atol=1e-9)
    assert (owner == 0).sum() > 500


@pytest.mark.parametrize("kind", ["room", "terrain"])
def test_exact_depth_lies_on_the_surface_and_the_ground(kind):
    sequence = rgbd_sequence(kind, frames=300, size=SMALL, noise=NOISE_FREE, seed=4)
    for number in (0, 140, 299):
        points = points_of(sequence[number], sequence.camera)
        seen = points[np.isfinite(points[:, :, 2])]
        assert len(seen) > 0.9 * SMALL[0] * SMALL[1]
        away = sequence.scene.distance_to_surface(seen)
        assert away.max() < 2e-6  # depth is float32
        lifted = sequence.scene.distance_to_surface(seen + np.array([0.0, 0.0, 0.01]))
        assert lifted.max() < 0.0101
        if kind == "terrain":
            height = sequence.scene.ground_height(seen[:, :2])
            assert np.mean(np.abs(height - seen[:, 2]) < 1e-5) > 0.97  # all but the undersides of boulders
            assert (seen[:, 2] - height).max() < 1e-4  # steep at a boulder's rim


def test_relief_is_met_first_where_a_dense_march_meets_it():
    sequence = rgbd_sequence("terrain", frames=300, size=(32, 24), noise=NOISE_FREE, seed=9)
    scene = replace(sequence.scene, shapes=np.zeros((0, k.N_COLUMNS)))
    bare = replace(sequence, scene=scene)
    for number in (10, 200):
        frame = bare[number]
        origin, R = frame.T_world_camera[:3, 3], frame.T_world_camera[:3, :3]
        steps = np.arange(0.0, 9.0, 0.002)
        rays = np.dstack([bare._rays, np.ones(bare._rays.shape[:2])]).reshape(-1, 3) @ R.T
        for ray, depth in zip(rays[::7], frame.true_depth.ravel()[::7], strict=True):
            p = origin + steps[:, None] * ray
            under = np.flatnonzero(p[:, 2] < scene.ground_height(p[:, :2]))
            if len(under) and np.abs(p[under[0], :2]).max() < 13.0:
                assert depth == pytest.approx(steps[under[0]], abs=0.00201)


@pytest.mark.parametrize("kind", ["room", "terrain"])
def test_two_frames_see_the_same_points_in_the_same_colours(kind):
    sequence = rgbd_sequence(kind, frames=60, size=(320, 240), noise=NOISE_FREE)
    first, second = sequence[0], sequence[12]
    points = points_of(first, sequence.camera)
    inside = transform_points(invert_transform(second.T_world_camera), points.reshape(-1, 3))
    pixels = sequence.camera.project(inside)
    nearest = np.round(pixels)
    ok = (np.abs(pixels - nearest) < 0.1).all(axis=1) & (nearest >= 0).all(axis=1) & (nearest < [320, 240]).all(axis=1)
    column, row = nearest[ok].astype(int).T
    depth = second.true_depth[row, column]
    same = np.abs(depth - inside[ok, 2]) < 0.01
    assert ok.sum() > 1000
    assert same.mean() > 0.9  # the others are hidden in one of the two
    a = first.colour.reshape(-1, 3)[ok][same].astype(float)
    b = second.colour[row, column][same].astype(float)
    assert np.corrcoef(a.ravel(), b.ravel())[0, 1] > 0.97
    assert a.std() > 25.0


def test_images_have_detail_at_all_scales():
    frame = rgbd_sequence("room", frames=1, noise=NOISE_FREE)[0]
    grey = frame.colour.mean(axis=2).astype(np.float32)
    for size in (1, 2, 4, 8, 16, 32):
        fine, coarse = (cv2.GaussianBlur(grey, (0, 0), s) for s in (size, 2 * size))
        assert (fine - coarse).std() > 3.0
    assert len(cv2.ORB_create(2000).detect(grey.astype(np.uint8))) > 1500


@pytest.mark.parametrize("depth", [1.0, 2.0, 4.0])
def test_noise_grows_with_the_square_of_depth(depth):
    noise = DepthNoise()
    exact = np.full((240, 320), depth)
    measured = np.empty((240, 320), np.float32)
    measure_depth(exact, np.ones_like(exact), noise.settings(), 12345, measured)
    held = np.isfinite(measured)
    assert held.mean() == pytest.approx(1.0 - noise.lost, abs=0.002)
    expected = depth**2 / noise.throw * np.sqrt(noise.sigma**2 + noise.step**2 / 12)
    assert measured[held].std() == pytest.approx(expected, rel=0.12)  # the steps beat against the depth
    assert measured[held].mean() == pytest.approx(depth, abs=0.35 * expected)
    steps = np.unique(np.round(noise.throw / measured[held].astype(float) / noise.step, 3))
    np.testing.assert_allclose(steps, np.round(steps), atol=2e-3)


def test_the_sensor_loses_shadows_edges_slants_and_what_is_too_far():
    wall, plate = box([3.25, 0.0, 0.0], [0.25, 9.0, 9.0]), box([1.05, 0.0, 0.0], [0.05, 0.2, 0.2])
    _, exact, facing, owner = trace([wall, plate], FORWARD_X)
    plain = replace(NOISE_FREE, throw=40.0)
    out = np.empty(exact.shape, np.float32)
    measure_depth(exact, facing, plain.settings(), 1, out)
    row = exact.shape[0] // 2
    left = np.flatnonzero(owner[row] == 1)[0]
    shadow = np.flatnonzero(np.isnan(out[row]))
    width = 40.0 * (1.0 / 1.0 - 1.0 / 3.0)
    assert shadow.max() == left - 1
    assert len(shadow) == pytest.approx(width, abs=2.0)
    np.testing.assert_allclose(out[np.isfinite(out)], exact[np.isfinite(out)], rtol=1e-6)

    measure_depth(exact, facing, replace(plain, greatest=2.0).settings(), 1, out)
    assert np.isnan(out[owner == 0]).all()
    measure_depth(exact, np.full_like(facing, 0.1), replace(plain, blind=0.12, clear=0.3).settings(), 1, out)
    assert np.isnan(out).all()
    measure_depth(exact, facing, replace(plain, throw=1e-6, jump=0.03, lost_edges=1.0).settings(), 1, out)
    lost = np.isnan(out)
    edges = cv2.dilate((owner == 1).astype(np.uint8), np.ones((3, 3))) - cv2.erode(
        (owner == 1).astype(np.uint8), np.ones((3, 3))
    )
    assert lost.any()
    assert not lost[edges == 0].any()


def test_colour_noise_has_the_spread_asked_for():
    out = np.empty((200, 200, 3), np.uint8)
    measure_colour(np.full((200, 200, 3), 128.0), 3.0, 77, out)
    assert out.std() == pytest.approx(np.hypot(3.0, np.sqrt(1 / 12)), rel=0.02)
    assert out.mean() == pytest.approx(128.0, abs=0.05)
    assert np.abs(np.corrcoef(out.reshape(-1, 3).T) - np.eye(3)).max() < 0.02


@pytest.mark.parametrize("kind", ["room", "terrain"])
def test_the_way_is_smooth_and_comes_back_to_its_start(kind):
    sequence = rgbd_sequence(kind, frames=1000, size=SMALL)
    poses = sequence.poses
    np.testing.assert_allclose(poses[900], poses[0], atol=1e-9)
    step = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    turn = np.degrees([np.arccos((np.trace(a[:3, :3].T @ b[:3, :3]) - 1) / 2) for a, b in pairwise(poses)])
    assert step.max() < 0.05
    assert turn.max() < 1.5
    assert np.abs(np.diff(poses[:, :3, 3], n=2, axis=0)).max() < 0.002
    assert 5.0 < sequence.path_length < 40.0
    again = (sequence[900].true_depth, sequence[0].true_depth)
    np.testing.assert_allclose(*again, atol=1e-5)
    for R in poses[::97, :3, :3]:
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) > 0
        assert R[2, 1] < 0  # the image's rows run downwards


@pytest.mark.parametrize("moving", ["sphere", "box"])
def test_something_crosses_the_view(moving):
    sequence = rgbd_sequence(
        "room", frames=31, size=SMALL, moving=moving, moving_share=0.3, moving_span=(0.2, 0.8), seed=2
    )
    still = rgbd_sequence("room", frames=31, size=SMALL, seed=2)
    shares = np.array([frame.moving.mean() for frame in sequence])
    assert not shares[:6].any()
    assert not shares[24:].any()
    assert (0.24 if moving == "sphere" else 0.12) < shares.max() <= 0.3
    frame, bare = sequence[15], still[15]
    assert (frame.true_depth[frame.moving] < bare.true_depth[frame.moving]).all()
    np.testing.assert_array_equal(frame.true_depth[~frame.moving], bare.true_depth[~frame.moving])
    centres = [np.mean(np.nonzero(f.moving)[1]) for f in sequence if f.moving.mean() > 0.1]
    assert (np.diff(centres) > 0).all()


def test_blackout_empties_both_images():
    sequence = rgbd_sequence("room", frames=12, size=SMALL, rate=10.0, blackout=(0.35, 0.75))
    empty = [not frame.colour.any() and np.isnan(frame.depth).all() for frame in sequence]
    assert empty == [0.35 <= n / 10 < 0.75 for n in range(12)]


def test_same_seed_same_frames_whatever_the_threads():
    def frames(seed, number=5):
        frame = rgbd_sequence("room", frames=10, size=SMALL, seed=seed)[number]
        return frame.colour, frame.depth

    before = numba.get_num_threads()
    first = frames(3)
    numba.set_num_threads(1)
    try:
        alone = frames(3)
    finally:
        numba.set_num_threads(before)
    for a, b in zip(first, alone, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first[0], frames(4)[0])
    noise = [np.isnan(frames(3, n)[1]) for n in (5, 6)]
    assert not np.array_equal(*noise)
    assert rgbd_sequence("room", frames=3, size=SMALL)[-1].stamp == pytest.approx(1000.0 + 2 / 30)
    with pytest.raises(IndexError):
        rgbd_sequence("room", frames=3, size=SMALL)[3]


def test_written_sequence_holds_the_same_and_says_where_the_camera_was(tmp_path):
    sequence = rgbd_sequence("terrain", frames=4, size=SMALL, seed=1)
    shares = []
    folder = sequence.write(tmp_path / "walk", progress=lambda _stage, share: shares.append(share))
    assert shares == [0.25, 0.5, 0.75, 1.0]
    lines = [line.split() for line in (folder / "associations.txt").read_text().splitlines()]
    truth = np.loadtxt(folder / "groundtruth.txt")
    camera = PinholeCamera(
        **{k: tuple(v) if k == "distortion" else v for k, v in json.loads((folder / "camera.json").read_text()).items()}
    )
    assert camera.depth_scale == 5000.0
    for frame, (stamp, rgb, depth_stamp, depth), row in zip(sequence, lines, truth, strict=True):
        assert float(stamp) == float(depth_stamp) == pytest.approx(frame.stamp, abs=1e-6)
        np.testing.assert_array_equal(cv2.imread(str(folder / rgb))[:, :, ::-1], frame.colour)
        values = cv2.imread(str(folder / depth), cv2.IMREAD_UNCHANGED)
        assert values.dtype == np.uint16
        np.testing.assert_array_equal(values == 0, np.isnan(frame.depth))
        np.testing.assert_allclose(values / 5000.0, np.nan_to_num(frame.depth), atol=1.01e-4)
        np.testing.assert_allclose(row[1:4], frame.T_world_camera[:3, 3], atol=1e-8)
        np.testing.assert_allclose(rotation_from_quaternion(row[[7, 4, 5, 6]]), frame.T_world_camera[:3, :3], atol=1e-8)
    frame = sequence[0]
    scan = Scan.from_rgbd(frame.colour, frame.depth, sequence.camera)
    assert sequence.scene.distance_to_surface(transform_points(frame.T_world_camera, scan.points)).mean() < 0.01


def test_a_bent_lens_sees_the_same_room():
    lens = PinholeCamera(130.0, 131.0, 80.0, 58.0, (0.2, -0.3, 0.002, -0.001), 1.0, *SMALL)
    sequence = rgbd_sequence("room", frames=2, camera=lens, noise=NOISE_FREE)
    points = points_of(sequence[0], lens).reshape(-1, 3)
    assert sequence.scene.distance_to_surface(points).max() < 2e-6


def test_distances_to_boxes_and_balls_are_exact():
    empty = np.zeros((0, 0))
    rows = np.array([box([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]), ball([5.0, 0.0, 0.0], 0.5)])
    scene = Scene(rows, empty, (0.0, 0.0, 1.0), (0.0,) * 4, (0.0, 0.0, 1.0), np.zeros((0, 0, 2)))
    points = [[2.0, 0.0, 0.0], [0.9, 0.0, 0.0], [2.0, 2.0, 2.0], [5.0, 0.0, 0.0], [5.0, 0.0, 1.5]]
    np.testing.assert_allclose(scene.distance_to_surface(points), [1.0, 0.1, np.sqrt(3.0), 0.5, 1.0])
    np.testing.assert_allclose(scene.ground_height([[0.5, 0.5], [5.0, 0.0], [3.0, 0.0]]), [1.0, 0.5, np.nan])


def test_refusals():
    with pytest.raises(ParameterError, match="kind is 'cave'; expected 'room' or 'terrain'"):
        rgbd_sequence("cave")
    with pytest.raises(ParameterError, match="moving is 'cat'"):
        rgbd_sequence("room", moving="cat")
    with pytest.raises(ParameterError, match="frames is 0"):
        rgbd_sequence("room", frames=0)
    with pytest.raises(ParameterError, match=r"blackout is \(2, 1\); expected a start before its end"):
        rgbd_sequence("room", blackout=(2.0, 1.0))
    with pytest.raises(ParameterError, match="depth_scale 5000"):
        rgbd_sequence("room", camera=PinholeCamera(500, 500, 320, 240, (), 5000.0, 640, 480))
