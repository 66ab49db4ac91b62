from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.experiments import faults as suite
from seismo3d.synthetic import KINDS, fault_cube


class Oracle:
    """Traces by looking the answer up, for the suite's own cubes."""

    def __init__(self, kinds, *, shape, seeds=(0, 101)):
        self.known = [fault_cube(kind, seed=seed, shape=shape) for kind in kinds for seed in seeds]

    def __call__(self, seismic):
        for cube in self.known:
            if cube.seismic.shape == seismic.shape and np.array_equal(cube.seismic, seismic):
                return SimpleNamespace(labels=cube.faults, throw=cube.throw)
        return SimpleNamespace(
            labels=np.zeros(seismic.shape, np.int32), throw=np.full(seismic.shape, np.nan, np.float32)
        )


def test_truth_scores_one_and_nothing_found_scores_zero(tmp_path, capsys):
    file = tmp_path / "scores.json"
    oracle = Oracle(["clean"], shape=(24, 24, 24))
    suite.main(
        ["--kinds", "clean", "folded", "fault_free", "--seeds", "1", "--shape", "24", "--json", str(file)], trace=oracle
    )
    rows = {row["kind"]: row for row in json.loads(file.read_text())["kinds"]}
    clean = rows["clean"]
    assert (clean["f1"], clean["precision"], clean["recall"]) == (1.0, 1.0, 1.0)
    assert (clean["throw_known"], clean["throw_within"], clean["throw_median_error"]) == (1.0, 1.0, 0.0)
    assert rows["folded"]["f1"] == 0.0
    assert rows["fault_free"]["f1"] is None
    assert rows["fault_free"]["called_percent"] == 0.0
    assert clean["ratio"] > 0.0
    out = capsys.readouterr().out
    assert "clean" in out
    assert "fault_free" in out


def test_visible_truth_leaves_out_the_dying_ends():
    cube = fault_cube("small_throws", shape=(32, 32, 32), seed=1, least_throw=0.05)
    seen = np.where(np.abs(np.nan_to_num(cube.throw)) >= suite.VISIBLE_THROW, cube.faults, 0)
    score, visible, throws, _ = suite.score_cube(cube, seen, cube.throw)
    assert visible.recall == 1.0
    assert visible.recall >= score.recall
    assert throws.within == 1.0


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peak memory is read from Linux's /proc")
def test_memory_is_measured_on_request():
    def greedy(seismic):
        spare = np.ones(8_000_000)
        return SimpleNamespace(
            labels=np.zeros(seismic.shape, int) * int(spare[0]), throw=np.full(seismic.shape, np.nan)
        )

    result = suite.run_cube("clean", 1, shape=(16, 16, 16), trace=greedy, memory=True)
    assert result.peak_mb == pytest.approx(64.0, rel=0.1)
    assert result.peak_cubes == pytest.approx(result.peak_mb * 1e6 / (4 * 16**3))
    assert suite.run_cube("clean", 1, shape=(16, 16, 16), trace=greedy).peak_mb is None


REUSE = """
import numpy as np
from seismo3d.experiments import faults as suite

freed, kept = np.ones(20_000_000), np.ones(1_000_000)
del freed
print(suite._peak_mb(lambda cube: np.ones(8_000_000), kept))
"""


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peak memory is read from Linux's /proc")
def test_memory_that_was_freed_before_counts_when_used_again():
    """Here the allocator keeps what is freed, as it does in a process that ran for long."""
    keeping = {**os.environ, "MALLOC_MMAP_THRESHOLD_": "1073741824", "MALLOC_TRIM_THRESHOLD_": "1073741824"}
    found = subprocess.run([sys.executable, "-c", REUSE], capture_output=True, text=True, check=True, env=keeping)
    assert float(found.stdout) == pytest.approx(64.0, rel=0.1)


def test_memory_is_refused_where_it_cannot_be_measured(monkeypatch):
    def refuse(*_args, **_settings):
        raise PermissionError

    monkeypatch.setattr(Path, "write_text", refuse)
    with pytest.raises(ParameterError, match="needs Linux"):
        suite.run_cube(
            "clean", 1, shape=(16, 16, 16), trace=lambda a: SimpleNamespace(labels=a * 0, throw=a), memory=True
        )


def test_suite_has_every_kind_but_the_demo_and_refuses_nonsense():
    assert set(suite.SUITE_KINDS) == set(KINDS) - {"demo"}
    with pytest.raises(ParameterError, match="too small"):
        suite.main(["--seeds", "0"], trace=lambda seismic: seismic)
    with pytest.raises(SystemExit):
        suite.main(["--kinds", "nice"], trace=lambda seismic: seismic)


def test_every_evidence_has_its_column(tmp_path, capsys):
    file = tmp_path / "scores.json"
    oracle = Oracle(["clean", "folded"], shape=(24, 24, 24))
    asked = []

    def trace(seismic, *, evidence):
        asked.append(evidence)
        nothing = np.zeros_like(seismic)
        return oracle(nothing if evidence == "semblance" else seismic)

    words = ["--kinds", "clean", "fault_free", "--seeds", "1", "--shape", "24", "--json", str(file)]
    suite.main([*words, "--evidence", "semblance", "both"], trace=trace)
    assert set(asked) == {"semblance", "both"}
    cubes = json.loads(file.read_text())
    assert [cube["score"]["f1"] for cube in cubes["semblance"]] == [0.0, None]
    assert [cube["score"]["f1"] for cube in cubes["both"]] == [1.0, None]
    lines = [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert ["kind", "semblance", "both"] in lines
    assert ["clean", "0.000", "1.000"] in lines
    assert ["fault_free", "0.00", "%", "0.00", "%"] in lines


def test_evidence_that_there_is_not_is_refused(capsys):
    with pytest.raises(SystemExit):
        suite.main(["--evidence", "hog"])
    assert "invalid choice: 'hog'" in capsys.readouterr().err
