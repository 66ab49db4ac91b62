from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, FormatError, ParameterError, ShapeError
from seismo3d.geometry.rotations import exp_rotation, make_transform, transform_points
from seismo3d.robot import Occupancy, Planner


@pytest.fixture
def occupancy(rng):
    T = make_transform(exp_rotation([0.2, -0.4, 1.1]), [3.0, -2.0, 0.5])
    height = rng.normal(0.0, 0.1, (5, 8)).astype(np.float32)
    height[1, 2] = np.nan
    return Occupancy(rng.integers(0, 3, (5, 8)), height, 0.25, (-1.0, 2.0), T)


def test_cells_and_points_agree(occupancy):
    assert occupancy.extent == (-1.125, 0.875, 1.875, 3.125)
    cells = np.argwhere(np.ones((5, 8)))
    centres = occupancy.centres(cells)
    np.testing.assert_array_equal(centres[0], [-1.0, 2.0])
    np.testing.assert_array_equal(centres[-1], [-1.0 + 7 * 0.25, 2.0 + 4 * 0.25])
    for shift in ([0.0, 0.0], [0.12, -0.12], [-0.12, 0.12]):
        np.testing.assert_array_equal(occupancy.rows_columns(centres + shift), cells)
    world = occupancy.in_world(centres)
    known = np.isfinite(occupancy.height.ravel())
    z = np.where(known, occupancy.height.ravel(), np.median(occupancy.height.ravel()[known]))
    np.testing.assert_allclose(world, transform_points(occupancy.T_world_map, np.column_stack([centres, z])), rtol=1e-6)


def test_saved_map_is_read_back_the_same(occupancy, tmp_path):
    back = Occupancy.load(occupancy.save(tmp_path / "occupancy.npz"))
    for name in ("cells", "height", "T_world_map"):
        np.testing.assert_array_equal(getattr(back, name), getattr(occupancy, name))
        assert getattr(back, name).dtype == getattr(occupancy, name).dtype
        assert not getattr(back, name).flags.writeable
    assert (back.cell, back.origin) == (occupancy.cell, occupancy.origin)


def test_refusals(occupancy, tmp_path):
    zeros = np.zeros((3, 4))
    with pytest.raises(ShapeError, match="other values than 0, 1 and 2"):
        Occupancy(zeros + 3, zeros, 0.1)
    with pytest.raises(ShapeError, match=r"height has shape \(3, 3\)"):
        Occupancy(zeros, np.zeros((3, 3)), 0.1)
    with pytest.raises(ParameterError, match="cell is 0"):
        Occupancy(zeros, zeros, 0.0)
    with pytest.raises(ShapeError, match="T_world_map has shape"):
        Occupancy(zeros, zeros, 0.1, (0.0, 0.0), np.eye(3))
    with pytest.raises(FileAccessError, match="does not exist"):
        Occupancy.load(tmp_path / "none.npz")
    (tmp_path / "bad.npz").write_bytes(b"no map")
    with pytest.raises(FormatError, match="is no NPZ archive"):
        Occupancy.load(tmp_path / "bad.npz")
    file = occupancy.save(tmp_path / "cut.npz")
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(FormatError, match="damaged or cut short"):
        Occupancy.load(file)
    np.savez(tmp_path / "other.npz", cells=zeros)
    with pytest.raises(FormatError, match="has the arrays cells; expected height, cell"):
        Occupancy.load(tmp_path / "other.npz")
    np.savez(tmp_path / "wrong.npz", cells=zeros + 7, height=zeros, cell=0.1, origin=np.zeros(2), T_world_map=np.eye(4))
    with pytest.raises(FormatError, match="is not an occupancy map: cells holds other values"):
        Occupancy.load(tmp_path / "wrong.npz")
    np.savez(tmp_path / "objects.npz", cells=np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(FormatError):
        Occupancy.load(tmp_path / "objects.npz")


def test_cells_that_are_no_rows_and_columns_are_refused():
    occupancy = Occupancy(np.zeros((60, 60)), np.zeros((60, 60)), 0.05)
    with pytest.raises(ShapeError, match=r"^rows_columns has shape \(2,\); expected \(n, 2\)"):
        occupancy.centres([1, 2])
    planner = Planner(occupancy, (1.0, 1.0), (2.0, 2.0))
    with pytest.raises(ShapeError, match=r"^rows_columns has elements of type <U1; expected real numbers"):
        planner.update([["1", "2"]], [1])
    with pytest.raises(ShapeError, match=r"^rows_columns has 1 rows with NaN"):
        planner.update([[np.nan, 2.0]], [1])
    with pytest.raises(ShapeError, match=r"^height has shape \(2,\); expected that of cells, \(1,\)"):
        planner.update([[1, 2]], [1], height=[0.5, 0.5])
    assert (planner._cells == 0).all()
    assert (planner._height == 0.0).all()
