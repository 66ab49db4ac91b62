"""A short run of the fuzzer: damaged files of every format are read, or refused by one of the package's errors."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from fuzzing import FORMATS, KINDS, Damage, damage_file, draw_damages, read_damaged
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

damages = st.lists(
    st.builds(Damage, st.sampled_from(KINDS), st.floats(0.0, 1.0), st.integers(0, 2**16)), min_size=1, max_size=4
)


@pytest.fixture(scope="module")
def valid(tmp_path_factory):
    """Folders with a valid file each, made when first asked for."""
    made = {}

    def find(form):
        if form.name not in made:
            folder = tmp_path_factory.mktemp("valid")
            form.make(folder / form.ending)
            made[form.name] = folder / form.ending
        return made[form.name]

    return find


def skip_without_readers(form):
    if form.name in ("LAS", "LAZ"):
        pytest.importorskip("laspy")
    if form.name in ("GeoTIFF", "ESRI ASCII"):
        pytest.importorskip("rasterio")


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_a_valid_file_is_read(form, valid):
    skip_without_readers(form)
    assert read_damaged(form, valid(form)) == "read"


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_damaged_files_are_read_or_refused(form, valid, tmp_path):
    skip_without_readers(form)
    target = tmp_path / form.ending

    @settings(max_examples=25, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
    @given(damages)
    def check(drawn):
        shutil.rmtree(target, ignore_errors=True)
        damage_file(valid(form), target, drawn)
        assert read_damaged(form, target)

    check()


def test_every_kind_of_damage_changes_a_file():
    data = b"element vertex 40 and so on: 1 2 3 4 5 6 7 8 9" * 4
    for kind in KINDS:
        results = {Damage(kind, place, 7).apply(data) for place in (0.0, 0.3, 0.999)}
        assert data not in results
    assert Damage("cut", 0.5, 0).apply(b"") == b""


def test_the_same_seed_draws_the_same_damages():
    first, second = (draw_damages(np.random.default_rng(8)) for _ in range(2))
    assert first == second
