from __future__ import annotations

import numpy as np
import pytest
from fake_terrain import make_hills


@pytest.fixture(scope="session")
def hills() -> np.ndarray:
    return make_hills((240, 300))
