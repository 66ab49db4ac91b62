from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from seismo3d.geometry.camera import PinholeCamera
from seismo3d.robot import _kernels_blocks as blocks
from seismo3d.robot._kernels_raycast import sample_cell
from seismo3d.robot.camera import lens_numbers
from seismo3d.robot.frames import Measured, Measurer, MeasureSettings
from seismo3d.robot.mesh import extract_mesh
from seismo3d.robot.tsdf import SurfaceMap

LENS = PinholeCamera(130.0, 130.0, 79.5, 59.5)
POOL = ThreadPoolExecutor(2)


def measured_of(depth: np.ndarray, colour: np.ndarray | None = None, lens: PinholeCamera = LENS) -> Measured:
    empty = np.zeros((0, 0, 3), np.uint8)
    return Measurer(lens, MeasureSettings(), POOL).measured(
        depth.astype(np.float32), empty if colour is None else colour
    )


def hold(surface: SurfaceMap, number: int, distance: np.ndarray, weight: np.ndarray | float) -> None:
    """Give a block its voxels, by the definition of how they are held."""
    surface.distance[number] = np.rint(32768.0 + distance / surface.band * 32767.0)
    surface.root[number] = np.rint(65535.0 * np.sqrt(weight / surface.heaviest))


def tilted_plane(lens: PinholeCamera = LENS, shape: tuple[int, int] = (120, 160)) -> np.ndarray:
    """Depth of the plane z = 1 + 0.3 x, exactly, at each pixel."""
    grid = np.stack(np.meshgrid(np.arange(shape[1]), np.arange(shape[0])), axis=-1).reshape(-1, 2).astype(float)
    return (1.0 / (1.0 - 0.3 * lens.rays(grid)[:, 0])).reshape(shape)


def test_keys_unpack_to_their_coordinates(rng: np.random.Generator) -> None:
    xyz = rng.integers(-(1 << 19), 1 << 19, size=(50, 3))
    keys = np.array([blocks.pack(*row) for row in xyz])
    np.testing.assert_array_equal(blocks.unpack(keys), xyz)


def test_blocks_keep_their_numbers_while_the_table_grows(rng: np.random.Generator) -> None:
    surface = SurfaceMap(0.01, 0.04)
    keys = np.unique([blocks.pack(*row) for row in rng.integers(-40, 40, size=(36000, 3))])
    numbers = np.concatenate([surface.add_blocks(part) for part in np.array_split(rng.permutation(keys), 7)])
    assert surface.n_blocks == len(keys)
    np.testing.assert_array_equal(np.sort(numbers), np.arange(len(keys)))
    for number in rng.integers(0, len(keys), 20):
        assert surface.block_at(surface.coordinates[number]) == number
    assert surface.block_at(np.array([5000, 0, 0])) == -1


@pytest.mark.parametrize("distortion", [(), (0.15, -0.1, 0.002, -0.003)])
def test_cast_gives_back_the_plane_that_was_fused(distortion: tuple[float, ...]) -> None:
    lens = PinholeCamera(130.0, 130.0, 79.5, 59.5, distortion)
    surface = SurfaceMap(0.02, 0.08)
    measured = measured_of(tilted_plane(lens), lens=lens)
    surface.fuse(measured, lens, np.eye(4), pool=POOL, n_threads=2)
    half = np.array([65.0, 65.0, 39.5, 29.5])
    expected = tilted_plane(PinholeCamera(*half), (60, 80)).astype(np.float32) + np.float32(0.1)
    seen = surface.cast(expected, half, np.eye(4), pool=POOL, n_threads=2)
    known = np.isfinite(seen.points[:, :, 0])
    assert known[8:-8, 12:-12].mean() > 0.95
    off = seen.points[known] @ np.array([-0.3, 0.0, 1.0]) - 1.0
    assert np.abs(off).max() < 0.006  # nearest pixels: a third of a voxel
    assert np.median(np.abs(off)) < 0.002
    normal = np.array([0.3, 0.0, -1.0]) / np.hypot(1.0, 0.3)
    assert np.median(seen.normals[known] @ normal) > 0.995


def test_map_does_not_depend_on_the_worlds_place_by_whole_blocks() -> None:
    measured = measured_of(tilted_plane())
    near, far = SurfaceMap(0.02, 0.08), SurfaceMap(0.02, 0.08)
    T = np.eye(4)
    T[:3, 3] = 0.16 * np.array([100, -50, 20])
    near.fuse(measured, LENS, np.eye(4), pool=POOL, n_threads=1)
    far.fuse(measured, LENS, T, pool=POOL, n_threads=2)
    assert near.n_blocks == far.n_blocks
    parts = slice(near.n_blocks)
    np.testing.assert_allclose(near.distances(parts), far.distances(parts), atol=1e-5)


def test_memory_follows_the_surface_not_the_volume() -> None:
    sizes = []
    for distance in (1.0, 2.0):
        surface = SurfaceMap(0.02, 0.08)
        surface.fuse(measured_of(np.full((120, 160), distance)), LENS, np.eye(4), pool=POOL, n_threads=1)
        sizes.append(surface.n_bytes)
    assert 3.0 < sizes[1] / sizes[0] < 5.5  # four times the area; the frustum has eight times the volume


def test_what_is_seen_through_is_carved_away() -> None:
    surface = SurfaceMap(0.02, 0.08)
    board = np.full((120, 160), 2.0)
    board[40:80, 60:100] = 1.0
    for _ in range(3):
        surface.fuse(measured_of(board), LENS, np.eye(4), pool=POOL, n_threads=1)
    assert (extract_mesh(surface).points[:, 2] < 1.3).any()
    for _ in range(30):
        surface.fuse(measured_of(np.full((120, 160), 2.0)), LENS, np.eye(4), carve=True, pool=POOL, n_threads=1)
    mesh = extract_mesh(surface)
    assert not (mesh.points[:, 2] < 1.3).any()
    assert (mesh.points[:, 2] > 1.9).any()


def test_colours_reach_the_mesh() -> None:
    surface = SurfaceMap(0.02, 0.08)
    colour = np.zeros((120, 160, 3), np.uint8)
    colour[:, :80], colour[:, 80:] = (200, 30, 10), (10, 30, 200)
    for _ in range(2):
        surface.fuse(measured_of(np.full((120, 160), 1.0), colour), LENS, np.eye(4), pool=POOL, n_threads=1)
    mesh = extract_mesh(surface)
    left = mesh.colours[mesh.points[:, 0] < -0.05]
    assert np.abs(left.astype(int) - [200, 30, 10]).max() <= 2


def test_mesh_of_a_ball_is_closed_and_welded() -> None:
    surface = SurfaceMap(0.02, 0.06)
    reach = np.arange(-3, 3)
    keys = np.sort([blocks.pack(x, y, z) for x in reach for y in reach for z in reach])
    numbers = surface.add_blocks(keys)
    voxel = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for number in numbers:
        at = (surface.coordinates[number] * 8 + voxel) * 0.02
        hold(surface, number, np.clip(np.linalg.norm(at, axis=1) - 0.3, -0.06, 0.06), 2.0)
    mesh = extract_mesh(surface)
    assert np.abs(np.linalg.norm(mesh.points, axis=1) - 0.3).max() < 0.002
    edges = np.sort(
        np.concatenate([mesh.triangles[:, [0, 1]], mesh.triangles[:, [1, 2]], mesh.triangles[:, [2, 0]]]), 1
    )
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 2).mean() > 0.999  # every edge joins two triangles: no seam between blocks
    used = np.unique(mesh.triangles)
    assert len(used) - len(count) + len(mesh.triangles) == 2  # Euler's number of a sphere


def test_interpolation_is_linear_across_blocks() -> None:
    surface = SurfaceMap(0.01, 0.04)
    keys = np.sort([blocks.pack(x, y, z) for x in (-1, 0) for y in (-1, 0) for z in (-1, 0)])
    for number in surface.add_blocks(keys):
        voxel = np.stack(np.meshgrid(*[np.arange(8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        at = surface.coordinates[number] * 8 + voxel
        hold(surface, number, at @ np.array([0.0005, -0.001, 0.0015]), 1.0)
    out, step = np.empty(4), 0.04 / 32767.0
    table = surface._table_keys, surface._table, surface._shift
    for x, y, z in ((2.3, 1.6, 5.9), (-0.4, -0.2, -0.9), (-1.0, 0.0, 3.5)):
        assert sample_cell(x, y, z, surface.distance, step, *table, out)
        # each voxel is off by half a step at most, and a difference of two by a whole one
        np.testing.assert_allclose(out, [0.0005 * x - 0.001 * y + 0.0015 * z, 0.0005, -0.001, 0.0015], atol=1.01 * step)
    assert not sample_cell(30.0, 0.0, 0.0, surface.distance, step, *table, out)


def test_voxels_that_were_never_held_are_not_known() -> None:
    surface = SurfaceMap(0.01, 0.04)
    (number,) = surface.add_blocks(np.array([blocks.pack(1, 2, 3)]))
    assert np.isnan(surface.distances(int(number))).all()
    assert not surface.weights(int(number)).any()
    distance, weight = np.linspace(-0.04, 0.04, 512), np.geomspace(1e-4, 200.0, 512)
    hold(surface, int(number), distance, weight)
    np.testing.assert_allclose(surface.distances(int(number)), distance, atol=0.51 * 0.04 / 32767.0)
    np.testing.assert_allclose(np.sqrt(surface.weights(int(number))), np.sqrt(weight), atol=0.51 * 200.0**0.5 / 65535.0)


def test_lens_numbers_fill_up_with_zeros() -> None:
    np.testing.assert_array_equal(lens_numbers(PinholeCamera(1, 2, 3, 4, (0.5,))), [1, 2, 3, 4, 0.5, 0, 0, 0, 0])
