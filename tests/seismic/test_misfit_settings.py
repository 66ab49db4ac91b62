from __future__ import annotations

import pytest

from seismo3d.seismic.misfit_settings import (
    MisfitSettings,
    find_noise,
    find_softness,
    judge_noise,
    misfit_reach,
    share_of_noise,
    width_along_trace,
)

SETTINGS = MisfitSettings()


@pytest.mark.parametrize(
    ("noise", "expected"), [(0.0, (0.0, 2)), (0.15, (0.5, 6)), (0.29, (1.0, 10)), (2.0, (1.0, 10))]
)
def test_the_noisier_a_cube_the_more_traces_are_averaged(noise, expected):
    assert judge_noise(noise, SETTINGS) == pytest.approx(expected)


def test_windows_along_the_trace_widen_with_the_traces_averaged():
    assert [width_along_trace(reach, SETTINGS) for reach in (2, 6, 10)] == pytest.approx([0.7, 1.35, 2.0])
    assert width_along_trace(5, MisfitSettings(reach=(3, 3), vertical=(1.1, 2.0))) == 1.1


def test_what_noise_leaves_over_a_narrow_window_is_put_up_to_the_usual_one():
    assert find_noise(0.081, 2, SETTINGS) == pytest.approx(0.1)
    assert find_noise(0.1, 5, MisfitSettings(vertical=(1.5, 1.5))) == pytest.approx(0.1)


def test_softness_follows_the_noise_but_never_vanishes():
    assert find_softness(0.0, SETTINGS) == pytest.approx(0.02)
    assert find_softness(0.1, SETTINGS) == pytest.approx(0.08)


def test_all_that_differs_between_lines_is_noise_from_mild_noise_on():
    assert [share_of_noise(noise) for noise in (0.0, 0.018, 0.036, 1.0)] == pytest.approx([0.0, 0.5, 1.0, 1.0])


def test_the_misfit_depends_on_the_traces_averaged_and_those_of_the_energys_window():
    assert misfit_reach(4, SETTINGS) - misfit_reach(2, SETTINGS) == 2
    assert misfit_reach(2, SETTINGS) == 2 + 5
