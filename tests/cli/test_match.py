from __future__ import annotations

import json
import signal

import cv2
import numpy as np
import pytest
from skimage import data

from seismo3d.cli import main


@pytest.fixture
def run(capsys):
    before = signal.getsignal(signal.SIGTERM)

    def call(*words):
        with pytest.raises(SystemExit) as left:
            main([str(word) for word in words])
        out, err = capsys.readouterr()
        return left.value.code, out, err

    yield call
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def photos(tmp_path):
    image = data.camera()[:300, 100:400]
    turn = cv2.getRotationMatrix2D((149.5, 149.5), -30.0, 1.0)  # OpenCV's positive angles are counter-clockwise
    cv2.imwrite(str(tmp_path / "source.png"), image)
    cv2.imwrite(str(tmp_path / "target.png"), cv2.warpAffine(image, turn, (300, 300), flags=cv2.INTER_CUBIC))
    return tmp_path / "target.png", tmp_path / "source.png"


def test_match_says_angle_and_scale_and_draws(run, photos, tmp_path):
    code, out, err = run("match", *photos, "-o", tmp_path / "m.png")
    assert (code, err) == (0, "")
    words = out.split()
    assert int(words[words.index("matches") + 1]) > 150
    assert float(words[words.index("angle") + 1]) == pytest.approx(30.0, abs=0.5)
    assert float(words[words.index("scale") + 1].rstrip(",")) == pytest.approx(1.0, abs=0.01)
    assert (tmp_path / "m.png").stat().st_size > 10_000


def test_match_prints_json(run, photos):
    code, out, _ = run("match", *photos, "--points", "100", "--json")
    found = json.loads(out)
    assert code == 0
    assert len(found["points_target"]) == len(found["score"]) > 30


def test_match_reads_arrays_and_finds_nothing_in_nothing(run, tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((20, 24)))
    code, out, _ = run("match", tmp_path / "a.npy", tmp_path / "a.npy")
    assert code == 0
    assert out.startswith("matches  0 of 0 points")


def test_match_takes_options_on_how_cubes_are_read(run, tmp_path):
    cubes = np.random.default_rng(0).normal(size=(2, 24, 24))
    np.savez(tmp_path / "two.npz", a=cubes[0], b=cubes[1])
    code, out, err = run("match", tmp_path / "two.npz", tmp_path / "two.npz", "--variable", "a")
    assert (code, err) == (0, "")
    assert out.startswith("matches")


def test_bad_input_is_one_line_and_code_2(run, photos, tmp_path):
    (tmp_path / "broken.png").write_bytes(b"no picture")
    np.savez(tmp_path / "two.npz", a=np.zeros(3), b=np.zeros(3))
    np.save(tmp_path / "cube.npy", np.zeros((20, 20, 20)))
    for name, words in (
        ("none.png", "does not exist"),
        ("broken.png", "cannot be read as a picture"),
        ("two.npz", "expected one"),
        ("cube.npy", "two images or two volumes"),
    ):
        code, out, err = run("match", photos[0], tmp_path / name)
        assert (code, out) == (2, "")
        assert words in err
        assert err.count("\n") == 1
    assert run("match", *photos, "--tilts", "maybe")[0] == 2


def test_paper_refuses_what_it_does_not_know(run):
    code, _, err = run("paper", "table9")
    assert code == 2
    assert "table2" in err


def test_a_picture_is_refused_before_there_is_work(run, photos, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise AssertionError("work was done")

    monkeypatch.setattr("seismo3d.features.matching.match", fail)
    held = photos[1].read_bytes()
    for option, name, words in (
        ("-o", "m.xyz", "ends in '.xyz'; expected .png, .pdf, .svg"),
        ("--out", "source.png", "is an input too"),
        ("--output", "none/m.png", "is not a folder"),
    ):
        code, out, err = run("match", *photos, option, tmp_path / name)
        assert (code, out) == (2, "")
        assert words in err
    assert photos[1].read_bytes() == held
