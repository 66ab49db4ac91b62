"""The robot side: maps of where a robot may go, and ways through them."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seismo3d.robot.occupancy import Occupancy
    from seismo3d.robot.planning import Path, Planner, RobotLimits, plan_path

_PUBLIC = {
    "Occupancy": "occupancy",
    "Path": "planning",
    "Planner": "planning",
    "RobotLimits": "planning",
    "plan_path": "planning",
}

__all__ = ["Occupancy", "Path", "Planner", "RobotLimits", "plan_path"]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'seismo3d.robot' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"seismo3d.robot.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
