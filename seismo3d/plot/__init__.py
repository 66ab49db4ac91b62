"""Pictures: sections, time slices and maps with matplotlib, 3D scenes with pyvista, and the report.

No function here changes matplotlib's or pyvista's settings. Functions that take ``ax`` draw on it; without one they
make a pyplot figure, to be shown with ``matplotlib.pyplot.show()`` and closed by the caller.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from seismo3d._lazy import lazily

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
    "change_map": "seismo3d.plot.terrain_maps",
    "cube": "seismo3d.plot.scenes",
    "density_map": "seismo3d.plot.network_pictures",
    "flow_path_views": "seismo3d.plot.network_pictures",
    "likelihood": "seismo3d.plot.sections",
    "lineament_rose": "seismo3d.plot.terrain_maps",
    "loop_map": "seismo3d.plot.track_pictures",
    "matches": "seismo3d.plot.match_pictures",
    "occupancy_map": "seismo3d.plot.robot_maps",
    "network_map": "seismo3d.plot.network_pictures",
    "pick_distance_map": "seismo3d.plot.pick_pictures",
    "picked_faults_map": "seismo3d.plot.pick_pictures",
    "save_scene": "seismo3d.plot.rendering",
    "scarp_profile": "seismo3d.plot.terrain_maps",
    "section": "seismo3d.plot.sections",
    "stereonet": "seismo3d.plot.stereonets",
    "strike_rose": "seismo3d.plot.distributions",
    "terrain": "seismo3d.plot.terrain_maps",
    "throw_histogram": "seismo3d.plot.distributions",
    "throw_map": "seismo3d.plot.maps",
    "time_lapse_section": "seismo3d.plot.time_lapse_sections",
    "time_slice": "seismo3d.plot.maps",
    "track_map": "seismo3d.plot.track_pictures",
    "track_section": "seismo3d.plot.track_pictures",
    "unfaulted_section": "seismo3d.plot.unfaulted_sections",
    "write_report": "seismo3d.plot.reports",
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

__getattr__, __dir__ = lazily(__name__, _PUBLIC)
