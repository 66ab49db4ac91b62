from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.synthetic import FaultPopulation, SyntheticFault, sample_faults, sample_folding


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dip_deg": 95.0}, "dip_deg is 95"),
        ({"share": 1.2}, "share is 1.2"),
        ({"profile": "round"}, "profile is 'round'"),
        ({"semi_axes": (0.0, 5.0)}, "semi_axes"),
        ({"profile": "elliptic", "semi_axes": (9.0, 9.0)}, "1.4 samples a sample down dip; expected at most 0.9"),
        ({"drag": 8.0}, "drag is 8"),
        ({"listric": (20.0, 10.0), "rake_deg": 60.0}, "listric"),
    ],
)
def test_impossible_faults_are_refused(settings, message):
    given = {"centre": (1.0, 1.0, 1.0), "strike_deg": 0.0, "dip_deg": 60.0, "throw": 8.0} | settings
    with pytest.raises(ParameterError, match=message):
        SyntheticFault(**given)


def test_shares_of_a_population_are_kept():
    p = FaultPopulation(
        count=(400, 400), reverse=0.5, listric=0.3, curved=0.5, buried=0.2, throw=(5, 15), dip_deg=(50, 80)
    )
    faults = sample_faults(np.random.default_rng(1), (128, 128, 128), p)
    assert len(faults) == 400
    assert np.mean([f.throw < 0 for f in faults]) == pytest.approx(0.5, abs=0.08)
    assert np.mean([f.listric is not None for f in faults]) == pytest.approx(0.3, abs=0.08)
    assert np.mean([f.buried for f in faults]) == pytest.approx(0.2, abs=0.07)
    buried = [f.buried for f in faults]
    assert buried == sorted(buried, reverse=True)
    # Two families of strikes, 15 degrees either way, each with its opposite.
    strikes = np.array([f.strike_deg % 180.0 for f in faults])
    assert sum(np.histogram(strikes, bins=np.arange(0, 181, 5))[0] > 0) <= 16


@pytest.mark.parametrize("slope", [0.1, 0.6])
def test_folding_has_the_slope_asked_for_and_never_turns_layers_over(slope):
    shape = (40, 50, 60)
    folding = sample_folding(np.random.default_rng(4), shape, slope=slope, tilt=0.0)
    base = np.array([[folding.shift(i, x, 60.0) for x in range(50)] for i in range(40)])
    steepest = np.hypot(*np.gradient(base)).max()
    assert steepest <= slope * 1.05
    assert steepest > 0.5 * slope
    top = np.array([[folding.shift(i, x, 0.0) for x in range(50)] for i in range(40)])
    assert ((base - top) / 60.0 > -0.61).all()
