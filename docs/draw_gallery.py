"""Run the notebooks and keep the richest picture of each for the gallery: ``python docs/draw_gallery.py``."""

from __future__ import annotations

import base64
import io
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
WIDTH = 900


def draw(path: Path) -> Path:
    """Run one notebook, and write the picture of it that has the most colours."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": str(ROOT)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    shown = [output["data"]["image/png"] for output in outputs if "image/png" in output.get("data", {})]
    drawn = [Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB") for data in shown]
    picture = max(drawn, key=lambda image: len(image.getcolors(2**24) or ()))
    picture.thumbnail((WIDTH, WIDTH))
    target = ROOT / "docs" / "gallery" / f"{path.stem}.png"
    picture.quantize(256, dither=Image.Dither.FLOYDSTEINBERG).save(target, optimize=True)
    return target


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(str(path) for path in (ROOT / "notebooks").glob("*.ipynb")):
        print(draw(Path(name)))
