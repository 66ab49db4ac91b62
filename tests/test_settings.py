"""Settings at the doors of public functions."""

import numpy as np
import pytest

import seismo3d
from seismo3d._validate import as_settings
from seismo3d.errors import ParameterError
from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.faults import FaultSettings
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.shifts import ShiftSettings
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


@pytest.mark.parametrize(
    ("field", "wrong", "like"),
    [
        ("near", "8", "expected something like [0-9]+"),
        ("near", 8.5, "expected something like [0-9]+"),
        ("near", True, "expected something like [0-9]+"),
        ("most", np.zeros(3), r"expected something like [0-9.]+"),
        ("most", np.nan, r"expected something like [0-9.]+"),
        (
            "layers",
            LineamentSettings(),
            r"expected LayerTimeSettings\. Give LayerTimeSettings\(\.\.\.\), or leave it out",
        ),
    ],
)
def test_a_setting_of_another_kind_than_its_usual_value_is_named(field, wrong, like):
    with pytest.raises(ParameterError, match=rf"^settings\.{field} is .*; {like}"):
        seismo3d.find_horizons(CUBE, 2, settings=TrackSettings(**{field: wrong}))


def test_settings_of_settings_are_looked_at_too():
    far = TrackSettings(layers=LayerTimeSettings(shifts=ShiftSettings(vertical="far")))
    with pytest.raises(
        ParameterError, match=r"^settings\.layers\.shifts\.vertical is 'far'; expected something like 6"
    ):
        as_settings(far, TrackSettings)
    one = TrackSettings(layers=LayerTimeSettings(wide=(8.0,)))
    with pytest.raises(
        ParameterError, match=r"^settings\.layers\.wide is \(8\.0,\); expected something like \(8\.0, 8"
    ):
        as_settings(one, TrackSettings)
    more = TrackSettings(layers=LayerTimeSettings(lengths=[1, 2, 4, 8]))
    assert as_settings(more, TrackSettings) is more


def test_an_open_bound_and_none_are_settings():
    assert as_settings(LineamentSettings(gap=np.inf), LineamentSettings).gap == np.inf
    wide = FaultSettings(choice=ChoiceSettings.for_section())
    assert as_settings(wide, FaultSettings) is wide


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
