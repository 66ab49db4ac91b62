from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments.terrain_forms import FORMS, SCARPS, ScarpCase, make_fractal, make_scarp


def test_a_fractal_has_the_slope_it_says():
    gy, gx = np.gradient(make_fractal(128, np.random.default_rng(0)))
    assert np.sqrt(0.5 * (gx**2 + gy**2).mean()) == pytest.approx(1.0)


def test_a_scarp_separates_its_sides_by_its_height():
    case = ScarpCase(height=4.0, relief=0.0, noise=0.0, age=1.0)
    z, distance = make_scarp(case, 128, 30.0, np.random.default_rng(0))
    z = z + 0.05 * distance
    assert z[distance < -10].mean() - z[distance > 10].mean() == pytest.approx(4.0, abs=1e-6)
    # a strike of 30 degrees: up and to the right
    assert abs(distance[0, 127]) > abs(distance[9, 96])
    assert abs(distance[9, 95]) < 1.0


@pytest.mark.parametrize("name", list(SCARPS))
def test_names_tell_the_cell(name):
    assert float(name.split(" m")[0]) == SCARPS[name].cell


@pytest.mark.parametrize("name", list(FORMS))
def test_forms_are_finite_and_depend_on_the_seed(name):
    one, other = (FORMS[name](96, np.random.default_rng(seed)) for seed in (0, 1))
    assert one.shape == (96, 96)
    assert np.isfinite(one).all()
    assert np.abs(one - other).max() > 0.0
