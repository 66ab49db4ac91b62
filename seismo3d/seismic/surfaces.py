"""Sheets turned into surfaces: triangles or segments, with normals, strike, dip, likelihood and throw."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array, IntArray
from seismo3d._validate import freeze
from seismo3d.geometry.survey import SurveyGeometry
from seismo3d.geometry.triangles import measure_cells
from seismo3d.seismic.doubles import normals_of
from seismo3d.seismic.extending import local_planes
from seismo3d.seismic.faultset import FaultSurface, surface_confidence
from seismo3d.seismic.index_frame import IndexFrame
from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetThrow

# width, in nodes, of the window in which planes are fitted, and what is added to the spread of the places in it
_WIDTH, _SPREAD = 6.0, 1e-6


def build_surface(
    sheet: Sheet,
    throw: SheetThrow,
    today: SheetThrow,
    likelihood: Float32Array,
    shape: tuple[int, ...],
    *,
    geometry: SurveyGeometry | None,
    sampling: tuple[float, str],
) -> FaultSurface:
    """Turn a sheet into a surface.

    Parameters
    ----------
    sheet : Sheet
        The fault as a height field.
    throw : SheetThrow
        Its throw when it moved.
    today : SheetThrow
        What lies apart today.
    likelihood : ndarray of the sheet's shape, float32
        Fault likelihood at its nodes.
    shape : tuple of int
        Traces and samples of the cube, (inline, crossline, sample): the surface ends at the outer ones.
    geometry : SurveyGeometry or None
        Turns normals into strikes and dips; None for a section, whose surface is a polyline in (trace, sample).
    sampling : tuple of (float, str)
        Sample interval and its unit.

    Returns
    -------
    FaultSurface
    """
    rows, columns, vertices, cells = _mesh(sheet, shape)
    normals = _normals(sheet, (rows, columns)) * throw.hanging_side
    upright = normals if geometry is None else IndexFrame.of_survey(geometry).normals(normals)
    dip_deg = np.degrees(np.arccos(np.clip(np.abs(upright[:, 2]), 0.0, 1.0)))
    if geometry is None:
        trace = int(np.argmax(np.abs(sheet.across)))
        keep = [trace, 2]
        vertices, normals = vertices[:, keep], normals[:, keep]
        strike_deg = np.full(len(vertices), np.nan)
    else:
        strike_deg = geometry.strike_deg(normals)
    area = float(measure_cells(vertices, cells).sum())
    at_nodes = likelihood[rows, columns]
    return FaultSurface(
        vertices=_frozen32(vertices),
        cells=freeze(cells),
        normals=_frozen32(normals),
        likelihood=_frozen32(at_nodes),
        throw=_frozen32(throw.throw[rows, columns]),
        separation=_frozen32(today.throw[rows, columns]),
        throw_fit=_frozen32(throw.fit[rows, columns]),
        strike_deg=_frozen32(strike_deg),
        dip_deg=_frozen32(dip_deg),
        sample_interval=sampling[0],
        sample_unit=sampling[1],
        confidence=surface_confidence(at_nodes, area),
        area=area,
        # where a sheet's `across` points to the hanging wall its `along` lies against the strike
        strike_share=-throw.hanging_side * throw.strike_share if geometry is not None else 0.0,
        slip_certainty=throw.slip_certainty,
        family=throw.family,
        generation=throw.generation,
        lift=throw.lift,
    )


def order_by_area(sheets: list[Sheet], shape: tuple[int, ...]) -> list[int]:
    """Return the numbers of sheets in the order of the areas that they have as surfaces, largest first."""
    areas = [float(measure_cells(*_mesh(sheet, shape)[2:]).sum()) for sheet in sheets]
    return sorted(range(len(sheets)), key=lambda n: -areas[n])


def _mesh(sheet: Sheet, shape: tuple[int, ...]) -> tuple[IntArray, IntArray, Float64Array, Int32Array]:
    """Return the row and the column of every node that some cell uses, their places, and the cells."""
    number = _number_nodes(sheet)
    rows, columns = np.nonzero(number >= 0)
    vertices = sheet.points(rows.astype(float), columns.astype(float), sheet.w[rows, columns].astype(float))
    # the nodes of a sheet that follows its own strike do not fall on the outer traces
    vertices = np.clip(vertices, 0.0, np.array(shape, dtype=np.float64) - 1.0)
    return rows, columns, vertices, _segments(number) if len(number) == 1 else _triangles(number)


def _frozen32(values: Any) -> Any:
    return freeze(np.ascontiguousarray(values, dtype=np.float32))


def _number_nodes(sheet: Sheet) -> Int32Array:
    """Give a number to every node that some cell uses; -1 to the others."""
    inside = sheet.inside
    used = np.zeros_like(inside)
    if inside.shape[0] == 1:
        pair = inside[:, :-1] & inside[:, 1:]
        used[:, :-1] |= pair
        used[:, 1:] |= pair
    else:
        quad = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
        for down in (slice(None, -1), slice(1, None)):
            for right in (slice(None, -1), slice(1, None)):
                used[down, right] |= quad
    number = np.full(inside.shape, -1, np.int32)
    number[used] = np.arange(int(used.sum()), dtype=np.int32)
    return number


def _triangles(number: Int32Array) -> Int32Array:
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
    quad = (a >= 0) & (b >= 0) & (c >= 0) & (d >= 0)
    first = np.column_stack([a[quad], b[quad], c[quad]])
    second = np.column_stack([b[quad], d[quad], c[quad]])
    return np.concatenate([first, second]).astype(np.int32)


def _segments(number: Int32Array) -> Int32Array:
    a, b = number[0, :-1], number[0, 1:]
    pair = (a >= 0) & (b >= 0)
    return np.column_stack([a[pair], b[pair]]).astype(np.int32)


def _normals(sheet: Sheet, at: tuple[IntArray, IntArray]) -> Float64Array:
    """Return the unit normals at nodes, along the sheet's `across`, of the planes that fit best around them.

    From one node to the next its height is known to a good part of a trace only: steps there tell little of its lie.
    """
    return normals_of(sheet, local_planes(sheet.w.astype(np.float64), sheet.inside, at, _WIDTH, spread=_SPREAD))
