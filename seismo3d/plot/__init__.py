"""Pictures: sections, time slices and maps with matplotlib, 3D scenes with pyvista, and the report.

No function here changes matplotlib's or pyvista's settings. Functions that take ``ax`` draw on it; without one they
make a pyplot figure, to be shown with ``matplotlib.pyplot.show()`` and closed by the caller.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seismo3d.plot.distributions import strike_rose, throw_histogram
    from seismo3d.plot.maps import throw_map, time_slice
    from seismo3d.plot.match_pictures import matches
    from seismo3d.plot.rendering import save_scene
    from seismo3d.plot.reports import write_report
    from seismo3d.plot.scenes import cube
    from seismo3d.plot.sections import likelihood, section
    from seismo3d.plot.terrain_maps import change_map, lineament_rose, scarp_profile, terrain
    from seismo3d.plot.track_pictures import track_map, track_section

_PUBLIC = {
    "change_map": "terrain_maps",
    "cube": "scenes",
    "likelihood": "sections",
    "lineament_rose": "terrain_maps",
    "matches": "match_pictures",
    "save_scene": "rendering",
    "scarp_profile": "terrain_maps",
    "section": "sections",
    "strike_rose": "distributions",
    "terrain": "terrain_maps",
    "throw_histogram": "distributions",
    "throw_map": "maps",
    "time_slice": "maps",
    "track_map": "track_pictures",
    "track_section": "track_pictures",
    "write_report": "reports",
}

__all__ = [
    "change_map",
    "cube",
    "likelihood",
    "lineament_rose",
    "matches",
    "save_scene",
    "scarp_profile",
    "section",
    "strike_rose",
    "terrain",
    "throw_histogram",
    "throw_map",
    "time_slice",
    "track_map",
    "track_section",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'seismo3d.plot' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"seismo3d.plot.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
