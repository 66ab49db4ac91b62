"""Cubes with faults whose every number is known: two planes that cross a layered cube."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from seismo3d.seismic.faultset import FaultSet, FaultSurface

SHAPE = (30, 40, 50)
DT = 4.0
BINS = (25.0, 12.5)


def plane_surface(
    *, axis: int, centre: float, dip_deg: float, throw: float, shape: tuple[int, int, int] = SHAPE, turn: float = 0.0
) -> FaultSurface:
    """A plane whose trace in the middle sample is ``axis = centre``, dipping towards growing ``axis``."""
    other = 1 - axis
    middle = (shape[2] - 1) / 2
    along = np.linspace(2.0, shape[other] - 3.0, 14)
    down = np.linspace(5.0, shape[2] - 6.0, 20)
    A, Z = np.meshgrid(along, down, indexing="ij")
    slope = 1.0 / np.tan(np.radians(dip_deg))
    across = centre + (Z - middle) * slope + turn * (A - along.mean())
    vertices = np.empty((A.size, 3), dtype=np.float32)
    vertices[:, axis], vertices[:, other], vertices[:, 2] = across.ravel(), A.ravel(), Z.ravel()
    numbers = np.arange(A.size).reshape(A.shape)
    a, b, c, d = numbers[:-1, :-1].ravel(), numbers[1:, :-1].ravel(), numbers[:-1, 1:].ravel(), numbers[1:, 1:].ravel()
    cells = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)]).astype(np.int32)
    normal = np.zeros(3)
    normal[axis], normal[other], normal[2] = 1.0, -turn, -slope
    normal /= np.linalg.norm(normal)
    sides = vertices[cells].astype(np.float64)
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1).sum()
    n = len(vertices)
    throws = np.linspace(0.5, 1.5, n) * throw
    throws[:3] = np.nan
    return FaultSurface(
        vertices=vertices,
        cells=cells,
        normals=np.tile(normal, (n, 1)).astype(np.float32),
        likelihood=np.linspace(0.4, 0.9, n).astype(np.float32),
        throw=throws.astype(np.float32),
        separation=throws.astype(np.float32),
        throw_fit=np.linspace(0.0, 1.0, n).astype(np.float32),
        # dips to the right of the strike; towards growing inlines the dip's azimuth is 0, so strike 270
        strike_deg=np.full(n, 270.0 if axis == 0 else 0.0, dtype=np.float32),
        dip_deg=np.full(n, dip_deg, dtype=np.float32),
        sample_interval=DT,
        sample_unit="ms",
        confidence=0.8 if throw > 0 else 0.5,
        area=float(area),
    )


def make_cube(shape: tuple[int, int, int] = SHAPE, *, dip: float = 0.15) -> xr.DataArray:
    """Dipping layers with the first plane's throw, on a map turned by 30 degrees, four traces dead or missing."""
    i, j, k = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    plane = j - (shape[1] / 2 + (k - (shape[2] - 1) / 2) * 0.5)
    time = k - dip * i - np.where(plane > 0, 4.0, 0.0)
    values = (1000.0 * np.sin(2 * np.pi * time / 12.0)).astype(np.float32)
    live = np.ones(shape[:2], dtype=bool)
    live[3:5, 3:5] = False
    values[3, 3:5] = np.nan
    values[4, 3:5] = 0.0
    inline, crossline = 100 + 2 * np.arange(shape[0]), 500 + np.arange(shape[1])
    turn = np.radians(30.0)
    along, across = np.meshgrid(np.arange(shape[0]) * BINS[0], np.arange(shape[1]) * BINS[1], indexing="ij")
    x, y = 5e5 + along * np.sin(turn) + across * np.cos(turn), 6e6 + along * np.cos(turn) - across * np.sin(turn)
    coordinates: dict[str, Any] = {
        "inline": inline,
        "crossline": crossline,
        "time": 1000.0 + DT * np.arange(shape[2]),
        "cdp_x": (("inline", "crossline"), x),
        "cdp_y": (("inline", "crossline"), y),
        "live": (("inline", "crossline"), live),
    }
    attributes = {"sample_unit": "ms", "sample_interval": DT}
    return xr.DataArray(values, dims=("inline", "crossline", "time"), coords=coordinates, attrs=attributes)


def make_faults(cube: Any) -> FaultSet:
    """Two faults: a normal one across the crosslines, a reverse one across the inlines."""
    shape = cube.shape
    surfaces = (
        plane_surface(axis=1, centre=shape[1] / 2, dip_deg=63.4349488, throw=4.0, shape=shape),
        plane_surface(axis=0, centre=shape[0] / 2, dip_deg=75.0, throw=-2.0, shape=shape),
    )
    labels, likelihood = np.zeros(shape, np.int32), np.zeros(shape, np.float32)
    throw = np.full(shape, np.nan, np.float32)
    for number, surface in reversed(list(enumerate(surfaces, start=1))):
        fine = surface.vertices[surface.cells].mean(axis=1)
        at = tuple(np.rint(np.concatenate([surface.vertices, fine])).astype(int).T)
        labels[at], likelihood[at], throw[at] = number, 0.7, 4.0 if number == 1 else -2.0
    volumes = (likelihood, labels, throw)
    if hasattr(cube, "dims"):
        volumes = tuple(cube.copy(data=v) for v in volumes)  # type: ignore[assignment]
    settings = {"threshold": 0.2, "scales": (1, 2), "evidence": ["misfit"], "note": None, "rate": np.float32(0.01)}
    return FaultSet(surfaces, *volumes, settings=settings)


def make_section() -> tuple[xr.DataArray, FaultSet]:
    """A 2D line of 60 traces with one fault line."""
    i, k = np.meshgrid(np.arange(60), np.arange(50), indexing="ij")
    values = np.sin(2 * np.pi * (k - np.where(i > 30 + (k - 25) * 0.5, 3.0, 0.0)) / 11.0).astype(np.float32)
    down = np.linspace(5, 44, 14)
    vertices = np.stack([30 + (down - 25) * 0.5, down], axis=1).astype(np.float32)
    n = len(vertices)
    order = np.random.default_rng(1).permutation(n - 1)
    cells = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)[order].astype(np.int32)
    surface = FaultSurface(
        vertices=vertices,
        cells=cells,
        normals=np.tile(np.array([0.894427, -0.447214], np.float32), (n, 1)),
        likelihood=np.full(n, 0.6, np.float32),
        throw=np.full(n, 3.0, np.float32),
        separation=np.full(n, 3.0, np.float32),
        throw_fit=np.full(n, 0.9, np.float32),
        strike_deg=np.full(n, np.nan, np.float32),
        dip_deg=np.full(n, 63.43, np.float32),
        sample_interval=2.0,
        sample_unit="ms",
        confidence=0.7,
        area=float(np.linalg.norm(vertices[-1] - vertices[0])),
    )
    section = xr.DataArray(
        values,
        dims=("trace", "time"),
        coords={
            "trace": 1 + np.arange(60),
            "time": 2.0 * np.arange(50),
            "cdp_x": ("trace", 1000.0 + 10.0 * np.arange(60)),
            "cdp_y": ("trace", 2000.0 + 0.0 * np.arange(60)),
            "live": ("trace", np.ones(60, bool)),
        },
        attrs={"sample_unit": "ms"},
    )
    labels = np.zeros(values.shape, np.int32)
    labels[tuple(np.rint(vertices).astype(int).T)] = 1
    likelihood = np.where(labels > 0, 0.6, 0.0).astype(np.float32)
    throw = np.where(labels > 0, 3.0, np.nan).astype(np.float32)
    volumes = (section.copy(data=v) for v in (likelihood, labels, throw))
    return section, FaultSet((surface,), *volumes, settings={})


def fake_trace_faults(cube: Any, *, evidence: str | None = None, progress: Any = None) -> FaultSet:
    """Stand in for the tracer: known surfaces in any cube, with its stages reported."""
    for stage in ("dips", "scan"):
        for share in (0.0, 1.0):
            if progress is not None:
                progress(stage, share)
    if cube.ndim == 2:
        found = make_section()[1]
        volumes = {name: cube.copy(data=getattr(found, name).data) for name in ("likelihood", "labels", "throw")}
        return FaultSet(found.surfaces, **volumes, settings={"threshold": 0.2, "evidence": evidence or "both"})
    found = make_faults(cube)
    return replace(found, settings={**found.settings, "evidence": evidence or "both"})
