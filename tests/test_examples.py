"""Every example runs as a script, in an empty folder, from start to end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


RESULTS = {"01_faults": {"slices.png", "surfaces.ts", "surfaces.vtp", "faults.csv", "faultset.npz", "likelihood.sgy"}}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(path: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "MPLBACKEND": "agg", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(path)]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=500, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout
    written = {file.name for file in tmp_path.rglob("*") if file.is_file() and file.stat().st_size > 0}
    assert RESULTS.get(path.stem, set()) <= written
