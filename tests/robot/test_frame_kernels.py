"""Kernels of measuring and fusing against plain numpy."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import exp_rotation, make_transform
from seismo3d.robot import _kernels_carve as carving
from seismo3d.robot import _kernels_frame as frames
from seismo3d.robot import _kernels_fuse as fusing
from seismo3d.robot import _kernels_shutter as shutter
from seismo3d.robot.camera import lens_numbers
from seismo3d.robot.frames import Measured, Measurer, MeasureSettings
from seismo3d.robot.tsdf import SurfaceMap, halved

LENS = PinholeCamera(130.0, 130.0, 79.5, 59.5, (0.1, -0.05, 0.001, -0.002))
POOL = ThreadPoolExecutor(2)
POSE = make_transform(exp_rotation([0.1, -0.2, 0.05]), [0.2, -0.1, 0.3])


def measured_room(rng: np.random.Generator) -> Measured:
    """A wall with a step, with holes, noise and colours."""
    depth = np.full((120, 160), 1.6)
    depth[30:80, 50:110] = 1.1
    depth += 0.002 * rng.standard_normal(depth.shape)
    depth[rng.random(depth.shape) < 0.05] = 0.0
    colour = rng.integers(1, 255, (120, 160, 3)).astype(np.uint8)
    return Measurer(LENS, MeasureSettings(), POOL).measured(depth.astype(np.float32), colour)


def seen_by(surface: SurfaceMap, lens: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """Pixel (row, column; -1 outside) and depth of each voxel of a map."""
    voxel = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    at = (surface.coordinates[: surface.n_blocks, None] * 8 + voxel) * surface.voxel_size
    local = (at - POSE[:3, 3]) @ POSE[:3, :3]
    # to the nearest pixel of an image without distortion, then to the one with it
    straight = PinholeCamera(lens.fx, lens.fy, lens.cx, lens.cy)
    nearest = np.floor(straight.project(local.reshape(-1, 3)) + 0.5)
    ray = np.column_stack([(nearest - [lens.cx, lens.cy]) / [lens.fx, lens.fy], np.ones(len(nearest))])
    pixel = np.floor(lens.project(ray) + 0.5)
    outside = ~((pixel >= 0) & (pixel < [160, 120])).all(axis=1)
    rows_columns = np.where(outside[:, None], -1, pixel[:, ::-1]).astype(int).reshape(*at.shape[:2], 2)
    return rows_columns, local[:, :, 2]


def test_a_frame_is_fused_as_the_definition_says(rng: np.random.Generator) -> None:
    measured = measured_room(rng)
    surface = SurfaceMap(0.02, 0.08)
    surface.fuse(measured, LENS, POSE, pool=POOL, n_threads=2)
    n = surface.n_blocks
    pixel, z = seen_by(surface, LENS)
    number = pixel[..., 0] * 160 + pixel[..., 1]
    depth, slope, weight = (np.where(number >= 0, part[number], 0.0) for part in frames.unpack_pixels(measured.pixels))
    ahead = (depth - z) * slope
    taken = (weight > 0) & (ahead >= -0.08) & (depth - z >= -0.16)
    distance, held = surface.distances(slice(n)), surface.weights(slice(n))
    same = taken == (held > 0)
    assert same.mean() > 0.999  # where rounding decides on a pixel
    assert np.isnan(distance[~taken & same]).all()
    both = taken & same
    close = np.abs(distance[both] - np.minimum(ahead[both], 0.08)) < 1e-4
    assert close.mean() > 0.999
    root = np.abs(np.sqrt(held[both]) - np.sqrt(weight[both]))
    assert (root < 0.51 * np.sqrt(surface.heaviest) / 65535.0).mean() > 0.999  # it is rounded
    coloured = both & (np.abs(ahead) < 0.039)
    hue = measured.colour.reshape(-1, 3)[number[coloured]]
    assert (surface.colour[:n, :, :3][coloured] == hue).all(axis=1).mean() > 0.999
    assert not surface.colour[:n, :, 3].any()


def test_packed_pixels_say_what_the_definition_says(rng: np.random.Generator) -> None:
    """Depth, cosine between ray and normal over the ray's length at depth 1, information over that at a metre."""
    measured = measured_room(rng)
    depth, slope, weight = (part.reshape(120, 160) for part in frames.unpack_pixels(measured.pixels))
    trusted = measured.pixels.reshape(120, 160) > 0
    np.testing.assert_array_equal(depth > 0, trusted)
    assert 0.7 < trusted.mean() < 0.96
    r, c = np.nonzero(trusted)
    v, n = measured.vertices[r // 2, c // 2].astype(float), measured.normals[r // 2, c // 2].astype(float)
    along = -np.einsum("ij,ij->i", v, n)
    np.testing.assert_allclose(depth[r, c], measured.depth[r, c], atol=0.6 * frames.DEPTH_UNIT)
    np.testing.assert_allclose(slope[r, c], along / v[:, 2], atol=0.6 * frames.SLOPE_UNIT)
    sigma = np.array([frames.depth_sigma(z) / frames.depth_sigma(1.0) for z in v[:, 2]])
    expected = along / np.linalg.norm(v, axis=1) / sigma**2
    np.testing.assert_allclose(np.sqrt(weight[r, c]), np.sqrt(expected), atol=0.6 * frames.ROOT_UNIT)


def test_steady_blocks_take_fewer_frames_with_more_weight(rng: np.random.Generator) -> None:
    measured = measured_room(rng)
    often, once = SurfaceMap(0.02, 0.08), SurfaceMap(0.02, 0.08)
    once.fuse(measured, LENS, POSE, pool=POOL, n_threads=1)
    for _ in range(70):
        often.fuse(measured, LENS, POSE, pool=POOL, n_threads=2)
    n = often.n_blocks
    np.testing.assert_array_equal(often.keys[:n], once.keys[:n])
    ours, first = often.distances(slice(n)), once.distances(slice(n))
    np.testing.assert_allclose(ours, first, atol=1e-5)  # the same frame again and again
    weight, one = often.weights(slice(n)), once.weights(slice(n))
    shown = one > 0
    total = np.minimum(70.0 * one[shown], often.heaviest)
    # a block lacks what it has not been given yet, or has more of a round that has just begun: of eight at most
    few = 8.0 * one[shown] + 1e-3
    assert (np.abs(weight[shown] - total) < few).all()
    assert np.median(np.abs(weight[shown] - total) / total) < 0.08


def test_no_block_that_would_be_carved_is_left_out(rng: np.random.Generator) -> None:
    measured = measured_room(rng)
    surface = SurfaceMap(0.02, 0.08)
    surface.fuse(measured, LENS, POSE, pool=POOL, n_threads=1)
    near = Measurer(LENS, MeasureSettings(), POOL).measured(
        np.where(measured.depth > 0, 0.7, 0.0).astype(np.float32), np.zeros((0, 0, 3), np.uint8)
    )
    surface.fuse(near, LENS, POSE, pool=POOL, n_threads=1)
    n, R, t = surface.n_blocks, np.ascontiguousarray(POSE[:3, :3]), np.ascontiguousarray(POSE[:3, 3])
    half = halved(LENS)
    table = surface._pixel_table(half, (60, 80))
    lens, beyond = lens_numbers(half), carving.straighten_depth(table, carving.nearest_around(measured.depth))
    farthest = carving.farthest_tiles(beyond, *table.shape)
    seen = carving.blocks_before(0, n, surface.coordinates, surface.block_size, R, t, lens, 40, farthest, 0.16)
    rest = (R, t, lens, table.shape, 40, beyond, 0.08, surface.heaviest)
    maps = []
    for numbers in (seen, np.arange(n)):
        d, w = surface.distance.copy(), surface.root.copy()
        carving.carve_blocks(numbers, surface.coordinates, d, w, 0.02, *rest)
        maps.append((d[:n], w[:n]))
    np.testing.assert_array_equal(maps[0][0], maps[1][0])
    np.testing.assert_array_equal(maps[0][1], maps[1][1])
    assert (maps[0][1] != surface.root[:n]).any()
    assert len(seen) < 0.7 * n


@pytest.mark.parametrize("size", [(20, 24), (21, 27)])
def test_half_image_is_the_mean_of_one_surface(rng: np.random.Generator, size: tuple[int, int]) -> None:
    depth = (1.0 + 0.02 * rng.random(size) + (rng.random(size) < 0.3)).astype(np.float32)
    depth[rng.random(size) < 0.2] = 0.0
    rays = rng.normal(size=(*size, 2)).astype(np.float32)
    out = np.empty((size[0] // 2, size[1] // 2, 3), np.float32)
    frames.halve(0, len(out), depth, rays, 0.3, 4.0, 1.0, out)
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            four = np.sort(depth[2 * r : 2 * r + 2, 2 * c : 2 * c + 2].ravel())
            four = four[four > 0.3]
            expected = np.zeros(3)
            if len(four) > 1:
                middle = four[(len(four) - 1) // 2]
                around = np.s_[max(2 * r - 1, 0) : 2 * r + 3, max(2 * c - 1, 0) : 2 * c + 3]
                z, ray = depth[around].astype(float), rays[around].astype(float)
                kept = np.abs(z - middle) < 4.0 * frames.depth_sigma(middle)
                if kept.sum() >= 3:
                    z, ray = z[kept], ray[kept]
                    expected = np.array([(z * ray[:, 0]).mean(), (z * ray[:, 1]).mean(), z.mean()])
            np.testing.assert_allclose(out[r, c], expected, atol=1e-5)


def test_a_still_camera_changes_nothing(rng: np.random.Generator) -> None:
    measured = measured_room(rng)
    rays = Measurer(LENS, MeasureSettings(), POOL).rays((120, 160))
    place, moved = np.empty((120, 160), np.int32), np.empty((120, 160), np.float32)
    focal, v = np.array([130.0, 130.0], np.float32), measured.vertices
    shutter.move_rows(0, 120, measured.depth, rays, np.zeros(6), -0.015, 0.03 / 120, focal, place, moved)
    still = np.full_like(measured.depth, np.nan)
    shutter.splat_rows(place, moved, still)
    np.testing.assert_array_equal(still, measured.depth)
    hue = rng.integers(0, 256, (120, 160, 4)).astype(np.uint8)
    hue[rng.random((120, 160)) < 0.3] = 0
    pixels = measured.pixels & ~np.uint64(0xFFFFFF)
    shutter.colour_pixels(0, 60, hue.view(np.uint32)[:, :, 0], v, np.zeros(6), 0.01, 0.0, focal, pixels)
    seen = pixels > 0
    assert 0.7 < seen.mean() < 0.96
    np.testing.assert_array_equal(pixels >> np.uint64(24), measured.pixels >> np.uint64(24))
    red, green, blue = (((pixels >> np.uint64(8 * k)) & np.uint64(255)).reshape(120, 160) for k in range(3))
    expected = np.where(seen.reshape(120, 160, 1), np.maximum(hue[:, :, :3], 1), 0)
    np.testing.assert_array_equal(np.stack([red, green, blue], axis=-1), expected)


def test_a_turning_camera_is_undone_row_by_row() -> None:
    """A wall seen while the camera turns about the plumb axis: each row's pixels shift by its own time."""
    depth = np.full((120, 160), 2.0, np.float32)
    lens = PinholeCamera(130.0, 130.0, 79.5, 59.5)
    rays = Measurer(lens, MeasureSettings(), POOL).rays((120, 160))
    place, moved = np.empty((120, 160), np.int32), np.empty((120, 160), np.float32)
    twist, focal = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]), np.array([130.0, 130.0], np.float32)
    shutter.move_rows(0, 120, depth, rays, twist, -0.05, 0.1 / 120, focal, place, moved)
    for r in (0, 30, 90, 119):
        angle = -0.05 + r * 0.1 / 120
        c = 80
        x, z = 2.0 * rays[r, c, 0], 2.0
        turned = np.array([np.cos(angle) * x + np.sin(angle) * z, np.cos(angle) * z - np.sin(angle) * x])
        assert place[r, c] % 160 == np.floor(130.0 * turned[0] / turned[1] + 79.5 + 0.5)
        assert moved[r, c] == pytest.approx(turned[1], abs=2e-4)


def test_averages_are_those_of_whole_numbers_rounded_and_do_not_drift(rng: np.random.Generator) -> None:
    band, heaviest, n = 0.02, 200.0, 400
    distance, root = np.zeros(512, np.uint16), np.zeros(512, np.uint16)
    truth = rng.uniform(-0.9 * band, 0.9 * band, 512)
    total, mean = np.zeros(512), np.zeros(512)
    for _ in range(n):
        seen = np.clip(truth + 0.002 * rng.standard_normal(512), -band, band)
        weight = rng.uniform(0.0, 0.4, 512) * (rng.random(512) < 0.8)
        share = weight / np.maximum(total + weight, 1e-30)
        mean, total = mean + share * (seen - mean), np.minimum(total + weight, heaviest)
        before = distance.copy(), root.copy()
        fresh = weight.astype(np.float32)
        ahead = (32768.0 + seen / band * 32767.0).astype(np.float32)
        fusing.average(ahead, fresh, heaviest / 65535.0**2, distance, root)
        np.testing.assert_allclose(fresh, share, atol=2e-3)
        for held, old in zip((distance, root), before):
            np.testing.assert_array_equal(held[weight == 0.0], old[weight == 0.0])
    off = (distance.astype(float) - 32768.0) / 32767.0 * band - mean
    assert np.abs(off).max() < 2e-5  # a hundredth of the noise of one look
    assert abs(off.mean()) < 1e-6
    np.testing.assert_allclose((root / 65535.0) ** 2 * heaviest, total, rtol=2e-3)


def test_colours_are_mixed_by_their_share(rng: np.random.Generator) -> None:
    old, new = (rng.integers(1, 256, (512, 4)).astype(np.uint8) for _ in range(2))
    old[:, 3] = new[:, 3] = 0
    old[:50], new[40:90] = 0, 0
    share = rng.random(512).astype(np.float32)
    mixed = old.copy()
    fusing.blend_colours(share, new.view(np.uint32)[:, 0].copy(), mixed.view(np.uint32)[:, 0])
    expected = old + np.rint(share * 256.0)[:, None] / 256.0 * (new.astype(float) - old)
    expected[:40], expected[40:90] = new[:40], old[40:90]
    assert np.abs(mixed - expected).max() <= 0.5


@pytest.mark.parametrize("kind", [np.uint16, np.float32, np.float64])
def test_depth_is_read_in_metres_and_nothing_where_it_is_none(kind: type) -> None:
    raw = np.array([[0.0, 1500.0, 40.0, 65535.0]] * 3)
    if kind is not np.uint16:
        raw[1] = [np.nan, np.inf, -1.0, 2500.0]
    out = np.full((3, 4), np.nan, np.float32)
    frames.read_depth(0, 3, raw.astype(kind), 1000.0, out)
    expected = np.where(np.isfinite(raw) & (raw > 0.0), raw / 1000.0, 0.0)
    np.testing.assert_array_equal(out, expected.astype(np.float32))


def test_normals_are_those_of_the_differences_across(rng: np.random.Generator) -> None:
    grid = np.stack(np.meshgrid(np.arange(23), np.arange(17)), axis=-1).reshape(-1, 2).astype(float)
    rays = np.column_stack([PinholeCamera(20.0, 20.0, 11.0, 8.0).rays(grid), np.ones(len(grid))]).reshape(17, 23, 3)
    z = 1.5 + 0.1 * rng.random((17, 23)) * (rng.random((17, 23)) < 0.5)
    z[rng.random((17, 23)) < 0.1] = 0.0
    vertices, out = (rays * z[:, :, None]).astype(np.float32), np.full((17, 23, 3), np.nan, np.float32)
    count = frames.grid_normals(0, 17, vertices, 2, 0.004, 1.0, out)
    expected = np.zeros((17, 23, 3))
    for r in range(2, 15):
        for c in range(2, 21):
            around = [vertices[r, c - 2], vertices[r, c + 2], vertices[r - 2, c], vertices[r + 2, c]]
            limit = 8.0 * frames.depth_sigma(z[r, c]) + 0.05 * z[r, c]
            if z[r, c] > 0.0 and all(abs(v[2] - z[r, c]) < limit for v in around):
                normal = np.cross(around[1] - around[0], around[3] - around[2]).astype(float)
                normal /= np.linalg.norm(normal)
                expected[r, c] = normal if normal @ vertices[r, c] < 0.0 else -normal
    assert count == np.count_nonzero(expected[:, :, 2]) > 50
    np.testing.assert_allclose(out, expected, atol=2e-6)


@pytest.mark.parametrize("noise", [0.0, 0.5, 3.0, 5.0, 20.0])
def test_noise_is_measured_against_the_usual_sensors(noise: float, rng: np.random.Generator) -> None:
    columns, rows = np.meshgrid(np.arange(160.0), np.arange(120.0))
    depth = 1.5 / (1.0 + 0.002 * columns - 0.001 * rows)  # a slanting plane
    depth[30:70, 50:90] = 0.9  # with something before it
    depth += noise * frames.depth_sigma(depth) * rng.standard_normal(depth.shape)
    depth[rng.random(depth.shape) < 0.2] = 0.0
    found = frames.noise_of(depth.astype(np.float32), 0.3, 4.0)
    assert found == pytest.approx(min(max(noise, 1.0), 8.0), rel=0.15)
    assert frames.noise_of(np.zeros((120, 160), np.float32), 0.3, 4.0) == 1.0
