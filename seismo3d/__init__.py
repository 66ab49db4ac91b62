"""Faults, tracks and throws from seismic cubes, by registration; the same matcher maps terrain.

The flow of data, top to bottom::

    open_cube          SEG-Y, Zarr or NPY -> cube (xarray.DataArray: inline, crossline, time or depth)
    trace_faults       cube -> FaultSet (likelihood, labels, throw, surfaces)
    layer_time         cube, FaultSet -> layer time of every voxel
    loop_closure       cube, FaultSet -> how well its shifts agree round closed loops
    trace_tracks       cube, seeds, FaultSet -> Tracks (horizons through the cube and across its faults)
    find_horizons      cube -> its best Tracks, without seeds
    align_cubes        base, monitor -> shifts with their uncertainty, and the aligned monitor (time lapse)
    unfault            cube, FaultSet -> the cube with the slip taken out
    fracture_network   FaultSet -> FractureNetwork (who meets whom, density, orientations); flow_path through it
    follow_stick       a fault stick, picked on one slice, to the slices beside it
    read_sticks, read_horizon   an interpreter's picks -> seeds, or score_sticks and score_horizon
    FaultSet.save      surfaces and volumes to a folder
    Scan, register     any two scans -> Registration (transform, covariance, certificate)
    match              images, sections or cubes -> Matches (places in common, with angle and scale)
    describe           image or cube -> Features, to be matched many times; PlaceIndex finds the like among them
    terrain            elevation maps: alignment, change, lineaments and scarps
    robot              dense maps and trajectories from RGB-D cameras; ways for a robot through them
    plot               sections, time slices and 3D scenes
    viewer             the same in the browser or a notebook, to trace from clicks and to edit

Every name is imported when it is first used, so that ``import seismo3d`` stays light.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from seismo3d._lazy import lazily

__version__ = "0.1.0"

if TYPE_CHECKING:
    from seismo3d import plot, robot, synthetic, terrain, viewer
    from seismo3d.features.describing import Features, describe
    from seismo3d.features.matching import Matches, match
    from seismo3d.features.places import PlaceIndex
    from seismo3d.io.cubes import as_cube, open_cube
    from seismo3d.io.fault_sticks import read_sticks
    from seismo3d.io.horizons import read_horizon
    from seismo3d.io.segy import write_segy
    from seismo3d.registration.align import align_pairs
    from seismo3d.registration.constraints import Constraints
    from seismo3d.registration.register import register
    from seismo3d.registration.result import Registration
    from seismo3d.scan import Scan
    from seismo3d.seismic.faults import trace_faults
    from seismo3d.seismic.faultset import FaultSet
    from seismo3d.seismic.flow_paths import FlowPath, flow_path
    from seismo3d.seismic.horizon_scores import score_horizon
    from seismo3d.seismic.horizon_search import find_horizons
    from seismo3d.seismic.layer_time import layer_time
    from seismo3d.seismic.loop_closure import loop_closure
    from seismo3d.seismic.network import FractureNetwork, fracture_network
    from seismo3d.seismic.stick_scores import score_sticks
    from seismo3d.seismic.stick_tracking import follow_stick
    from seismo3d.seismic.time_lapse import align_cubes
    from seismo3d.seismic.tracks import Track, trace_tracks
    from seismo3d.seismic.unfaulting import unfault

_PUBLIC = {
    "Constraints": "seismo3d.registration.constraints",
    "FaultSet": "seismo3d.seismic.faultset",
    "Features": "seismo3d.features.describing",
    "FlowPath": "seismo3d.seismic.flow_paths",
    "FractureNetwork": "seismo3d.seismic.network",
    "Matches": "seismo3d.features.matching",
    "PlaceIndex": "seismo3d.features.places",
    "Registration": "seismo3d.registration.result",
    "Scan": "seismo3d.scan",
    "Track": "seismo3d.seismic.tracks",
    "align_cubes": "seismo3d.seismic.time_lapse",
    "align_pairs": "seismo3d.registration.align",
    "as_cube": "seismo3d.io.cubes",
    "describe": "seismo3d.features.describing",
    "find_horizons": "seismo3d.seismic.horizon_search",
    "flow_path": "seismo3d.seismic.flow_paths",
    "follow_stick": "seismo3d.seismic.stick_tracking",
    "fracture_network": "seismo3d.seismic.network",
    "layer_time": "seismo3d.seismic.layer_time",
    "loop_closure": "seismo3d.seismic.loop_closure",
    "match": "seismo3d.features.matching",
    "open_cube": "seismo3d.io.cubes",
    "read_horizon": "seismo3d.io.horizons",
    "read_sticks": "seismo3d.io.fault_sticks",
    "register": "seismo3d.registration.register",
    "score_horizon": "seismo3d.seismic.horizon_scores",
    "score_sticks": "seismo3d.seismic.stick_scores",
    "trace_faults": "seismo3d.seismic.faults",
    "trace_tracks": "seismo3d.seismic.tracks",
    "unfault": "seismo3d.seismic.unfaulting",
    "write_segy": "seismo3d.io.segy",
}
_MODULES = ("plot", "robot", "synthetic", "terrain", "viewer")

__all__ = [
    "Constraints",
    "FaultSet",
    "Features",
    "FlowPath",
    "FractureNetwork",
    "Matches",
    "PlaceIndex",
    "Registration",
    "Scan",
    "Track",
    "__version__",
    "align_cubes",
    "align_pairs",
    "as_cube",
    "describe",
    "find_horizons",
    "flow_path",
    "follow_stick",
    "fracture_network",
    "layer_time",
    "loop_closure",
    "match",
    "open_cube",
    "plot",
    "read_horizon",
    "read_sticks",
    "register",
    "robot",
    "score_horizon",
    "score_sticks",
    "synthetic",
    "terrain",
    "trace_faults",
    "trace_tracks",
    "unfault",
    "viewer",
    "write_segy",
]

__getattr__, __dir__ = lazily(__name__, _PUBLIC, _MODULES)
