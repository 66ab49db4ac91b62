from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments.mapping_synthetic import CASES, measure_elevation, run_case
from seismo3d.robot import Camera, Mapper, MapperSettings, RgbdFrame
from seismo3d.synthetic.rgbd import rgbd_sequence


def test_mapped_ground_agrees_with_the_truth_and_finds_its_place_in_a_survey() -> None:
    sequence = rgbd_sequence("terrain", frames=60, size=(240, 180), period=8.0, seed=0)
    settings = MapperSettings(voxel_size=0.03)
    mapper = Mapper(Camera(sequence.camera, readout=0.0, depth_delay=0.0), settings=settings)
    for number in range(0, 60, 2):
        frame = sequence[number]
        mapper.add(RgbdFrame.of(frame.colour, frame.depth, frame.stamp))
    row = measure_elevation(mapper, sequence, cell=0.1)
    assert row["elevation_cm"] < 1.0  # a third of a voxel
    # from 54 cm and 8.6 degrees off, on a strip of a few metres, against a survey every 20 cm
    assert row["survey_cm"] < 15.0
    assert row["survey_deg"] < 3.0


@pytest.mark.parametrize("name", ["room, something moves", "terrain, every 4th frame"])
def test_a_row_of_the_table(name: str) -> None:
    row = run_case(name, frames=32, size=(160, 120), voxel_size=0.03, period=14.0, n_threads=2)
    assert row["located"] == row["frames"]
    assert row["before"]["share"] < 1.0
    assert row["after"]["position_cm"] <= row["before"]["position_cm"] + 1e-9 or row["closures"] > 0
    assert row["mesh_mm"] < 10.0
    assert row["ghosts"] < 1.0
    assert np.isfinite(row["ms_a_frame"])
    assert ("elevation_cm" in row) == (CASES[name]["kind"] == "terrain")
