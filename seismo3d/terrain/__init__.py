"""Terrain: maps read, aligned and compared; lineaments and scarps traced; a cube's faults carried up to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seismo3d._lazy import lazily

if TYPE_CHECKING:
    from seismo3d.geometry.map_grid import MapGrid
    from seismo3d.io.elevation import make_elevation, read_elevation, write_elevation
    from seismo3d.terrain.alignment import ElevationRegistration, register
    from seismo3d.terrain.change import Change, PointChange, compare, compare_points
    from seismo3d.terrain.exports import to_geojson, write_lineaments
    from seismo3d.terrain.fault_outcrops import Outcrop, outcrops
    from seismo3d.terrain.lineament_search import Lineament, LineamentSet, LineamentSettings, lineaments
    from seismo3d.terrain.scarp_profiles import Scarp, scarps

_PUBLIC = {
    "Change": "seismo3d.terrain.change",
    "ElevationRegistration": "seismo3d.terrain.alignment",
    "Lineament": "seismo3d.terrain.lineament_search",
    "LineamentSet": "seismo3d.terrain.lineament_search",
    "LineamentSettings": "seismo3d.terrain.lineament_search",
    "MapGrid": "seismo3d.geometry.map_grid",
    "Outcrop": "seismo3d.terrain.fault_outcrops",
    "PointChange": "seismo3d.terrain.change",
    "Scarp": "seismo3d.terrain.scarp_profiles",
    "compare": "seismo3d.terrain.change",
    "compare_points": "seismo3d.terrain.change",
    "lineaments": "seismo3d.terrain.lineament_search",
    "make_elevation": "seismo3d.io.elevation",
    "outcrops": "seismo3d.terrain.fault_outcrops",
    "read_elevation": "seismo3d.io.elevation",
    "register": "seismo3d.terrain.alignment",
    "scarps": "seismo3d.terrain.scarp_profiles",
    "to_geojson": "seismo3d.terrain.exports",
    "write_elevation": "seismo3d.io.elevation",
    "write_lineaments": "seismo3d.terrain.exports",
}

__all__ = [
    "Change",
    "ElevationRegistration",
    "Lineament",
    "LineamentSet",
    "LineamentSettings",
    "MapGrid",
    "Outcrop",
    "PointChange",
    "Scarp",
    "compare",
    "compare_points",
    "lineaments",
    "make_elevation",
    "outcrops",
    "read_elevation",
    "register",
    "scarps",
    "to_geojson",
    "write_elevation",
    "write_lineaments",
]

__getattr__, __dir__ = lazily(__name__, _PUBLIC)
