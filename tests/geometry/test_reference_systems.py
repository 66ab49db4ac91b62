from __future__ import annotations

import sys

import pytest

from seismo3d.errors import MissingDependencyError, ParameterError
from seismo3d.geometry.reference_systems import same_system, unit_of

DEGREES = ("EPSG:4326", "EPSG:7844", "EPSG:6318", "EPSG:4326+5773", "EPSG:4979", "OGC:CRS84")
METRES = ("EPSG:32611", "EPSG:4471", "EPSG:4547", "EPSG:3857", "EPSG:32610+5703", "EPSG:4978")


@pytest.mark.parametrize(("systems", "unit"), [(DEGREES, "degree"), (METRES, "metre")])
def test_units_are_those_of_the_system_and_not_of_its_number(systems, unit):
    import rasterio

    for crs in systems:
        assert unit_of(crs) == unit
        assert unit_of(rasterio.CRS.from_user_input(crs).to_wkt()) == unit


def test_a_map_without_a_system_is_in_what_it_states():
    assert unit_of("") == "metre"
    assert unit_of("", stated="degree") == "degree"
    with pytest.raises(ParameterError, match=r"a is in 'mile'; expected 'metre' or 'degree'\."):
        unit_of("", "a", stated="mile")


@pytest.mark.parametrize(
    ("crs", "words"),
    [
        ("EPSG:foo", r"a is in 'EPSG:foo', which is no known reference system\. Give an authority's code"),
        ("EPSG:99999", "no known reference system"),
        ("EPSG:2263", r"a is in EPSG:2263, whose unit is the US survey foot; expected metres or degrees\. Reproject"),
        ("EPSG:4807", "whose unit is the grad"),
        ("+proj=utm +zone=11 +units=km", "whose unit is the kilometre"),
        ("EPSG:26910+6360", "whose elevations are in the unit 'US survey foot'; expected metres"),
    ],
)
def test_unknown_systems_and_other_units_are_refused(crs, words):
    with pytest.raises(ParameterError, match=words):
        unit_of(crs, "a")


def test_what_cannot_be_told_without_rasterio_is_asked_for(monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    assert unit_of("EPSG:4326") == "degree"
    assert unit_of("EPSG:32733") == unit_of("epsg:3857") == "metre"
    assert unit_of("EPSG:7844", stated="degree") == "degree"
    for crs in ("EPSG:7844", "EPSG:32661", "EPSG:32700"):
        with pytest.raises(MissingDependencyError, match=r"seismo3d\[terrain\]', or state crs_unit"):
            unit_of(crs)


def test_systems_are_compared_by_what_they_are():
    import rasterio

    assert same_system("EPSG:32611", rasterio.CRS.from_epsg(32611).to_wkt())
    assert not same_system("EPSG:32611", "EPSG:32612")
    assert not same_system("EPSG:32611", "EPSG:foo")
