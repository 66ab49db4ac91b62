"""Fault sticks from fault surfaces: cut by inline or crossline planes, as an interpreter would pick them."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d._validate import as_whole_number
from seismo3d.geometry.survey import SectionGeometry, SurveyGeometry, geometry_of
from seismo3d.geometry.triangles import cut_mesh, join_segments, simplify_line
from seismo3d.io.fault_sticks import FaultStick
from seismo3d.seismic.faultset import FaultSet, FaultSurface

_TOLERANCE = 0.25  # of a bin or sample: below what a hand on a mouse resolves
_FEWEST = 3  # sticks that any surface should get, where it is wide enough


def cut_sticks(faults: FaultSet, cube: Any, *, spacing: int = 5) -> list[FaultStick]:
    """Cut every fault into sticks.

    A fault is cut by inline planes where it strikes more across the inlines than along them, else by crossline planes.
    Each stick runs from top to foot, without the points that lie within a quarter of a bin of its course. In a section
    each fault line is one stick, at the section's inline and crossline numbers, or at inline 0 and its CDP numbers.

    Parameters
    ----------
    faults : FaultSet
        The faults of ``cube``.
    cube : DataArray or ndarray
        Gives the coordinates; bare arrays give indices.
    spacing : int
        Lines from one stick to the next; planes lie on whole multiples of it. Surfaces too narrow for three sticks are
        cut more closely.

    Returns
    -------
    list of FaultStick
        Fault by fault, in map coordinates where they are known, else line numbers.
    """
    step = as_whole_number(spacing, "spacing", low=1)
    section = np.ndim(faults.labels) == 2
    geometry = geometry_of(cube)
    sticks: list[FaultStick] = []
    for number, surface in enumerate(faults.surfaces, start=1):
        lines = _section_lines(surface) if section else _surface_lines(surface, step)
        for count, line in enumerate(lines, start=1):
            points, numbers = _place(line, geometry, cube)
            sticks.append(FaultStick(f"fault_{number:03d}", count, points, numbers))
    return sticks


def stick_axis(surface: FaultSurface) -> int:
    """Tell which planes cross a surface's strike best: 0 for inline planes, 1 for crossline planes."""
    horizontal = np.abs(np.asarray(surface.normals, dtype=np.float64)[:, :2]).mean(axis=0)
    return 0 if horizontal[1] >= horizontal[0] else 1


def _surface_lines(surface: FaultSurface, step: int) -> list[Float64Array]:
    axis = stick_axis(surface)
    low, high = surface.vertices[:, axis].min(), surface.vertices[:, axis].max()
    step = max(1, min(step, int((high - low) // _FEWEST)))
    planes = range(int(np.ceil(low / step)) * step, int(np.floor(high)) + 1, step)
    lines = []
    for plane in planes:
        cut = cut_mesh(surface.vertices, surface.cells, axis=axis, value=float(plane))
        lines += [cut.points[chain] for chain in join_segments(cut.segments)]
    return [_tidy(line) for line in lines]


def _section_lines(surface: FaultSurface) -> list[Float64Array]:
    vertices = np.asarray(surface.vertices, dtype=np.float64)
    return [_tidy(vertices[chain]) for chain in join_segments(surface.cells)]


def _tidy(line: AnyArray) -> Float64Array:
    downwards = line if line[-1, -1] >= line[0, -1] else line[::-1]
    return np.asarray(downwards[simplify_line(downwards, tolerance=_TOLERANCE)], dtype=np.float64)


def _place(
    line: Float64Array, geometry: SurveyGeometry | SectionGeometry, cube: Any
) -> tuple[Float64Array, Float64Array]:
    """Map coordinates and line numbers of a stick's nodes."""
    if isinstance(geometry, SurveyGeometry):
        return geometry.index_to_map(line), geometry.index_to_lines(line)[:, :2]
    return geometry.index_to_map(line), _section_numbers(line[:, 0], cube)


def _section_numbers(index: Float64Array, section: Any) -> Float64Array:
    """Inline and crossline numbers along a section; one without them is inline 0, and its CDPs are its crosslines."""
    known = getattr(section, "coords", {})
    traces = np.arange(np.shape(section)[0], dtype=np.float64)
    inline = known.get("inline", 0.0)
    crossline = next((known[name] for name in ("crossline", "cdp", "trace") if name in known), traces)
    numbers = (np.broadcast_to(np.asarray(n, dtype=np.float64), traces.shape) for n in (inline, crossline))
    return np.column_stack([np.interp(index, traces, n) for n in numbers])
