"""Fixtures shared by all tests."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


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


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium of the system: SEISMO3D_CHROMIUM names it, else it is searched for."""
    playwright = pytest.importorskip("playwright.sync_api")
    # Debian's own launcher is a script around this file
    inner = Path("/usr/lib/chromium/chromium")
    found = os.environ.get("SEISMO3D_CHROMIUM") or (str(inner) if inner.is_file() else None)
    found = found or next(filter(None, map(shutil.which, _BROWSERS)), None)
    if found is None:
        pytest.skip("no Chromium on this machine: set SEISMO3D_CHROMIUM to one")
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=found, args=_FLAGS)
        yield opened
        opened.close()
