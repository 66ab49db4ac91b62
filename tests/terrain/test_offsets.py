from __future__ import annotations

import numpy as np
import pytest
from fake_terrain import place
from scipy import ndimage
from scipy.special import erf

from seismo3d.terrain import lineaments
from seismo3d.terrain.offsets import parts_even_ground

SIDE = 240


def make_fan(azimuth_deg: float, height: float = 1.5) -> np.ndarray:
    """A fan that slopes to the north, with a scarp through its middle; its lower side is clockwise of north."""
    rng = np.random.default_rng(1)
    i, j = np.mgrid[:SIDE, :SIDE] - 0.5 * (SIDE - 1)
    a = np.radians(azimuth_deg)
    across = j * np.cos(a) + i * np.sin(a)
    rough = sum(0.04 * w * ndimage.gaussian_filter(rng.normal(size=(SIDE, SIDE)), w) for w in (1.0, 3.0, 10.0))
    return 0.04 * i + rough - 0.5 * height * erf(across / 3.0)


@pytest.mark.parametrize("azimuth", range(0, 360, 30))
def test_a_scarp_across_a_fan_is_found_whichever_way_it_runs(azimuth):
    found = lineaments(place(make_fan(azimuth), cell=1.0))
    assert len(found) == 1
    off = (found.lines[0].strike_deg - azimuth + 90.0) % 180.0 - 90.0
    assert abs(off) < 2.0
    assert found.lines[0].length > 0.7 * SIDE


def test_steps_part_even_grounds_and_what_water_cuts_does_not():
    i, j = np.mgrid[:SIDE, :SIDE] - 0.5 * (SIDE - 1)
    down = np.column_stack([np.arange(20.0, 220.0), np.full(200, 119.5)])
    plain = 0.04 * i + 0.01 * j
    assert parts_even_ground(plain + 2.0 * erf(j / 3.0), down)
    assert parts_even_ground(plain - 2.0 * erf(j / 3.0), down)
    for cut in (
        0.0 * j,
        -4.0 * np.exp(-((j / 6.0) ** 2)),  # a gully on the line
        -4.0 * np.exp(-(((j - 10.0) / 6.0) ** 2)),  # and beside it
        3.0 * np.cos(j / 9.0),  # spurs and valleys
        3.0 * np.sin(j / 9.0),  # a valley's flank
        2.0 * erf(j / 3.0) * np.sign(i),  # up on one side, then on the other
    ):
        assert not parts_even_ground(plain + cut, down), cut[0]
    assert not parts_even_ground(plain + 2.0 * erf(j / 3.0), down[:40])
