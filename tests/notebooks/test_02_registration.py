"""The registration notebook runs from top to bottom, and its outputs are stripped."""

from __future__ import annotations

from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "02_registration.ipynb"


def test_notebook_runs():
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    book = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(cell.get("outputs") for cell in book.cells)
    done = nbclient.NotebookClient(book, timeout=300, kernel_name="python3").execute()
    text = "".join(str(cell.get("outputs", "")) for cell in done.cells)
    assert "fusion, by variance" in text
    assert "image/png" in text
