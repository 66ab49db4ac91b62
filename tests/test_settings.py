"""Settings at the doors of public functions."""

import importlib
import json
import pkgutil
import re
from dataclasses import replace
from types import UnionType
from typing import Annotated, Union, get_args, get_origin

import numpy as np
import pytest

import seismo3d
from seismo3d._settings import INTERVAL, as_settings, hints_of, may_be
from seismo3d.errors import ParameterError
from seismo3d.features.planar import PlanarSettings
from seismo3d.features.solid import SolidSettings
from seismo3d.registration.settings import LoopSettings
from seismo3d.seismic.blocks.run import pack_settings, unpack_settings
from seismo3d.seismic.choosing import ChoiceSettings
from seismo3d.seismic.cut_offsets import CutSettings
from seismo3d.seismic.fault_links import LinkSettings
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
        ("near", "8", r"expected a whole number in \[1, 100\] for TrackSettings\. Leave it out for 16\."),
        ("near", 8.5, "expected a whole number"),
        ("near", True, "expected a whole number"),
        ("near", -5, "expected a whole number"),
        ("most", np.zeros(3), "expected a number"),
        ("most", np.nan, "expected a number"),
        ("stretch", 1.7, r"expected a number in \[0, 1\)"),
        (
            "layers",
            LineamentSettings(),
            r"expected LayerTimeSettings for TrackSettings\. Leave it out for LayerTimeSettings\(\.\.\.\)",
        ),
    ],
)
def test_a_setting_of_another_kind_than_its_usual_value_is_named(field, wrong, like):
    with pytest.raises(ParameterError, match=rf"^settings\.{field} is .*; {like}"):
        seismo3d.find_horizons(CUBE, 2, settings=TrackSettings(**{field: wrong}))


def test_settings_of_settings_are_looked_at_too():
    far = TrackSettings(layers=LayerTimeSettings(shifts=ShiftSettings(vertical="far")))
    with pytest.raises(ParameterError, match=r"^settings\.layers\.shifts\.vertical is 'far'; expected a number in"):
        as_settings(far, TrackSettings)
    one = TrackSettings(layers=LayerTimeSettings(wide=(8.0,)))
    with pytest.raises(
        ParameterError, match=r"^settings\.layers\.wide is \(8\.0,\); expected \(a number in \(0, 1000\], a number"
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


def find_settings():
    """List all classes of settings that users may give; those of the matcher are given by its own arguments."""
    found = set()
    for module in pkgutil.walk_packages(seismo3d.__path__, "seismo3d."):
        if not module.name.endswith("__main__"):
            found |= {value for value in vars(importlib.import_module(module.name)).values() if is_settings(value)}
    return sorted(found - {PlanarSettings, SolidSettings}, key=lambda kind: kind.__name__)


def is_settings(value):
    return isinstance(value, type) and value.__name__.endswith(
        ("Settings", "RobotLimits", "DepthNoise", "CubeRecipe", "FaultPopulation")
    )


SETTINGS = {kind.__name__: kind for kind in find_settings()}


def numbers_of(hint, usual):
    """List the numbers in a field: what each may be, its usual value, and the whole field with another in its place."""
    base, inner = get_origin(hint), get_args(hint)
    if base is Annotated and get_origin(inner[0]) is not tuple:
        return [(hint, usual, lambda number: number)]
    if base is Annotated:
        return numbers_of(inner[0], usual)
    if base in (Union, UnionType):
        return numbers_of(inner[0], usual)
    if base is not tuple:
        return [(hint, usual, lambda number: number)] if hint in (int, float) else []
    usual = (None,) * len(inner) if usual is None else usual
    hints = [inner[0]] * len(usual) if inner[-1] is ... else inner
    return [
        (part, number, lambda value, i=i, put=put: (*usual[:i], put(value), *usual[i + 1 :]))
        for i, (one, own) in enumerate(zip(hints, usual, strict=True))
        for part, number, put in numbers_of(one, own)
    ]


def around_ends(hint, settings):
    """Return numbers at the ends of an interval that are within it, and the nearest ones that are not."""
    whole = get_args(hint)[0] is int
    opening, *words, closing = INTERVAL.fullmatch(get_args(hint)[1]).groups()
    within, outside = [], []
    for word, bracket, way in zip(words, (opening, closing), (-np.inf, np.inf), strict=True):
        end = float(getattr(settings, word, word))
        if not np.isfinite(end):
            (within if bracket in "[]" else outside).append(end)
            continue
        out, inwards = (end + np.sign(way), end - np.sign(way)) if whole else np.nextafter(end, [way, -way])
        within.append(end if bracket in "[]" else inwards)
        outside.append(out if bracket in "[]" else end)
    return [[int(n) if whole and np.isfinite(n) else float(n) for n in numbers] for numbers in (within, outside)]


@pytest.mark.parametrize("name", SETTINGS)
def test_every_number_has_a_stated_range_whose_ends_hold(name):
    kind = SETTINGS[name]
    usual = kind()
    as_settings(usual, kind)
    for field, hint in hints_of(kind).items():
        for part, number, put in numbers_of(hint, getattr(usual, field)):
            assert get_origin(part) is Annotated, f"{name}.{field} has no range"
            assert number is None or may_be(number, part, usual)
            within, outside = around_ends(part, usual)
            for value in within:
                assert may_be(value, part, usual), (field, value)
            for value in [*outside, np.nan]:
                assert not may_be(value, part, usual), (field, value)
                with pytest.raises(ParameterError, match=rf"\b{field} is .*; expected .* for {name}\. Leave it out"):
                    as_settings(replace(usual, **{field: put(value)}), kind)


@pytest.mark.parametrize("name", SETTINGS)
def test_ranges_stand_where_fields_are_described(name):
    kind = SETTINGS[name]
    described = {}
    for names, words in re.findall(r"^ {4}(\w+(?:, \w+)*) : (.*)$", kind.__doc__, re.MULTILINE):
        described |= dict.fromkeys(names.split(", "), words)
    for field, hint in hints_of(kind).items():
        rules = {get_args(part)[1] for part, _, _ in numbers_of(hint, getattr(kind(), field))}
        if get_origin(hint) is Annotated:
            rules |= set(get_args(hint)[1:])
        assert all(rule in described[field] for rule in rules), field


@pytest.mark.parametrize("shape", [(1, 4, 4), (8, 8, 16), (24, 24, 48), (400, 500, 600)])
def test_usual_variants_are_within_their_ranges(shape):
    assert as_settings(FaultSettings.for_section(), FaultSettings)
    assert as_settings(ChoiceSettings().for_size(shape), ChoiceSettings)
    assert as_settings(ChoiceSettings.for_section().for_size(shape), ChoiceSettings)


@pytest.mark.parametrize(("kind", "usual"), [("faults", FaultSettings()), ("layers", LayerTimeSettings())])
def test_settings_that_were_stored_are_within_their_ranges(kind, usual):
    stored = json.loads(json.dumps(pack_settings(usual)))
    assert as_settings(unpack_settings(stored, kind), type(usual))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (LinkSettings(near=6), r"^settings\.far is 5; expected a whole number in \[near, 100\] for LinkSettings\."),
        (
            LayerTimeSettings(strides=(4, 1)),
            r"strides is \(4, 1\); .*, halving to 1, among lengths for Layer.* out for \(4, 2, 1\)\.",
        ),
        (
            LayerTimeSettings(lengths=()),
            r"lengths is \(\); expected \(a whole number in \[1, 100\], \.\.\.\), rising from 1 for",
        ),
        (LayerTimeSettings(lengths=(1, 2)), r"strides is \(4, 2, 1\); expected .*, halving to 1, among lengths for"),
        (CutSettings(blurred=(2.0, 2.0)), r"blurred is \(2\.0, 2\.0\); expected .*, rising for CutSettings\."),
        (LoopSettings(alpha=1.5), r"alpha is 1\.5; expected a number in \[0, 1\] or None for LoopSettings\."),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else "",
)
def test_numbers_that_do_not_go_together_are_refused(settings, words):
    with pytest.raises(ParameterError, match=words):
        as_settings(settings, type(settings))
