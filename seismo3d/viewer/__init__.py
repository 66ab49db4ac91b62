"""The viewer: slices, faults and horizons in the browser or a notebook, to look at, to trace and to edit.

``seismo3d view`` opens it from the command line, :func:`show` from Python, :func:`widget` in a notebook.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from seismo3d.viewer.opening import Widget, show, widget
    from seismo3d.viewer.session import Session

_PUBLIC = {"Session": "session", "Widget": "opening", "show": "opening", "widget": "opening"}

__all__ = ["Session", "Widget", "show", "widget"]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'seismo3d.viewer' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"seismo3d.viewer.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
