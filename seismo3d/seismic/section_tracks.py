"""Tracks on a section: it is thickened to a cube that is the same everywhere across it, and tracked there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import freeze
from seismo3d.geometry.axis import unit_of
from seismo3d.seismic.cube_checks import check_faults_of
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.seismic.preparing import describe_volume, find_valid, refuse_dead

THICK = 9
_MIDDLE = THICK // 2


def thicken(section: Any, faults: FaultSet | None) -> tuple[Any, FaultSet | None]:
    """Repeat a section, and its faults, along a new inline axis.

    Parameters
    ----------
    section : DataArray or array_like of shape (trace, sample)
        A section.
    faults : FaultSet, optional
        Its faults.

    Returns
    -------
    cube : DataArray or ndarray of shape (9, trace, sample)
        A DataArray, with the section's coordinates on the crossline and sample axes, where the section was one.
    faults : FaultSet or None
        The same faults as surfaces.

    Raises
    ------
    ShapeError
        If the section's axes are in another order, it is too small or has no data, or the faults are of a section of
        another shape.
    GeometryError
        If the faults are of a section elsewhere.
    """
    describe_volume(section if hasattr(section, "dims") else np.asarray(section))
    check_faults_of(section, faults, "section")
    values = _without_padding(np.asarray(getattr(section, "values", section)))
    cube: Any = np.broadcast_to(values, (THICK, *values.shape))
    if hasattr(section, "dims"):
        import xarray as xr

        trace, vertical = (str(name) for name in section.dims)
        coords: dict[str, Any] = {"inline": np.arange(THICK)}
        for name, dim in ((trace, "crossline"), (vertical, vertical)):
            if name in section.coords:
                coords[dim] = np.asarray(section[name].values)
        unit = {"sample_unit": unit_of(section)}
        cube = xr.DataArray(cube, dims=("inline", "crossline", vertical), coords=coords, attrs=unit)
    return cube, None if faults is None else _thicken_faults(faults)


def _without_padding(values: AnyArray) -> AnyArray:
    """Return a section with NaN on its traces without data: nine equal lines would not show that they are padding."""
    live = find_valid(values[None].astype(np.float32)).any(axis=2)
    lost = ~np.asarray(live)[0]
    refuse_dead(~lost, "section")
    return np.where(lost[:, None], np.float32(np.nan), values) if lost.any() else values


def put_on_middle(index: Float64Array) -> Float64Array:
    """Carry fractional indices (trace, sample) to those of the thickened section's middle: shape (n, 3)."""
    return np.column_stack([np.full(len(index), float(_MIDDLE)), index])


def cut_middle(track: Any) -> Any:
    """Return the track of a section from that of its thickened cube: depth, confidence and seeds without inlines."""
    return replace(
        track,
        depth=freeze(track.depth[_MIDDLE].copy()),
        confidence=freeze(track.confidence[_MIDDLE].copy()),
        seeds=freeze(track.seeds[:, -2:].copy()),
    )


def _thicken_faults(faults: FaultSet) -> FaultSet:
    surfaces = tuple(_thicken_surface(surface) for surface in faults.surfaces)
    volumes = {
        name: np.broadcast_to(np.asarray(getattr(faults, name)), (THICK, *np.shape(faults.labels)))
        for name in ("likelihood", "labels", "throw")
    }
    return FaultSet(surfaces, **volumes, settings=faults.settings)


def _thicken_surface(line: FaultSurface) -> FaultSurface:
    """Turn a polyline into a strip of triangles across the thickened section."""
    n = len(line.vertices)
    rows = np.repeat(np.arange(THICK, dtype=np.float32), n)
    a, b = (line.cells[:, k] + n * np.arange(THICK - 1)[:, None] for k in (0, 1))
    cells = np.concatenate([np.stack([a, b, a + n], axis=-1), np.stack([b, b + n, a + n], axis=-1)])
    repeated: dict[str, Any] = {
        name: freeze(np.tile(getattr(line, name), THICK))
        for name in ("likelihood", "throw", "separation", "throw_fit", "strike_deg", "dip_deg")
    }
    return replace(
        line,
        vertices=freeze(np.column_stack([rows, np.tile(line.vertices, (THICK, 1))])),
        normals=freeze(np.column_stack([np.zeros_like(rows), np.tile(line.normals, (THICK, 1))])),
        cells=freeze(cells.reshape(-1, 3).astype(np.int32)),
        **repeated,
    )
