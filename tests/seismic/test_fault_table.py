from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from fake_faults import make_cube, make_faults, plane_surface

from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.seismic.exports import mesh_faults
from seismo3d.seismic.fault_table import measure_rake, measure_slip, tabulate_faults
from seismo3d.seismic.faultset import FaultSurface

STRIKE_DEG, DIP_DEG, THROW_M, SAMPLE_M = 350.0, 55.0, 45.0, 5.0
HEAVE_M = THROW_M / np.tan(np.radians(DIP_DEG))


def lay_survey(bins: tuple[float, float], *, turn_deg: float = 33.0, mirrored: bool = False) -> xr.DataArray:
    """A depth cube whose bins are so large, on a map turned from north."""
    shape = (12, 14, 16)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    i, j = np.meshgrid(np.arange(shape[0]) * bins[0], np.arange(shape[1]) * bins[1], indexing="ij")
    j = -j if mirrored else j
    coordinates: dict[str, Any] = {
        "inline": np.arange(shape[0]),
        "crossline": np.arange(shape[1]),
        "depth": SAMPLE_M * np.arange(shape[2]),
        "cdp_x": (("inline", "crossline"), i * s + j * c),
        "cdp_y": (("inline", "crossline"), i * c - j * s),
    }
    values = np.zeros(shape, np.float32)
    return xr.DataArray(values, dims=("inline", "crossline", "depth"), coords=coordinates, attrs={"sample_unit": "m"})


def lay_fault(geometry: SurveyGeometry, *, strike_slip: float, throw: float = THROW_M) -> FaultSurface:
    """A plane of that strike and dip on the map, and what a motion on it there is on the grid."""
    assert geometry.map_fit is not None
    M, strike, dip = geometry.map_fit.matrix, np.radians(STRIKE_DEG), np.radians(DIP_DEG)
    along, right = np.array([np.sin(strike), np.cos(strike)]), np.array([np.cos(strike), -np.sin(strike)])
    normal = np.append(M.T @ right * np.sin(dip), -np.cos(dip) * SAMPLE_M)
    normal /= np.linalg.norm(normal)
    motion = np.linalg.solve(M, strike_slip * along + throw / np.tan(dip) * right)
    outwards = normal[:2] / np.hypot(*normal[:2])
    share = 0.0 if strike_slip == 0 else float(motion @ [outwards[1], -outwards[0]]) / (throw / SAMPLE_M)
    surface = plane_surface(axis=1, centre=7.0, dip_deg=DIP_DEG, throw=1.0, shape=(12, 14, 16))
    n = len(surface.vertices)
    return replace(
        surface,
        normals=np.tile(normal, (n, 1)).astype(np.float32),
        throw=np.full(n, throw / SAMPLE_M, np.float32),
        strike_deg=geometry.strike_deg(np.tile(normal, (n, 1))).astype(np.float32),
        strike_share=share,
        sample_interval=SAMPLE_M,
        sample_unit="m",
    )


@pytest.mark.parametrize("bins", [(25.0, 6.25), (25.0, 12.5), (12.5, 12.5)])
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("strike_slip", [0.0, 20.0, -8.0])
@pytest.mark.parametrize("throw", [THROW_M, -THROW_M])
def test_slip_is_split_on_the_map_whatever_the_bins(bins, mirrored, strike_slip, throw):
    cube = lay_survey(bins, mirrored=mirrored)
    geometry = SurveyGeometry.from_cube(cube)
    surface = lay_fault(geometry, strike_slip=strike_slip, throw=throw)
    np.testing.assert_allclose(surface.strike_deg, STRIKE_DEG, atol=1e-3)
    heave, along = measure_slip(surface, geometry)
    np.testing.assert_allclose(heave, np.sign(throw) * HEAVE_M, rtol=1e-4)
    np.testing.assert_allclose(along, strike_slip, atol=1e-3)
    rake = np.degrees(np.arctan2(np.sign(throw) * np.hypot(HEAVE_M, THROW_M), strike_slip))
    np.testing.assert_allclose(measure_rake(surface, geometry), rake, atol=0.01)
    faults = replace(make_faults(cube), surfaces=(surface,))
    row, mesh = tabulate_faults(faults, cube)[0], mesh_faults(faults, cube)[0]
    assert row["heave_mean_m"] == pytest.approx(HEAVE_M, rel=1e-4)
    assert row["strike_slip_mean_m"] == pytest.approx(strike_slip, abs=1e-3)
    assert row["rake_deg"] == pytest.approx(rake, abs=0.01)
    np.testing.assert_allclose(mesh.properties["rake"], rake, atol=0.01)


def test_rake_of_a_time_cube_is_that_of_bins_where_these_are_square():
    cube = lay_survey((12.5, 12.5)).rename(depth="time").assign_attrs(sample_unit="ms")
    geometry = SurveyGeometry.from_cube(cube)
    surface = replace(lay_fault(geometry, strike_slip=0.0), strike_share=-0.4)
    np.testing.assert_allclose(measure_rake(surface, geometry), surface.rake_deg, atol=1e-3)
    wide = SurveyGeometry.from_cube(lay_survey((25.0, 6.25)).rename(depth="time").assign_attrs(sample_unit="ms"))
    np.testing.assert_allclose(measure_rake(lay_fault(wide, strike_slip=0.0), wide), 90.0, atol=1e-3)


def test_without_a_map_slip_is_told_in_traces():
    cube = make_cube().drop_vars(["cdp_x", "cdp_y"])
    geometry, surface = SurveyGeometry.from_cube(cube), replace(make_faults(cube).surfaces[0], strike_share=0.3)
    for found, told in zip(measure_slip(surface, geometry), (surface.heave, surface.strike_slip), strict=True):
        np.testing.assert_allclose(found, told, rtol=1e-4)
    np.testing.assert_allclose(measure_rake(surface, geometry), surface.rake_deg, atol=1e-3)
