"""Faults, tracks and throws from seismic cubes, by registration; the same matcher maps terrain.

The flow of data, top to bottom::

    open_cube          SEG-Y, Zarr or NPY -> cube (xarray.DataArray: inline, crossline, time or depth)
    trace_faults       cube -> FaultSet (likelihood, labels, throw, surfaces)
    layer_time         cube, FaultSet -> layer time of every voxel
    trace_tracks       cube, seeds, FaultSet -> Tracks (horizons through the cube and across its faults)
    FaultSet.save      surfaces and volumes to a folder
    Scan, register     any two scans -> Registration (transform, covariance, certificate)
    match              images, sections or cubes -> Matches (places in common, with angle and scale)
    describe           image or cube -> Features, to be matched many times; PlaceIndex finds the like among them
    terrain            elevation maps: alignment, change, lineaments and scarps
    plot               sections, time slices and 3D scenes

Every name is imported when it is first used, so that ``import seismo3d`` stays light.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from seismo3d import plot, synthetic, terrain
    from seismo3d.features.describing import Features, describe
    from seismo3d.features.matching import Matches, match
    from seismo3d.features.places import PlaceIndex
    from seismo3d.io.cubes import as_cube, open_cube
    from seismo3d.io.segy import write_segy
    from seismo3d.registration.align import align_pairs
    from seismo3d.registration.constraints import Constraints
    from seismo3d.registration.register import register
    from seismo3d.registration.result import Registration
    from seismo3d.scan import Scan
    from seismo3d.seismic.faults import trace_faults
    from seismo3d.seismic.faultset import FaultSet
    from seismo3d.seismic.layer_time import layer_time
    from seismo3d.seismic.tracks import Track, trace_tracks

_PUBLIC = {
    "Constraints": "seismo3d.registration.constraints",
    "FaultSet": "seismo3d.seismic.faultset",
    "Features": "seismo3d.features.describing",
    "Matches": "seismo3d.features.matching",
    "PlaceIndex": "seismo3d.features.places",
    "Registration": "seismo3d.registration.result",
    "Scan": "seismo3d.scan",
    "Track": "seismo3d.seismic.tracks",
    "align_pairs": "seismo3d.registration.align",
    "as_cube": "seismo3d.io.cubes",
    "describe": "seismo3d.features.describing",
    "layer_time": "seismo3d.seismic.layer_time",
    "match": "seismo3d.features.matching",
    "open_cube": "seismo3d.io.cubes",
    "register": "seismo3d.registration.register",
    "trace_faults": "seismo3d.seismic.faults",
    "trace_tracks": "seismo3d.seismic.tracks",
    "write_segy": "seismo3d.io.segy",
}
_MODULES = ("plot", "synthetic", "terrain")

__all__ = [
    "Constraints",
    "FaultSet",
    "Features",
    "Matches",
    "PlaceIndex",
    "Registration",
    "Scan",
    "Track",
    "__version__",
    "align_pairs",
    "as_cube",
    "describe",
    "layer_time",
    "match",
    "open_cube",
    "plot",
    "register",
    "synthetic",
    "terrain",
    "trace_faults",
    "trace_tracks",
    "write_segy",
]


def __getattr__(name: str) -> Any:
    if name in _PUBLIC:
        value = getattr(importlib.import_module(_PUBLIC[name]), name)
    elif name in _MODULES:
        value = importlib.import_module(f"seismo3d.{name}")
    else:
        raise AttributeError(f"module 'seismo3d' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
