"""Maps from above of meshes whose ground, and walls, are known."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.geometry.rotations import exp_rotation
from seismo3d.robot.ground import find_upright, make_ground, make_occupancy
from seismo3d.robot.mesh import Mesh
from seismo3d.robot.occupancy import FREE, OCCUPIED, UNKNOWN

SIDE = 0.02


def sheet(corner: list[float], along: list[float], up: list[float], noise: float, rng: np.random.Generator) -> Mesh:
    """A rectangle of small triangles from a corner, facing ``along x up``; x right, y down, z forward."""
    lengths = [float(np.linalg.norm(axis)) for axis in (along, up)]
    n, m = (round(length / SIDE) + 1 for length in lengths)
    a, b = np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, m), indexing="ij")
    points = np.array(corner) + a[..., None] * along + b[..., None] * up
    normal = np.cross(along, up) / (lengths[0] * lengths[1])
    points += noise * rng.standard_normal((n, m, 1)) * normal
    k = np.arange(n * m).reshape(n, m)
    p, q, r, s = (part.ravel() for part in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    triangles = np.concatenate([np.column_stack([p, q, r]), np.column_stack([p, r, s])])
    return Mesh(points.reshape(-1, 3), triangles, np.zeros((n * m, 3), np.uint8))


def joined(*meshes: Mesh) -> Mesh:
    first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    triangles = np.concatenate([mesh.triangles + k for mesh, k in zip(meshes, first)])
    points = np.concatenate([mesh.points for mesh in meshes])
    return Mesh(points, triangles, np.zeros((len(points), 3), np.uint8))


def wall(rng: np.random.Generator, noise: float = 0.004) -> Mesh:
    """Two metres ahead, 3 m wide, from 0.8 m below the camera to 0.7 m above it, facing it."""
    return sheet([-1.5, -0.7, 2.0], [0.0, 1.5, 0.0], [3.0, 0.0, 0.0], noise, rng)


def floor(rng: np.random.Generator) -> Mesh:
    return sheet([-1.5, 0.8, 1.0], [3.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.004, rng)


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_a_wall_alone_is_no_ground_but_stands_where_it_is(noise: float, rng: np.random.Generator) -> None:
    """Noise turns parts of it upwards, by more than 20 degrees."""
    mesh = wall(rng, noise)
    np.testing.assert_allclose(find_upright(mesh).T_world_map[:3, 2], [0.0, -1.0, 0.0], atol=1e-12)
    found = make_occupancy(mesh, cell=0.1)
    assert found.cells.shape[0] <= 2  # a line, seen from above
    assert (found.cells == OCCUPIED).any(axis=0).all()
    assert not (found.cells == FREE).any()
    assert np.isnan(make_ground(mesh, cell=0.1).values).all()


@pytest.mark.parametrize("pitch", [0.0, 0.35, 0.9])
def test_ground_before_a_wall_is_free_and_the_wall_is_not(pitch: float, rng: np.random.Generator) -> None:
    mesh = joined(wall(rng), floor(rng), floor(rng))
    R = exp_rotation([pitch, 0.0, 0.0])
    mesh = Mesh(mesh.points @ R.T, mesh.triangles, mesh.colours)
    up = find_upright(mesh).T_world_map[:3, 2]
    assert up @ R @ [0.0, -1.0, 0.0] > np.cos(np.radians(3.0))
    found = make_occupancy(mesh, cell=0.1)
    assert (found.cells[1:8, 2:-2] == FREE).all()
    assert (found.cells[9:12, 2:-2] == OCCUPIED).any(axis=0).all()


def test_a_camera_that_hangs_upside_down_says_where_up_is(rng: np.random.Generator) -> None:
    hung = joined(wall(rng), floor(rng))
    hung = Mesh(hung.points * [-1.0, -1.0, 1.0], hung.triangles, hung.colours)
    assert not (make_occupancy(hung, cell=0.1).cells == FREE).any()
    found = make_occupancy(hung, cell=0.1, up=(0.0, 2.0, 0.0))
    np.testing.assert_allclose(found.T_world_map[:3, 2], [0.0, 1.0, 0.0], atol=0.05)
    assert (found.cells[1:8, 2:-2] == FREE).all()
    ground = make_ground(hung, cell=0.1, up=(0.0, 1.0, 0.0)).values
    assert np.nanmedian(ground) == pytest.approx(-0.8, abs=0.03)


@pytest.mark.parametrize("up", [(0.0, 0.0, 0.0), (0.0, 1.0), (0.0, float("nan"), 1.0), ["0", "x", "1"], None])
def test_no_direction_is_refused(up: object, rng: np.random.Generator) -> None:
    with pytest.raises(ParameterError, match="expected three numbers that are not all zero"):
        find_upright(wall(rng), up=up)  # type: ignore[arg-type]


def test_a_ceiling_alone_is_nothing_in_the_way(rng: np.random.Generator) -> None:
    mesh = sheet([-1.5, -1.4, 1.0], [0.0, 0.0, 1.0], [3.0, 0.0, 0.0], 0.002, rng)
    assert (make_occupancy(mesh, cell=0.1).cells == UNKNOWN).all()
