"""The result of fault tracing: surfaces with their attributes, and the volumes they came from.

Frame and sign conventions, here once for the whole seismic side:

- Coordinates are fractional indices, ``(inline, crossline, sample)`` in a cube and ``(trace, sample)`` in a section; the
  sample axis points down.
- A surface's normals point into its hanging wall, so that their sample component is not positive (up) on a dipping
  surface; where a surface is vertical the sign is that of its neighbours.
- Throw is vertical: positive where the hanging wall went down (normal fault), negative where it went up (reverse).
- Strike obeys the right-hand rule: looking along it, the surface dips to the right. It is measured from north where the
  cube knows its map coordinates, else from the direction of growing inline numbers towards growing crosslines.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from seismo3d._typing import AnyArray, Float32Array, Int32Array


@dataclass(frozen=True, slots=True, eq=False)
class FaultSurface:
    """One fault: a triangulated surface in a cube, a polyline in a section.

    Attributes
    ----------
    vertices : ndarray of shape (n, d), float32
        Points in fractional index coordinates; d is 3 in a cube, 2 in a section.
    cells : ndarray of shape (m, d), int32
        Triangles (cube) or segments (section) as rows of vertex numbers.
    normals : ndarray of shape (n, d), float32
        Unit normals in index coordinates, pointing into the hanging wall.
    likelihood : ndarray of shape (n,), float32
        Fault likelihood at each vertex, 0 to 1.
    throw : ndarray of shape (n,), float32
        Vertical displacement in samples, positive where the hanging wall is down; NaN where it is not known.
    strike_deg, dip_deg : ndarray of shape (n,), float32
        Orientation at each vertex in degrees; strike 0 to 360 by the right-hand rule, dip 0 to 90. In a section strike is NaN.
    sample_interval : float
        Size of a sample in ms or m, or 1 where the input was a bare array.
    sample_unit : str
        "ms", "m" or "samples".
    confidence : float
        Mean likelihood over the surface, weighed down for small surfaces; 0 to 1.
    area : float
        Area (cube) or length (section) in index units.
    """

    vertices: Float32Array
    cells: Int32Array
    normals: Float32Array
    likelihood: Float32Array
    throw: Float32Array
    strike_deg: Float32Array
    dip_deg: Float32Array
    sample_interval: float = 1.0
    sample_unit: str = "samples"
    confidence: float = 0.0
    area: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class FaultSet:
    """All faults of a cube or section.

    Attributes
    ----------
    surfaces : tuple of FaultSurface
        Largest first; surface ``i`` has the label ``i + 1``.
    likelihood : array of the input's shape, float32
        Thinned fault likelihood, 0 to 1; zero off the ridges. A DataArray where the input was one.
    labels : array of the input's shape, int32
        0, or 1 + index of the surface that passes through the voxel.
    throw : array of the input's shape, float32
        Throw in samples at labelled voxels, NaN elsewhere.
    settings : dict
        The settings that gave this result.
    """

    surfaces: tuple[FaultSurface, ...]
    likelihood: Any
    labels: Any
    throw: Any
    settings: dict[str, Any] = field(default_factory=dict)
