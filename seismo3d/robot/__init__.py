"""The robot side: dense maps and trajectories from RGB-D cameras, and ways through them."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seismo3d.robot.calibration import calibrate_timing
    from seismo3d.robot.camera import Camera, RgbdFrame
    from seismo3d.robot.mapper import Mapper
    from seismo3d.robot.occupancy import Occupancy
    from seismo3d.robot.planning import Path, Planner, RobotLimits, plan_path
    from seismo3d.robot.results import Closed, MapperSettings, Tracked
    from seismo3d.robot.sequence import RgbdSequence, read_sequence
    from seismo3d.robot.trajectory import Trajectory

_PUBLIC = {
    "Camera": "camera",
    "Closed": "results",
    "Mapper": "mapper",
    "MapperSettings": "results",
    "Occupancy": "occupancy",
    "Path": "planning",
    "Planner": "planning",
    "RgbdFrame": "camera",
    "RgbdSequence": "sequence",
    "RobotLimits": "planning",
    "Tracked": "results",
    "Trajectory": "trajectory",
    "calibrate_timing": "calibration",
    "plan_path": "planning",
    "read_sequence": "sequence",
}

__all__ = [
    "Camera",
    "Closed",
    "Mapper",
    "MapperSettings",
    "Occupancy",
    "Path",
    "Planner",
    "RgbdFrame",
    "RgbdSequence",
    "RobotLimits",
    "Tracked",
    "Trajectory",
    "calibrate_timing",
    "plan_path",
    "read_sequence",
]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'seismo3d.robot' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"seismo3d.robot.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
