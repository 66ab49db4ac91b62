from __future__ import annotations

import pytest
from fake_faults import make_cube, make_faults


@pytest.fixture
def cube():
    return make_cube()


@pytest.fixture
def faults(cube):
    return make_faults(cube)
