from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from fake_terrain import place

from seismo3d.errors import GeometryError
from seismo3d.terrain import outcrops


@pytest.fixture
def cube():
    il, xl = np.meshgrid(np.arange(20), np.arange(30), indexing="ij")
    return xarray.DataArray(
        np.zeros((20, 30, 50), np.float32),
        dims=("inline", "crossline", "depth"),
        coords={
            "inline": np.arange(20),
            "crossline": np.arange(30),
            "depth": 10.0 * np.arange(50),
            "cdp_x": (("inline", "crossline"), 400_500.0 + 25.0 * xl),
            "cdp_y": (("inline", "crossline"), 3_799_000.0 + 25.0 * il),
        },
        attrs={"sample_unit": "m"},
    )


def fault(top: int = 10) -> SimpleNamespace:
    """A plane that strikes along inlines' axis and dips 45 degrees towards growing x, from a depth of 100 m down."""
    i, k = np.meshgrid(np.arange(20.0), np.arange(float(top), 40.0), indexing="ij")
    crossline = 5.0 + (10.0 * k - 100.0) / 25.0
    return SimpleNamespace(vertices=np.column_stack([i.ravel(), crossline.ravel(), k.ravel()]))


def test_a_dipping_fault_meets_level_ground_where_its_plane_says(cube):
    ground = place(np.full((200, 200), 300.0))
    (line,) = outcrops(SimpleNamespace(surfaces=(fault(),)), cube, ground, datum=250.0)
    # at a depth of 100 m, an elevation of 150 m, it lies at x = 400 625; 150 m higher, 150 m to the west
    np.testing.assert_allclose(line.points[:, 0], 400_475.0, atol=1.0)
    np.testing.assert_allclose(line.points[:, 2], 300.0, atol=0.5)
    np.testing.assert_allclose(line.distance, 150.0 * np.sqrt(2.0), atol=1.0)


def test_refusals(cube):
    faults, ground = SimpleNamespace(surfaces=(fault(),)), place(np.full((200, 200), 300.0))
    with pytest.raises(GeometryError, match="cube has no map coordinates"):
        outcrops(faults, cube.drop_vars(["cdp_x", "cdp_y"]), ground)
    with pytest.raises(GeometryError, match="expected a georeference in metres"):
        outcrops(faults, cube, np.full((200, 200), 300.0))
    with pytest.raises(GeometryError, match="off the terrain map"):
        outcrops(faults, cube.assign_coords(cdp_x=cube.cdp_x + 1e6), ground)
    time = cube.rename(depth="time").assign_attrs(sample_unit="ms")
    with pytest.raises(GeometryError, match="expected a velocity"):
        outcrops(faults, time, ground)
    assert len(outcrops(faults, time, ground, datum=250.0, velocity=2000.0)) == 1
