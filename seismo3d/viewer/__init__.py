"""The viewer: slices, faults and horizons in the browser or a notebook, to look at, to trace and to edit.

``seismo3d view`` opens it from the command line, :func:`show` from Python, :func:`widget` in a notebook.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from seismo3d._lazy import lazily

if TYPE_CHECKING:
    from seismo3d.viewer.opening import Widget, show, widget
    from seismo3d.viewer.session import Session

_PUBLIC = {
    "Session": "seismo3d.viewer.session",
    "Widget": "seismo3d.viewer.opening",
    "show": "seismo3d.viewer.opening",
    "widget": "seismo3d.viewer.opening",
}

__all__ = ["Session", "Widget", "show", "widget"]

__getattr__, __dir__ = lazily(__name__, _PUBLIC)
