from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments.tracks import choose_seed, layer_errors, main


def test_errors_are_in_samples_of_depth(rng: np.random.Generator) -> None:
    truth = np.cumsum(rng.uniform(0.5, 1.5, (6, 7, 90)), axis=2)
    assert np.median(layer_errors(np.exp(truth / 40.0), truth)) < 0.3  # any growing function of the truth is as good
    late = truth.copy()
    late[0, 0, :-4] = truth[0, 0, 4:]  # one trace four samples too early
    late[0, 0, -4:] = truth[0, 0, -1] + np.arange(1, 5)
    assert layer_errors(late, truth)[0, 0] == pytest.approx(4.0, abs=0.5)


def test_seed_lies_off_gaps() -> None:
    horizon = np.full((30, 30), 5.0)
    horizon[14:17] = np.nan
    i, _, z = choose_seed(horizon) or (0, 0, 0.0)
    assert min(abs(i - k) for k in range(14, 17)) >= 5
    assert z == 5.0
    assert choose_seed(np.full((5, 5), np.nan)) is None


def test_command_prints_a_line_a_cube(capsys: pytest.CaptureFixture[str]) -> None:
    main(["--kinds", "clean", "--seeds", "7", "--shape", "32"])
    assert capsys.readouterr().out.splitlines()[-1].startswith("clean     7 |")
