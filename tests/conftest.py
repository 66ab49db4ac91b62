"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import numba
import numpy as np
import pytest


def pytest_configure() -> None:
    """Share the processors out among the processes that run tests side by side."""
    n_processes = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    numba.set_num_threads(max(1, numba.config.NUMBA_NUM_THREADS // n_processes))


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
