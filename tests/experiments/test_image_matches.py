from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments.image_matches import match_keypoints


@pytest.mark.parametrize("detector", ["sift", "orb"])
def test_keypoints_of_a_shifted_image_match_at_the_shift(detector, rng):
    from scipy.ndimage import gaussian_filter

    image = (255 * (gaussian_filter(rng.normal(size=(200, 260)), 2.5) > 0)).astype(np.uint8)
    found = match_keypoints(image[:, 9:], image[:, :-9], detector=detector)
    shift = found.points_source - found.points_target
    assert len(shift) > 20
    np.testing.assert_allclose(
        np.median(shift, axis=0), [9, 0], atol=0.5
    )  # ORB places keypoints on the pixels of its pyramid


def test_images_without_keypoints_give_no_matches():
    assert match_keypoints(np.zeros((64, 64), np.uint8), np.zeros((64, 64), np.uint8)).points_target.shape == (0, 2)
