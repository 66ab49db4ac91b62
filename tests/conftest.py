"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder with real data, named by SEISMO3D_DATA; tests that need it skip where it is absent."""
    folder = os.environ.get("SEISMO3D_DATA", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("real data is absent: set SEISMO3D_DATA to the folder that holds it")
    return Path(folder)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20240817)
