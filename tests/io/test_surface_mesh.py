from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import ShapeError
from seismo3d.io.surface_mesh import SurfaceMesh
from seismo3d.io.tables import write_csv
from seismo3d.io.vtk_surfaces import write_vtp

POINTS, CELLS = np.zeros((3, 3)), np.array([[0, 1, 2]])


def test_refusals() -> None:
    with pytest.raises(ShapeError, match=r"points of f have shape \(3, 2\)"):
        SurfaceMesh("f", np.zeros((3, 2)), CELLS)
    with pytest.raises(ShapeError, match="cells of f have shape"):
        SurfaceMesh("f", POINTS, np.zeros((1, 4), int))
    with pytest.raises(ShapeError, match="name points 0 to 3; there are 3"):
        SurfaceMesh("f", POINTS, np.array([[0, 1, 3]]))
    with pytest.raises(ShapeError, match="property a of f"):
        SurfaceMesh("f", POINTS, CELLS, {"a": np.zeros(2)})


def test_vtp_refuses_surfaces_of_different_kinds(tmp_path: Path) -> None:
    one, other = SurfaceMesh("a", POINTS, CELLS, {"x": np.zeros(3)}), SurfaceMesh("b", POINTS, CELLS)
    with pytest.raises(ShapeError, match="different properties"):
        write_vtp(tmp_path / "a.vtp", [one, other], notes={})
    assert list(tmp_path.iterdir()) == []


def test_csv_cells(tmp_path: Path) -> None:
    rows = [{"a": 1, "b": float("nan"), "c": 'x,"y"'}, {"a": 1234567.123456, "b": None, "c": "z"}]
    write_csv(tmp_path / "t.csv", rows, columns=("a", "b", "c"))
    assert (tmp_path / "t.csv").read_text() == 'a,b,c\n1,,"x,""y"""\n1234567.1235,,z\n'


def test_small_numbers_in_csv_keep_six_digits(tmp_path: Path) -> None:
    values = [0.0060864412, 3.0000001e-7, 12.345678, -1.0 / 3.0, -1e-14, 0.0, 99999.99999, 1e30]
    write_csv(tmp_path / "t.csv", [{"a": value} for value in values], columns=("a",))
    written = ["0.00608644", "3e-07", "12.3457", "-0.333333", "0", "0", "100000", "1e+30"]
    assert (tmp_path / "t.csv").read_text().split() == ["a", *written]
