"""Settings at the doors of public functions."""

import numpy as np
import pytest

import seismo3d
from seismo3d._validate import as_settings
from seismo3d.errors import ParameterError
from seismo3d.seismic.tracks import TrackSettings
from seismo3d.terrain.lineament_search import LineamentSettings

CUBE = np.random.default_rng(1).normal(size=(24, 24, 48)).astype(np.float32)
POINTS = np.random.default_rng(2).normal(size=(200, 3))
CALLS = {
    "trace_faults": lambda wrong: seismo3d.trace_faults(CUBE, settings=wrong),
    "layer_time": lambda wrong: seismo3d.layer_time(CUBE, settings=wrong),
    "loop_closure": lambda wrong: seismo3d.loop_closure(CUBE, settings=wrong),
    "trace_tracks": lambda wrong: seismo3d.trace_tracks(CUBE, [(12, 12, 24.0)], settings=wrong),
    "find_horizons": lambda wrong: seismo3d.find_horizons(CUBE, 2, settings=wrong),
    "align_cubes": lambda wrong: seismo3d.align_cubes(CUBE, CUBE, settings=wrong),
    "register": lambda wrong: seismo3d.register(POINTS, POINTS, settings=wrong),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("wrong", ["fast", {"window": 3}, LineamentSettings()], ids=["word", "dict", "other"])
def test_settings_of_another_kind_are_refused(name, wrong):
    with pytest.raises(ParameterError, match=r"settings is of type \w+; expected \w+Settings\. Give \w+Settings\("):
        CALLS[name](wrong)


def test_constraints_of_another_kind_are_refused():
    for call in (seismo3d.register, seismo3d.align_pairs):
        with pytest.raises(
            ParameterError, match=r"constraints is of type dict; expected Constraints\. Give Constraints"
        ):
            call(POINTS, POINTS, constraints={"max_angle": 0.1})


def test_no_settings_are_the_usual_ones_and_a_dict_is_shown_how_to_be_given():
    given = TrackSettings(near=8)
    assert as_settings(None, TrackSettings) == TrackSettings()
    assert as_settings(given, TrackSettings) is given
    with pytest.raises(ParameterError, match=r"TrackSettings\(\*\*\{'near': 8\}\)"):
        as_settings({"near": 8}, TrackSettings)
