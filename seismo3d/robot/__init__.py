"""The robot side: dense maps and trajectories from RGB-D cameras, and ways through them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seismo3d._lazy import lazily

if TYPE_CHECKING:
    from seismo3d.robot.calibration import calibrate_timing
    from seismo3d.robot.camera import Camera, LensErrors, RgbdFrame
    from seismo3d.robot.mapper import Mapper
    from seismo3d.robot.occupancy import Occupancy
    from seismo3d.robot.planning import Path, Planner, RobotLimits, plan_path
    from seismo3d.robot.results import Closed, MapperSettings, Tracked
    from seismo3d.robot.sequence import RgbdSequence, read_sequence
    from seismo3d.robot.trajectory import Trajectory

_PUBLIC = {
    "Camera": "seismo3d.robot.camera",
    "Closed": "seismo3d.robot.results",
    "LensErrors": "seismo3d.robot.camera",
    "Mapper": "seismo3d.robot.mapper",
    "MapperSettings": "seismo3d.robot.results",
    "Occupancy": "seismo3d.robot.occupancy",
    "Path": "seismo3d.robot.planning",
    "Planner": "seismo3d.robot.planning",
    "RgbdFrame": "seismo3d.robot.camera",
    "RgbdSequence": "seismo3d.robot.sequence",
    "RobotLimits": "seismo3d.robot.planning",
    "Tracked": "seismo3d.robot.results",
    "Trajectory": "seismo3d.robot.trajectory",
    "calibrate_timing": "seismo3d.robot.calibration",
    "plan_path": "seismo3d.robot.planning",
    "read_sequence": "seismo3d.robot.sequence",
}

__all__ = [
    "Camera",
    "Closed",
    "LensErrors",
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

__getattr__, __dir__ = lazily(__name__, _PUBLIC)
