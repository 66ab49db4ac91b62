"""The list of faults and horizons beside the panels."""

from __future__ import annotations

import math
from typing import Any

from seismo3d._typing import AnyArray
from seismo3d.geometry.triangles import weigh_vertices
from seismo3d.plot.traces_of_faults import display_throw
from seismo3d.seismic.fault_table import weighted_mean
from seismo3d.seismic.faultset import FaultSurface
from seismo3d.viewer.colours import Scale
from seismo3d.viewer.interpretation import Fault, Interpretation
from seismo3d.viewer.panels import HORIZON_COLOURS


def list_rows(state: Interpretation, scale: Scale) -> list[dict[str, Any]]:
    """Return a row a fault and a row a horizon, of plain values.

    Parameters
    ----------
    state : Interpretation
        What is listed.
    scale : Scale
        Colours of the faults.

    Returns
    -------
    list of dict
        ``number``, ``kind``, ``name``, ``colour``; of a fault ``area``, ``throw`` in ``unit``, ``dip`` and
        ``confidence``; of a horizon ``share``, percent of all traces.
    """
    rows = [_fault_row(fault, scale) for fault in state.faults]
    for k, horizon in enumerate(state.horizons):
        row: dict[str, Any] = {"number": horizon.number, "kind": "horizon", "name": f"horizon {horizon.number}"}
        share, colour = round(100 * horizon.track.share, 1), HORIZON_COLOURS[k % len(HORIZON_COLOURS)]
        rows.append({**row, "share": share, "colour": colour})
    return rows


def _fault_row(fault: Fault, scale: Scale) -> dict[str, Any]:
    throw, unit = display_throw(fault.surface)
    return {
        "number": fault.number,
        "kind": "fault",
        "name": f"fault {fault.number}",
        "area": round(fault.surface.area),
        "throw": _mean(fault.surface, throw),
        "unit": unit,
        "dip": _mean(fault.surface, fault.surface.dip_deg),
        "confidence": round(float(fault.surface.confidence), 2),
        "colour": scale.shade(fault.number - 1) if scale.attribute == "fault" else "",
    }


def _mean(surface: FaultSurface, values: AnyArray) -> float | None:
    """Mean by area, as in faults.csv."""
    mean = weighted_mean(values, weigh_vertices(surface.vertices, surface.cells))
    return round(mean, 1) if math.isfinite(mean) else None
