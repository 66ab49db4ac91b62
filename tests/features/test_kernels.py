"""Compiled loops against plain Python and numpy on small inputs."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.features import _kernels, _kernels_agreement, _kernels_volume, cyclic
from seismo3d.features.agreement import count_apart, count_witnesses
from seismo3d.features.descriptors import WindowLayout, describe_points
from seismo3d.features.gradients import central_differences, quantise_gradients
from seismo3d.features.keypoints import Keypoints, detect_keypoints
from seismo3d.features.pairs import Pairs, no_pairs
from seismo3d.features.pyramid import build_pyramid
from seismo3d.features.refinement import refine_matches
from seismo3d.features.windows import _edge_taps, histogram_map, slide_window


def test_plain_python_gives_what_compiled_gives(rng):
    planes = rng.integers(0, 99, (2, 9, 11)).astype(np.int32)
    taps = _edge_taps(2.0)
    np.testing.assert_array_equal(
        _kernels.slide_window.py_func(planes, taps, 2), _kernels.slide_window(planes, taps, 2)
    )
    image = rng.normal(50, 20, (9, 11)).astype(np.float32)
    gx, gy = central_differences(image)
    np.testing.assert_allclose(
        _kernels.corner_strength.py_func(gx, gy), _kernels.corner_strength(gx, gy), rtol=1e-4, atol=1e-3
    )
    table, points = rng.random((4, 6)).astype(np.float32), rng.random((6, 2)) * 30
    for plain, compiled in zip(
        _kernels.nearest_apart.py_func(table, points, 6.0), _kernels.nearest_apart(table, points, 6.0)
    ):
        np.testing.assert_allclose(plain, compiled)
    volume = rng.normal(size=(6, 6, 6)).astype(np.float32)
    no_mask = np.ones((1, 1, 1), bool)
    plain, compiled = (
        _kernels_volume.halved_tensor.py_func(volume, no_mask),
        _kernels_volume.halved_tensor(volume, no_mask),
    )
    np.testing.assert_allclose(plain, compiled, rtol=1e-5)


def test_corner_strength_equals_numpy(rng):
    image = rng.normal(50, 20, (20, 24)).astype(np.float32)
    gx, gy = (g.astype(float) for g in central_differences(image))
    strength = _kernels.corner_strength(gx.astype(np.float32), gy.astype(np.float32))
    for y, x in ((3, 3), (10, 12), (16, 20)):
        window = np.s_[y - 2 : y + 3, x - 2 : x + 3]
        tensor = np.mean([np.outer(g, g) for g in zip(gx[window].ravel(), gy[window].ravel())], axis=0)
        assert strength[y, x] == pytest.approx(np.linalg.eigvalsh(tensor)[0], rel=1e-4, abs=1e-3)


def test_votes_split_between_the_two_nearest_bins():
    y, x = np.mgrid[:5, :5].astype(np.float32)
    direction = 2.0 * np.pi * 2.25 / 16
    bins, low, high = quantise_gradients(16.0 * (np.cos(direction) * x + np.sin(direction) * y), None, n_bins=16)
    assert bins[2, 2] == 2
    assert (low[2, 2], high[2, 2]) == (64 * 12, 64 * 4)  # root of 16, times 16, three quarters and one
    assert not low[0].any()  # the border does not vote
    blind = np.ones((5, 5), bool)
    blind[2, 3] = False
    assert quantise_gradients(16.0 * x, blind, n_bins=16)[1][2, 2] == 0


def test_sparse_description_equals_the_dense_map(rng):
    """At a keypoint, summing its windows directly is bit-identical to sliding them over the whole image."""
    image = rng.normal(100, 30, (60, 64)).astype(np.float32)
    pyramid = build_pyramid(image, None, n_levels=1)
    level = pyramid.level(0)
    votes = quantise_gradients(level, None, n_bins=16)
    dense = slide_window(_kernels.votes_to_planes(*votes, 16), 3.0)
    centres, ring = np.zeros((1, 2), np.float32), np.zeros(1, np.int32)
    from seismo3d.features.windows import window_half_widths

    widths = window_half_widths(3.0)
    out = np.zeros((2, 1, 16), np.int32)
    places = np.array([[20.0, 30.0], [62.0, 1.0]], np.float32)
    reach = np.array([widths.size // 2], np.int32)
    _kernels.describe(*votes, places, centres, ring, widths[None].copy(), reach, 16, out)
    np.testing.assert_array_equal(out[:, 0], dense[:, [30, 1], [20, 62]].T)
    assert histogram_map(image, 3.0).shape == (16, 60, 64)


def test_turning_an_image_by_a_quarter_shifts_descriptors_by_four(rng):
    image = rng.normal(100, 30, (65, 65)).astype(np.float32)
    points = Keypoints(np.array([[32.0, 32.0]]), np.zeros(1, np.int32), np.ones(1))
    straight, turned = (
        describe_points(build_pyramid(np.ascontiguousarray(i), None, n_levels=1), points, WindowLayout())
        for i in (image, np.rot90(image, -1))
    )
    # The square root magnifies votes that round to another bin where a histogram is nearly empty.
    assert np.einsum("td,td->", np.roll(straight[0], 4, axis=0), turned[0]) > 0.995
    compared = cyclic.compare_descriptors(turned, straight)
    found = cyclic.pick_matches(compared, np.zeros((1, 2)), np.zeros((1, 2)), max_ratio=1.0, apart=6.0)
    assert found.shift[0] == pytest.approx(np.pi / 2, abs=0.02)


def test_fourier_similarity_equals_trying_all_shifts(rng):
    one, other = rng.random((7, 16, 5)).astype(np.float32), rng.random((9, 16, 5)).astype(np.float32)
    fast = cyclic.best_similarity(cyclic._spectra(one), cyclic._spectra(other), n_satellites=16, n_shifts=16)
    slow = [[max(np.sum(np.roll(a, -k, axis=0) * b) for k in range(16)) for b in other] for a in one]
    np.testing.assert_allclose(fast, slow, rtol=1e-5)


def test_ratio_ignores_competitors_at_the_same_place():
    table = np.array([[0.9, 0.89, 0.5]], np.float32)
    best, ratio = _kernels.nearest_apart(table, np.array([[0.0, 0.0], [3.0, 0.0], [50.0, 0.0]]), 6.0)
    assert best[0] == 0
    assert ratio[0] == pytest.approx(np.sqrt((2 - 1.8) / (2 - 1.0)), rel=1e-5)


def test_pyramid_keeps_places():
    y, x = np.mgrid[:200, :240]
    blob = 100.0 * np.exp(-((x - 101.3) ** 2 + (y - 77.8) ** 2) / (2 * 12.0**2))
    pyramid = build_pyramid(blob.astype(np.float32), None, n_levels=6)
    for k in range(len(pyramid)):
        level = pyramid.level(k)
        v, u = np.mgrid[: level.shape[0], : level.shape[1]]
        centre = np.array([[(level * u).sum(), (level * v).sum()]]) / level.sum()
        np.testing.assert_allclose(pyramid.to_image(centre, k)[0], [101.3, 77.8], atol=0.1)
        np.testing.assert_allclose(pyramid.to_level(pyramid.to_image(centre, k), k), centre)


def test_keypoints_find_corners_and_blobs_where_they_are():
    image = np.full((120, 140), 60.0, np.float32)
    image[40:, 50:] = 160.0  # one corner at (49.5, 39.5)
    y, x = np.mgrid[:120, :140]
    image += (80.0 * np.exp(-((x - 100.0) ** 2 + (y - 90.0) ** 2) / (2 * 2.0**2))).astype(np.float32)
    found = detect_keypoints(build_pyramid(image, None, n_levels=4), n_points=40)
    # The strongest response lies a little inside of a corner, by less than half the window of five pixels.
    for place, tolerance in (((49.5, 39.5), 2.5), ((100.0, 90.0), 0.5)):
        assert np.linalg.norm(found.points - place, axis=1).min() < tolerance
    assert len(found.points) <= 40


def test_refinement_recovers_an_affine_map(rng):
    from scipy.ndimage import affine_transform, gaussian_filter

    image = (gaussian_filter(rng.normal(size=(120, 120)), 2.5) * 300 + 100).astype(np.float32)
    A = np.array([[1.05, 0.08], [-0.06, 0.97]])
    centre = np.array([60.0, 60.0])
    # source(y) = image(A (y - c) + c): the target's x lies at A^-1 (x - c) + c; scipy counts (row, column).
    swap = A[::-1, ::-1]
    source = affine_transform(image, swap, centre - swap @ centre, order=3).astype(np.float32)
    points = np.array([[60.0, 60.0], [52.0, 70.0], [75.0, 55.0]])
    truth = (points - centre) @ np.linalg.inv(A).T + centre
    start = np.repeat(np.eye(2)[None], 3, axis=0)
    pyramids = [build_pyramid(i, None, n_levels=1) for i in (image, source)]
    moved, linear, correlation = refine_matches(
        *pyramids, points, np.zeros(3, int), truth + np.array([0.8, -0.7]), start
    )
    # Both are smoothed alike though one is sheared, and sampled linearly: a tenth of a pixel is left.
    np.testing.assert_allclose(moved, truth, atol=0.1)
    np.testing.assert_allclose(linear, np.repeat(np.linalg.inv(A)[None], 3, axis=0), atol=0.03)
    assert (correlation > 0.98).all()


def test_refinement_moves_a_patch_whose_shape_is_known(rng):
    from scipy.ndimage import gaussian_filter, shift

    image = (gaussian_filter(rng.normal(size=(120, 120)), 2.5) * 300 + 100).astype(np.float32)
    source = shift(image, (0.4, -0.3), order=3).astype(np.float32)  # (row, column)
    pyramids = [build_pyramid(i, None, n_levels=1) for i in (image, source)]
    points, start = np.array([[60.0, 60.0], [52.0, 70.0], [75.0, 55.0]]), np.repeat(np.eye(2)[None], 3, axis=0)
    moved, linear, _ = refine_matches(*pyramids, points, np.zeros(3, int), points + 0.5, start, holds_shape=True)
    np.testing.assert_array_equal(linear, start)
    np.testing.assert_allclose(moved, points + np.array([-0.3, 0.4]), atol=0.06)  # sampled linearly


def test_refinement_says_what_it_lost(rng):
    pyramids = [build_pyramid(rng.normal(100, 30, (60, 60)).astype(np.float32), None, n_levels=1) for _ in range(2)]
    start = np.array([[30.0, 30.0], [1.0, 1.0]])
    moved, _, correlation = refine_matches(
        *pyramids, start, np.zeros(2, int), start, np.repeat(np.eye(2)[None], 2, axis=0)
    )
    assert correlation[1] == -1.0  # the patch leaves the image
    np.testing.assert_array_equal(moved[1], start[1])
    assert correlation[0] < 0.7


def test_agreement_counts_neighbours(rng):
    target = rng.uniform(0, 100, (6, 2))
    source = target + np.array([5.0, 3.0])
    source[5] += 40.0
    linear = np.repeat(np.eye(2)[None], 6, axis=0)
    neighbours = np.array([[j for j in range(6) if j != i] for i in range(6)])
    np.testing.assert_array_equal(
        _kernels_agreement.count_agreeing(target, source, linear, neighbours, 1.0, 0.01), [4] * 5 + [0]
    )


def test_local_misfit_is_the_distance_from_the_neighbours_map(rng):
    target = rng.uniform(0, 100, (13, 2))
    source = target @ np.array([[1.1, 0.2], [-0.1, 0.9]]).T + [4.0, -2.0]
    source[0] += [3.0, 4.0]
    neighbours = np.array([[j for j in range(13) if j != i] for i in range(13)])
    misfit = _kernels_agreement.local_misfit(target, source, neighbours)
    assert misfit[0] == pytest.approx(5.0, abs=0.01)
    assert misfit[1:].max() < 0.5  # one of twelve neighbours is off: it hardly counts


def test_overlapping_patches_are_one_witness():
    points = np.array([[0.0, 0.0], [1.0, 1.0], [10.0, 0.0], [10.0, 30.0]])
    assert count_apart(points, np.full(4, 5.0)) == 3
    assert count_apart(points, np.full(4, 0.5)) == 4
    assert count_apart(points, np.full(4, 100.0)) == 1
    assert count_apart(points[:0], np.empty(0)) == 0


def test_patches_that_overlap_are_one_witness_of_a_motion():
    def moved(places, shift):
        places = np.array(places, dtype=float)
        same = np.repeat(np.eye(2)[None], len(places), axis=0)
        return Pairs(np.arange(len(places)), places, places + shift, same, np.ones(len(places)))

    clump = moved([[10.0 + k, 20.0] for k in range(6)], [40.0, 0.0])
    spread = moved([[30.0 * k, 100.0] for k in range(5)], [0.0, -25.0])
    witnesses = count_witnesses(clump.join(spread), np.full(11, 8.0), slack=2.0, growth=0.1)
    np.testing.assert_array_equal(witnesses, [1] * 6 + [5] * 5)
    assert len(count_witnesses(no_pairs(), np.empty(0), slack=2.0, growth=0.1)) == 0
