from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from seismo3d.terrain.diffusion import fit_form, fit_worn_step

OFFSET = np.arange(-60.0, 61.0)


@pytest.mark.parametrize("width", [1.5, 6.0, 14.0, 20.0])
@pytest.mark.parametrize("height", [-3.0, 0.5])
def test_height_and_width_come_back(height, width):
    profile = 7.0 - 0.08 * OFFSET + 0.5 * height * erf((OFFSET - 1.3) / width)
    made = fit_worn_step(OFFSET, profile, aside=6.0)
    assert made.height == pytest.approx(height, rel=0.02)
    assert made.width == pytest.approx(width, rel=0.05)
    assert made.middle == pytest.approx(1.3, abs=0.3)
    assert made.slope == pytest.approx(-0.08, abs=2e-3)
    assert made.misfit < 0.02


def test_noise_moves_the_height_by_its_share(rng):
    profile = 0.05 * OFFSET + erf(OFFSET / 10.0) + rng.normal(0.0, 0.05, len(OFFSET))
    made = fit_worn_step(OFFSET, profile, aside=6.0)
    assert made.height == pytest.approx(2.0, rel=0.1)
    assert 0.05 < made.misfit < 0.5


def test_a_ridge_is_no_step():
    assert fit_worn_step(OFFSET, np.exp(-0.5 * (OFFSET / 8.0) ** 2), aside=6.0).misfit > 0.5


def test_a_form_that_is_known_in_part_only():
    profile = 2.0 + 0.1 * OFFSET + 3.0 * (OFFSET > 0)
    form = np.where(OFFSET <= -5, -0.5, np.where(OFFSET >= 5, 0.5, np.nan))
    profile[:10] = np.nan
    slope, height, left = fit_form(OFFSET, profile, form)
    assert (slope, height) == pytest.approx((0.1, 3.0))
    assert left == pytest.approx(0.0, abs=1e-9)
    profile[OFFSET > 0] = np.nan
    assert np.isnan(fit_form(OFFSET, profile, form)).all()
