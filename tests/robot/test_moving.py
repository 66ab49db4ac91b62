"""What moves leaves nothing in the map: whole surfaces are told apart, and what is seen through goes."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import exp_rotation
from seismo3d.robot import _kernels_carve as carving
from seismo3d.robot import _kernels_motion as kernels
from seismo3d.robot._kernels_frame import depth_sigma
from seismo3d.robot.frames import Measured, Measurer, MeasureSettings
from seismo3d.robot.mesh import extract_mesh
from seismo3d.robot.moving import MotionMemory, without
from seismo3d.robot.tsdf import SurfaceMap

LENS = PinholeCamera(130.0, 130.0, 79.5, 59.5)
POOL = ThreadPoolExecutor(2)


def vertices_of(z: np.ndarray) -> np.ndarray:
    out = np.zeros((*z.shape, 3), np.float32)
    out[:, :, 2] = z
    return out


def box_before_wall() -> np.ndarray:
    z = np.full((60, 80), 2.0)
    z[20:44, 30:54] = 1.0
    return z


def test_a_surface_moves_as_a_whole_where_a_part_of_it_is_seen_to() -> None:
    hints = np.zeros((60, 80), dtype=bool)
    hints[20:28, 30:38] = True  # a ninth of the box
    marked = np.zeros_like(hints)
    kernels.grow_marked(vertices_of(box_before_wall()), hints, 0.1, 0.45, marked)
    np.testing.assert_array_equal(marked, box_before_wall() == 1.0)
    marked[:] = False
    kernels.grow_marked(vertices_of(box_before_wall()), hints, 0.12, 0.45, marked)
    assert not marked.any()  # too little of it
    hints[:] = False
    hints[:, :20] = True
    kernels.grow_marked(vertices_of(box_before_wall()), hints, 0.1, 0.45, marked)
    assert not marked.any()  # a wall that fills the view is no mover


def test_what_an_earlier_image_saw_through_is_marked(rng: np.random.Generator) -> None:
    """Against the definition, vertex by vertex."""
    depth_before = np.where(rng.random((60, 80)) < 0.1, 0.0, rng.uniform(1.0, 3.0, (60, 80))).astype(np.float32)
    depth_before[20:50, 10:60] = 3.0
    vertices = vertices_of(np.where(rng.random((60, 80)) < 0.1, 0.0, rng.uniform(1.0, 3.0, (60, 80))))
    R, t = exp_rotation([0.02, -0.1, 0.05]), np.array([0.05, -0.1, 0.02])
    R_before, t_before, lens = (
        exp_rotation([0.0, 0.05, 0.0]),
        np.array([0.0, 0.1, 0.1]),
        np.array([70.0, 71.0, 39.5, 29.5]),
    )
    marked = np.zeros((60, 80), dtype=bool)
    kernels.mark_intruders(vertices, R, t, depth_before, R_before, t_before, lens, marked)
    expected = np.zeros((60, 80), dtype=bool)
    for r in range(0, 59, 2):
        for c in range(0, 79, 2):
            x, y, z = R_before.T @ (R @ vertices[r, c].astype(float) + t - t_before)
            if vertices[r, c, 2] <= 0.0 or z < 0.1:
                continue
            column, row = round(lens[0] * x / z + lens[2]), round(lens[1] * y / z + lens[3])
            if 1 <= column < 79 and 1 <= row < 59:
                around = depth_before[row - 1 : row + 2, column - 1 : column + 2]
                if (around > z + 0.06 + 5.0 * depth_sigma(z)).all():
                    expected[r : r + 2, c : c + 2] = True
    np.testing.assert_array_equal(marked, expected)
    assert 0.02 < marked.mean() < 0.5


def test_thin_marks_are_no_hint() -> None:
    marked = np.zeros((60, 80), dtype=bool)
    marked[10:14] = True  # an edge that is off by two pixels
    marked[30:50, 30:50] = True
    solid = kernels.erode_marked(marked, 2)
    assert not solid[:30].any()
    np.testing.assert_array_equal(np.argwhere(solid).min(axis=0), [34, 34])
    np.testing.assert_array_equal(np.argwhere(solid).max(axis=0), [45, 45])
    assert kernels.erode_marked(np.ones((60, 80), dtype=bool), 2).all()


def measured_of(depth: np.ndarray) -> Measured:
    return Measurer(LENS, MeasureSettings(), POOL).measured(depth.astype(np.float32), np.zeros((0, 0, 3), np.uint8))


def watched(step: float, *, frames: int = 40) -> list[np.ndarray]:
    """What is said to move, frame by frame, of a box that goes away from the camera before a wall."""
    memory, marks = MotionMemory(), []
    for number in range(frames):
        depth = np.full((120, 160), 3.0)
        depth[40:80, 60:100] = 1.0 + step * number
        measured = measured_of(depth)
        marks.append(memory.watch(measured, LENS, np.eye(4)))
        fused = measured.pixels.reshape(120, 160) > 0
        assert not fused[:80, :120].reshape(40, 2, 60, 2).any(axis=(1, 3))[marks[-1][:40, :60]].any()
    return marks


def test_what_goes_away_is_told_by_the_place_that_it_leaves() -> None:
    box = np.zeros((60, 80), dtype=bool)
    box[20:40, 30:50] = True
    marks = watched(0.02)
    assert all((mark[box]).all() for mark in marks[20:])  # nothing came to a place that was free: it left one
    assert not any(mark[~box].any() for mark in marks)
    assert not any(mark.any() for mark in watched(0.0))


def test_depth_without_what_moves() -> None:
    depth, moving = np.ones((7, 9), np.float32), np.zeros((3, 4), dtype=bool)
    assert without(depth, moving) is depth
    moving[1, 2] = True
    left = without(depth, moving)
    np.testing.assert_array_equal(np.argwhere(left == 0.0), [[2, 4], [2, 5], [3, 4], [3, 5]])
    assert (depth == 1.0).all()


def test_what_later_frames_see_through_is_gone_and_the_rest_stays() -> None:
    wall = np.full((120, 160), 2.0)
    with_box = wall.copy()
    with_box[40:80, 60:100] = 1.2
    surface = SurfaceMap(0.02, 0.08)
    for depth in [with_box] * 12:
        surface.fuse(measured_of(depth), LENS, np.eye(4), carve=True, pool=POOL, n_threads=2)
    z = extract_mesh(surface).points[:, 2]
    n_box = int((z < 1.6).sum())
    assert n_box > 200
    for _ in range(4):  # as many frames as it takes, whatever the weight of what was there
        surface.fuse(measured_of(wall), LENS, np.eye(4), carve=True, pool=POOL, n_threads=2)
    points = extract_mesh(surface).points
    # only its rim, which the pixels around don't see through, may be left
    assert (points[:, 2] < 1.6).sum() < 0.02 * n_box
    np.testing.assert_allclose(points[points[:, 2] > 1.6, 2], 2.0, atol=0.01)
    # without carving it would have stayed
    kept = SurfaceMap(0.02, 0.08)
    for depth in [with_box] * 12 + [wall] * 4:
        kept.fuse(measured_of(depth), LENS, np.eye(4), pool=POOL, n_threads=2)
    assert (extract_mesh(kept).points[:, 2] < 1.6).sum() > 0.5 * n_box


def test_a_thin_thing_is_not_seen_through_beside_it() -> None:
    depth = np.full((40, 50), 3.0, np.float32)
    depth[:, 25] = 1.0
    depth[7, 7] = 0.0
    free = carving.nearest_around(depth)
    assert free.shape == (20, 25)
    np.testing.assert_array_equal(free[6:19, 11:14], 1.0)  # columns 22 to 27
    np.testing.assert_array_equal(free[6:19, 14:24], 3.0)
    np.testing.assert_array_equal(free[2:5, 2:5], 0.0)  # unknown is not free
    np.testing.assert_array_equal(free[:, :1], 0.0)


def test_blocks_behind_the_surface_are_left_out() -> None:
    lens = np.array([130.0, 130.0, 79.5, 59.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    farthest = carving.farthest_tiles(np.full(120 * 160, 2.0, np.float32), 120, 160)
    coordinates = np.array([[0, 0, z] for z in (3, 6, 11, 12, 20)] + [[40, 0, 6]], dtype=np.int32)
    seen = carving.blocks_before(0, 6, coordinates, 0.16, np.eye(3), np.zeros(3), lens, 0, farthest, 0.16)
    assert seen.tolist() == [0, 1, 2]
