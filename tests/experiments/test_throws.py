from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.experiments.throws import angle_deg, main, score_slip
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.synthetic import CubeRecipe, SyntheticFault, make_cube

SHAPE = (32, 36, 40)


def cube_and_truth(throw, rake_deg):
    """A cube with one fault that strikes along growing inlines, and the fault as tracing would give it."""
    fault = SyntheticFault((16.0, 18.0, 20.0), 0.0, 60.0, throw, rake_deg=rake_deg)
    cube = make_cube(CubeRecipe(shape=SHAPE, population=None, faults=(fault,)), seed=1)
    vertices = np.argwhere(cube.faults > 0).astype(np.float32)
    n = len(vertices)
    # the hanging wall lies at growing crosslines; normals point up into it
    normals = np.tile(np.array([0.0, np.sin(np.pi / 3), -np.cos(np.pi / 3)], np.float32), (n, 1))
    # strike by the right-hand rule is along growing inlines
    share = float(np.median(cube.slip[:, 0] / cube.slip[:, 2]))
    ones = np.ones(n, np.float32)
    surface = FaultSurface(
        vertices,
        np.empty((0, 3), np.int32),
        normals,
        ones,
        throw * ones,
        throw * ones,
        ones,
        ones,
        ones,
        strike_share=share,
    )
    labels = (cube.faults > 0).astype(np.int32)
    return cube, FaultSet((surface,), labels.astype(np.float32), labels, np.where(labels > 0, cube.throw, np.nan))


@pytest.mark.parametrize(("throw", "rake_deg"), [(5.0, 90.0), (5.0, 60.0), (-5.0, 120.0)])
def test_truth_has_a_perfect_score(throw, rake_deg):
    cube, faults = cube_and_truth(throw, rake_deg)
    score = score_slip(cube, faults)
    assert score.n > 500
    assert (score.throw, score.throw_today, score.direction, score.sense) == (1.0, 1.0, 1.0, 1.0)
    assert (score.reverse == 1.0) == (throw < 0)
    assert score.straight == (1.0 if rake_deg == 90.0 else 0.0)


def test_wrong_sign_and_wrong_strike_slip_are_seen():
    cube, faults = cube_and_truth(5.0, 60.0)
    up = replace(faults, throw=-np.asarray(faults.throw))
    assert score_slip(cube, up).sense == 0.0
    assert score_slip(cube, up).direction == 0.0
    turned = replace(faults, surfaces=(replace(faults.surfaces[0], strike_share=-faults.surfaces[0].strike_share),))
    score = score_slip(cube, turned)
    assert score.direction == 0.0
    assert score.throw == 1.0


def test_angles():
    np.testing.assert_allclose(angle_deg(np.eye(3), np.roll(np.eye(3), 1, axis=1)), 90.0)


def test_nothing_to_compare_is_refused():
    cube, faults = cube_and_truth(5.0, 90.0)
    nothing = replace(faults, labels=np.zeros(SHAPE, np.int32))
    with pytest.raises(ParameterError, match="none was found"):
        score_slip(cube, nothing)


def test_command_prints_a_line_a_cube(capsys):
    main(["--kinds", "clean", "--seeds", "7", "--shape", "64"])
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("clean           7 |")
    assert lines[2].startswith("clean        mean |")
