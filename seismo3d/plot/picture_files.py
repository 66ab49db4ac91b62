"""Pictures to files: complete, or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from seismo3d.io._files import check_output, written_aside

PICTURES = (".png", ".pdf", ".svg", ".eps", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
"""Endings of the pictures that are written."""


def save_figure(figure: Any, path: str | Path, *, dpi: int) -> Path:
    """Write a figure of matplotlib to a file, in the form that its name tells."""
    path = check_output(path, endings=PICTURES)
    with written_aside(path) as aside:
        figure.savefig(aside, format=path.suffix[1:].lower(), dpi=dpi)
    return path
