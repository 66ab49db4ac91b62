"""Every notebook runs from a clean kernel and shows what it says; what is kept in the project has no outputs."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from PIL import Image

from seismo3d.plot.rendering import find_windowless

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
PRINTED = {"02_registration": "fusion, by variance", "04_tracks": "within 1 sample of the truth on 100"}


def pictures(cell: Any) -> list[np.ndarray]:
    shown = [output["data"]["image/png"] for output in cell.outputs if "image/png" in output.get("data", {})]
    return [np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int) for data in shown]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_has_no_outputs(path: Path) -> None:
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code":
            assert cell.outputs == []
            assert cell.execution_count is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs_and_shows_pictures(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    draws = any("plot." in cell.source for cell in notebook.cells if cell.cell_type == "code")
    if draws and (problem := find_windowless()[1]):
        pytest.skip(f"no renderer: {problem}")
    client = NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(ROOT)}})
    client.execute()
    printed = "".join(str(cell.get("outputs", "")) for cell in notebook.cells)
    assert PRINTED.get(path.stem, "") in printed
    for cell in notebook.cells:
        drawn = "plot." in cell.source and cell.cell_type == "code"
        if not drawn:
            continue
        found = pictures(cell)
        assert found, cell.source
        assert all(len(np.unique(image.reshape(-1, 3), axis=0)) > 50 for image in found)
        if "faults=faults" in cell.source:  # faults are in colour, amplitudes in grey
            assert (np.ptp(found[-1], axis=2) > 60).sum() > 500, cell.source
