from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from seismo3d.experiments.mapping_sureness import main, measure_sureness, run_case
from seismo3d.geometry.rotations import exp_rotation, make_transform


def test_a_pose_that_is_off_as_its_covariance_says_has_a_ratio_of_one() -> None:
    truth = make_transform(exp_rotation([0.3, -0.2, 1.0]), [1.0, 2.0, 0.5])
    found = make_transform(np.eye(3), [0.0, 0.03, 0.04]) @ truth
    covariance = np.diag([1e-6] * 3 + [0.05**2 / 3.0] * 3)
    covariance[:3, :3] = 0.0
    off, spread = measure_sureness(truth, found, covariance)
    np.testing.assert_allclose(off, [0.0, 0.05], atol=1e-12)
    np.testing.assert_allclose(spread, [0.0, 0.05], atol=1e-12)


@pytest.mark.parametrize("case", ["as it is", "steps", "scale 2 % off"])
def test_doubt_about_the_lens_makes_poses_less_sure(case: str) -> None:
    row = run_case("room", case, frames=8, size=(160, 120))
    assert row["located"] == 8
    assert row["sigma_usual"][1] > row["sigma_exact"][1] > 0.0


def test_the_table_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "table.json"
    main(["--kinds", "terrain", "--cases", "waves", "--frames", "6", "--size", "160", "120", "--json", str(file)])
    assert "terrain, waves" in capsys.readouterr().out
    assert json.loads(file.read_text())["terrain, waves"]["frames"] == 6
