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
    from seismo3d.plot.network_pictures import density_map, flow_path_views, network_map
    from seismo3d.plot.pick_pictures import pick_distance_map, picked_faults_map
    from seismo3d.plot.rendering import save_scene
    from seismo3d.plot.reports import write_report
    from seismo3d.plot.robot_maps import occupancy_map
    from seismo3d.plot.scenes import cube
    from seismo3d.plot.sections import likelihood, section
    from seismo3d.plot.stereonets import stereonet
    from seismo3d.plot.terrain_maps import change_map, lineament_rose, scarp_profile, terrain
    from seismo3d.plot.time_lapse_sections import time_lapse_section
    from seismo3d.plot.track_pictures import loop_map, track_map, track_section
    from seismo3d.plot.unfaulted_sections import unfaulted_section

_PUBLIC = {
    "change_map": "terrain_maps",
    "cube": "scenes",
    "density_map": "network_pictures",
    "flow_path_views": "network_pictures",
    "likelihood": "sections",
    "lineament_rose": "terrain_maps",
    "loop_map": "track_pictures",
    "matches": "match_pictures",
    "occupancy_map": "robot_maps",
    "network_map": "network_pictures",
    "pick_distance_map": "pick_pictures",
    "picked_faults_map": "pick_pictures",
    "save_scene": "rendering",
    "scarp_profile": "terrain_maps",
    "section": "sections",
    "stereonet": "stereonets",
    "strike_rose": "distributions",
    "terrain": "terrain_maps",
    "throw_histogram": "distributions",
    "throw_map": "maps",
    "time_lapse_section": "time_lapse_sections",
    "time_slice": "maps",
    "track_map": "track_pictures",
    "track_section": "track_pictures",
    "unfaulted_section": "unfaulted_sections",
    "write_report": "reports",
}

__all__ = [
    "change_map",
    "cube",
    "density_map",
    "flow_path_views",
    "likelihood",
    "lineament_rose",
    "loop_map",
    "matches",
    "network_map",
    "occupancy_map",
    "pick_distance_map",
    "picked_faults_map",
    "save_scene",
    "scarp_profile",
    "section",
    "stereonet",
    "strike_rose",
    "terrain",
    "throw_histogram",
    "throw_map",
    "time_lapse_section",
    "time_slice",
    "track_map",
    "track_section",
    "unfaulted_section",
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
