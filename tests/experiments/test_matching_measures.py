from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from skimage import data

from seismo3d.errors import FileAccessError
from seismo3d.experiments import matching, matching_pairs, matching_speed, matching_volumes
from seismo3d.experiments.matching_scenes import project


@pytest.fixture
def sequences(tmp_path):
    """One sequence of six images, each moved by three more pixels, kept at twice the size."""
    folder = tmp_path / "seq"
    folder.mkdir()
    image = cv2.resize(data.camera(), (640, 640))
    for k in range(1, 7):
        H = np.array([[1.0, 0.0, 6.0 * (k - 1)], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        cv2.imwrite(str(folder / f"img{k}.png"), cv2.warpPerspective(image, H, (640, 640)))
        if k > 1:
            np.savetxt(folder / f"H1to{k}p", H)
    return tmp_path


def test_homographies_are_scaled_with_their_images(sequences):
    pairs = matching_pairs.load_oxford(sequences, longest=320)
    assert [p.name for p in pairs] == [f"seq 1-{k}" for k in range(2, 7)]
    np.testing.assert_allclose(pairs[0].H, [[1, 0, 3], [0, 1, 0], [0, 0, 1]], atol=1e-9)
    assert pairs[0].target.shape == (320, 320)


def test_perfect_matches_score_full_and_none_score_nothing(sequences, rng):
    pairs = matching_pairs.load_oxford(sequences, longest=320)
    places = rng.uniform(0, 300, (50, 2))
    truth = iter([pair.H for pair in pairs])
    perfect = matching_pairs.score_homographies(pairs, lambda _t, _s: (places, project(next(truth), places)))
    assert perfect.cell.accuracy == 100.0
    np.testing.assert_allclose(perfect.auc, 100.0, atol=0.01)
    nothing = matching_pairs.score_homographies(pairs, lambda _t, _s: (np.empty((0, 2)), np.empty((0, 2))))
    assert nothing.auc == (0.0, 0.0, 0.0)


def test_area_under_the_curve():
    assert matching_pairs._area([0.0, 0.0], 1.0) == pytest.approx(100.0)
    # One of two pairs at 0.5: the share rises to a half at 0.5 and stays: 0.125 + 0.25.
    assert matching_pairs._area([0.5, 9.0], 1.0) == pytest.approx(37.5)


def test_report_of_sequences_names_every_method(sequences):
    text = matching.report_oxford(sequences)
    assert all(name in text for name in ("seismo3d", "SIFT", "ORB", "AKAZE"))
    with pytest.raises(FileAccessError, match="img1"):
        matching_pairs.load_oxford(sequences / "seq")


def test_displaced_pair_is_displaced_as_said():
    z = np.mgrid[:40, :40, :40].astype(float)
    earth = np.sin(z[0] / 5.0) + np.cos(z[1] / 6.0) + np.sin(z[2] / 4.0)
    R = np.asarray(Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix())
    target, source, t = matching_volumes.displaced_pair(earth, 20, R, np.ones(3), 0.0, np.random.default_rng(0))
    place = np.array([9.0, 11.0, 10.0])
    x, y, w = R @ place + t + 10.0
    expected = np.sin(x / 5.0) + np.cos(y / 6.0) + np.sin(w / 4.0)
    assert source[9, 11, 10] == pytest.approx(expected, abs=0.01)  # cubic interpolation
    np.testing.assert_allclose(target, earth[10:30, 10:30, 10:30], rtol=1e-6)


def test_a_trial_finds_its_displacement():
    (trial,) = matching_volumes.synthetic_trials(1, size=80, max_angle_deg=20.0, noise=0.2)
    assert trial.kept >= trial.correct > 20
    assert matching_volumes.share_within([trial], angle_deg=0.5, shift=0.3) == 1.0
    assert matching_volumes.share_within([trial], angle_deg=0.0, shift=0.0) == 0.0


def test_jobs_take_turns_and_all_are_timed():
    calls = []
    seconds = matching_speed.median_seconds([lambda: calls.append(0), lambda: calls.append(1)], n_repeats=3)
    assert calls == [0, 1] * 4
    assert len(seconds) == 2
