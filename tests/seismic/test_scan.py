from __future__ import annotations

import numba
import numpy as np
import pytest

from seismo3d.seismic import _kernels_scan as kernels
from seismo3d.seismic._kernels_filters import gaussian_taps
from seismo3d.seismic.misfit import Evidence
from seismo3d.seismic.scan import (
    PlanarSupport,
    RidgePoints,
    ScanSettings,
    find_offsets,
    leave_layers,
    scan_planes,
    thin,
)

SHAPE = (40, 40, 64)
STEP = 2
CENTRE = np.array([19.3, 20.6, 30.0])


def plane_of(strike_deg, dip_deg):
    """Horizontal normal towards which the plane moves as it goes down, and the cotangent of its dip."""
    strike = np.radians(strike_deg)
    return np.array([-np.sin(strike), np.cos(strike)]), 1.0 / np.tan(np.radians(dip_deg))


def distance_from(strike_deg, dip_deg, points):
    normal, cotangent = plane_of(strike_deg, dip_deg)
    return (points[..., :2] - CENTRE[:2]) @ normal - cotangent * (points[..., 2] - CENTRE[2])


def grid(shape=SHAPE, step=STEP):
    n = (shape[0], shape[1], -(-shape[2] // step))
    return np.stack(np.meshgrid(*(np.arange(m, dtype=float) for m in n), indexing="ij"), -1) * [1, 1, step]


def evidence_of(strike_deg=90.0, dip_deg=65.0, *, shape=SHAPE, noise=0.0, noisiness=0.0):
    """A ridge of evidence on a plane, in the shares that its strike gives to the two axes."""
    normal, _ = plane_of(strike_deg, dip_deg)
    ridge = np.exp(-0.5 * (distance_from(strike_deg, dip_deg, grid(shape)) / 1.2) ** 2)
    rng = np.random.default_rng(9)
    parts = [(3.0 * share * ridge + noise * rng.normal(size=ridge.shape)).astype(np.float32) for share in normal**2]
    known = np.ones(ridge.shape, np.float32)
    return Evidence(parts[0], parts[1], known, 0.0, noisiness, 0.2, 0.8, STEP)


# ----- kernels against their definition


def plain_strike_lines(first, second, w_first, w_second, shear, taps):
    both = w_first * first.astype(np.float64) + w_second * second
    n0, n1, _ = both.shape
    half = len(taps) // 2
    out = np.zeros_like(both)
    for i in range(n0):
        for j in range(n1):
            total = 0.0
            for t in range(-half, half + 1):
                low = int(np.floor(shear * t))
                fraction = shear * t - low
                for ii, share in ((i + low, 1 - fraction), (i + low + 1, fraction)):
                    weight = taps[t + half] * share
                    if weight > 1e-5 and 0 <= ii < n0 and 0 <= j + t < n1:
                        total += weight
                        out[i, j] += weight * both[ii, j + t]
            out[i, j] /= max(total, 0.2)
    return out


@pytest.mark.parametrize("shear", [0.0, 1.0, -0.37, 0.5])
def test_lines_along_strike_equal_their_definition(rng, shear):
    first, second = (rng.normal(size=(8, 9, 6)).astype(np.float32) for _ in range(2))
    taps = gaussian_taps(1.2)
    out = np.full((8, 9, 6 + 4), np.nan, np.float32)
    kernels.sum_strike_lines(first, second, np.float32(0.7), np.float32(0.3), shear, taps, 2, (0, 0), out)
    expected = plain_strike_lines(first, second, np.float32(0.7), np.float32(0.3), shear, taps)
    np.testing.assert_allclose(out[:, :, 2:-2], expected, atol=1e-5)
    assert not out[:, :, :2].any()
    assert not out[:, :, -2:].any()


def plain_best_dip(lines, shears, taps, prior, prior_weight, evenness, *, known=None):
    n0, n1, n2 = lines.shape
    half = len(taps) // 2
    means = np.zeros((len(shears), n0, n1, n2))
    for c, shear in enumerate(shears):
        for i, j, k in np.ndindex(n0, n1, n2):
            sums, weights = np.full(2, prior_weight * prior), np.full(2, prior_weight)
            for t in range(-half, half + 1):
                if not 0 <= k + t < n2:
                    continue
                low = int(np.floor(shear * t))
                fraction = shear * t - low
                # the middle row belongs to both halves
                for part in (0, 1) if t == 0 else ((0,) if t < 0 else (1,)):
                    for ii, share in ((i + low, 1 - fraction), (i + low + 1, fraction)):
                        if 0 <= ii < n0:
                            weight = taps[t + half] * share * (1.0 if known is None else known[ii, j, k + t])
                            sums[part] += weight * lines[ii, j, k + t]
                            weights[part] += weight
            mean = sums.sum() / weights.sum()
            means[c, i, j, k] = (1 - evenness) * mean + evenness * (sums / weights).min()
    return means


@pytest.mark.parametrize("evenness", [0.0, 0.5])
def test_best_dip_equals_its_definition(rng, evenness):
    # more rows than one batch of the kernel holds
    values = rng.normal(size=(6, 19, 10)).astype(np.float32)
    taps = gaussian_taps(1.2)
    half = len(taps) // 2
    lines = np.ascontiguousarray(np.pad(values, ((0, 0), (0, 0), (half, half))))
    shears = np.linspace(-1.3, 1.3, 5)
    best, arg = np.full(values.shape, -9.0, np.float32), np.full(values.shape, -1, np.int16)
    settings = (np.float32(0.3), np.float32(0.1), np.float32(evenness))
    kernels.keep_best_dip(lines, lines[:0], 0, shears, taps, *settings, 40, best, arg)
    means = plain_best_dip(values, shears, taps, *(float(s) for s in settings))
    np.testing.assert_allclose(best, means.max(axis=0), atol=1e-5)
    assert ((arg >= 40) & (arg < 45)).all()
    chosen = np.take_along_axis(means, (arg - 40)[None].astype(np.int64), axis=0)[0]
    np.testing.assert_allclose(chosen, best, atol=1e-5)


def test_what_is_not_known_of_a_plane_counts_nothing(rng):
    values = rng.normal(size=(6, 19, 10)).astype(np.float32)
    known = (rng.random(values.shape) > 0.4).astype(np.float32)
    taps = gaussian_taps(1.2)
    half = len(taps) // 2
    room = ((0, 0), (0, 0), (half, half))
    lines, shares = (np.ascontiguousarray(np.pad(part, room)) for part in (values * known, known))
    shears = np.linspace(-1.3, 1.3, 5)
    best, arg = np.full(values.shape, -9.0, np.float32), np.full(values.shape, -1, np.int16)
    settings = (np.float32(0.3), np.float32(0.1), np.float32(0.5))
    kernels.keep_best_dip(lines, shares, 0, shears, taps, *settings, 40, best, arg)
    means = plain_best_dip(values, shears, taps, *(float(s) for s in settings), known=known)
    np.testing.assert_allclose(best, means.max(axis=0), atol=1e-5)


def test_what_was_better_before_stays():
    best, arg = np.full((3, 4, 6), 50.0, np.float32), np.full((3, 4, 6), 7, np.int16)
    taps = gaussian_taps(1.0)
    lines = np.ones((3, 4, 6 + len(taps) - 1), np.float32)
    kernels.keep_best_dip(
        lines, lines[:0], 0, np.zeros(1), taps, np.float32(0), np.float32(0.1), np.float32(0.5), 9, best, arg
    )
    assert (best == 50.0).all()
    assert (arg == 7).all()


def test_merge_takes_the_larger(rng):
    best, other = rng.normal(size=(4, 5, 6)).astype(np.float32), rng.normal(size=(5, 4, 6)).astype(np.float32)
    arg, other_arg = np.zeros(best.shape, np.int16), np.ones(other.shape, np.int16)
    turned = other.transpose(1, 0, 2)
    expected = np.maximum(best, turned), (turned > best).astype(np.int16)
    kernels.merge_best(best, arg, other, other_arg)
    np.testing.assert_array_equal(best, expected[0])
    np.testing.assert_array_equal(arg, expected[1])


# ----- the scan


@pytest.mark.parametrize(
    ("strike_deg", "dip_deg"),
    [(0.0, 65.0), (90.0, 65.0), (45.0, 60.0), (135.0, 75.0), (200.0, 50.0), (290.0, 80.0), (65.0, 89.9)],
)
def test_plane_is_found_with_its_orientation(strike_deg, dip_deg):
    evidence = evidence_of(strike_deg, dip_deg)
    support = scan_planes(evidence)
    ridges = thin(support, evidence, least=0.5)
    inner = ((ridges.positions > 6) & (ridges.positions < np.array(SHAPE) - 7)).all(axis=1)
    assert inner.sum() > 200
    normal, cotangent = plane_of(strike_deg, dip_deg)
    found = ridges.planes[inner]
    sign = np.sign(found[:, :2] @ normal)
    np.testing.assert_allclose(np.hypot(found[:, 0], found[:, 1]), 1.0, atol=1e-5)
    # within the step of the tried orientations: an eighth of a half turn, and their cotangents
    angle = np.degrees(np.arccos(np.clip(np.abs(found[:, :2] @ normal), 0, 1)))
    assert np.median(angle) < 6.0
    assert np.median(np.abs(sign * found[:, 2] - cotangent)) < 0.15
    off = distance_from(strike_deg, dip_deg, ridges.positions[inner])
    assert np.abs(np.median(off)) < 0.1
    assert np.percentile(np.abs(off), 95) < 0.35


def test_crest_is_one_point_thick():
    evidence = evidence_of(90.0, 70.0)
    voxels = thin(scan_planes(evidence), evidence, least=0.5).voxels
    inner = voxels[((voxels > 5) & (voxels < np.array([34, 34, 26]))).all(axis=1)]
    # strike along the second axis: one point for each crossline and sample
    places, counts = np.unique(inner[:, 1:], axis=0, return_counts=True)
    assert counts.max() == 1
    assert len(places) > 0.95 * (28 * 20)


def test_transposed_evidence_gives_transposed_support():
    plain = evidence_of(30.0, 65.0, noise=0.3)
    turned = Evidence(
        np.ascontiguousarray(plain.along_crosslines.transpose(1, 0, 2)),
        np.ascontiguousarray(plain.along_inlines.transpose(1, 0, 2)),
        plain.known.transpose(1, 0, 2), 0.0, 0.0, 0.2, 0.8, STEP,
    )  # fmt: skip
    one, other = scan_planes(plain), scan_planes(turned)
    # planes at 45 degrees are carried down their dip along one of the two axes: there alone the interpolation differs
    gap = np.abs(other.score.transpose(1, 0, 2) - one.score)
    assert np.percentile(gap, 95) < 0.05
    assert gap.max() < 0.4


def test_score_is_in_spreads_of_the_evidence():
    """Constant evidence lies on every plane: the score is its excess over the mean, in spreads."""
    values = np.full((12, 12, 24), 2.6, np.float32)
    evidence = Evidence(values, values.copy(), np.ones_like(values), 0.0, 0.0, 1.0, 0.8, STEP)
    np.testing.assert_allclose(scan_planes(evidence).score, 2.0, atol=1e-3)


def test_a_cube_under_a_mute_is_scanned_like_one_that_begins_there():
    whole = evidence_of(60.0, 65.0, noise=0.3)
    known, present = whole.known.copy(), np.ones(whole.known.shape, bool)
    known[:, :, :9], present[:, :, :9] = 0.0, False
    muted = Evidence(whole.along_inlines, whole.along_crosslines, known, 0.0, 0.0, 0.2, 0.8, STEP, present)
    parts = (np.ascontiguousarray(v[:, :, 9:]) for v in (whole.along_inlines, whole.along_crosslines, whole.known))
    short = Evidence(*parts, 0.0, 0.0, 0.2, 0.8, STEP)
    found, wanted = scan_planes(muted), scan_planes(short)
    # lines along strike of which next to nothing is within the cube count less where some is not known
    inner = (slice(10, -10), slice(10, -10))
    np.testing.assert_allclose(found.score[inner][:, :, 9:], wanted.score[inner], atol=1e-4)
    np.testing.assert_allclose(found.score[:, :, 9:], wanted.score, atol=0.1)
    filled = np.abs(scan_planes(whole).score[:, :, 9:] - wanted.score)
    assert filled.max() > 0.1


def test_noise_has_little_support():
    rng = np.random.default_rng(3)
    parts = [rng.normal(size=(24, 24, 32)).astype(np.float32) for _ in range(2)]
    evidence = Evidence(parts[0], parts[1], np.ones_like(parts[0]), 0.0, 0.0, 0.0, 1.0, STEP)
    assert np.percentile(scan_planes(evidence).score, 99) < 0.9
    assert scan_planes(evidence_of(90.0, 65.0)).score.max() > 1.5


@pytest.mark.parametrize(
    ("shape", "noise", "expected"),
    [
        ((9, 9, 9), 0.1, (-0.2 * 0.16 / 0.1744, 0.2 * 0.16 / 0.1744)),
        ((9, 9, 9), 0.018, (-0.1 * 0.16 / 0.1744, 0.1 * 0.16 / 0.1744)),
        ((9, 9, 9), 0.0, (0.0, 0.0)),
        ((1, 9, 9), 0.1, (0.0, 0.0)),
    ],
    ids=["noise", "half of mild noise", "no noise", "section"],
)
def test_both_ways_are_scanned_about_one_median_in_noise(shape, noise, expected):
    assert find_offsets([1.0, 0.6], shape, noise) == pytest.approx(expected)


def test_a_small_difference_of_both_ways_is_left_to_the_faults():
    assert np.abs(find_offsets([1.0, 0.95], (9, 9, 9), 0.1)).max() < 0.005


def test_planes_across_the_noisier_axis_have_no_support_for_that_alone():
    """Evidence that is higher everywhere along one axis, as gridding leaves it, is no fault."""
    rng = np.random.default_rng(5)
    parts = [(level + 0.3 * rng.normal(size=(24, 24, 32))).astype(np.float32) for level in (1.4, 0.6)]
    scores = []
    for values in (parts, [parts[0] - 0.4, parts[1] + 0.4]):
        evidence = Evidence(*(v.astype(np.float32) for v in values), np.ones_like(parts[0]), 0.1, 0.3, 1.0, 0.8, STEP)
        scores.append(np.median(scan_planes(evidence).score))
    assert scores[0] == pytest.approx(scores[1], abs=0.02)
    assert scores[0] < 0.2


@pytest.mark.parametrize("axis", [0, 1])
def test_section_is_scanned_at_full_strength(axis):
    """A trace thick, a section is its own line along strike: as strong as the cube that repeats it."""
    strike = 0.0 if axis == 0 else 90.0
    cube = evidence_of(strike, 65.0)
    pick = [slice(None)] * 3
    pick[axis] = slice(20, 21)
    part = [np.ascontiguousarray(v[tuple(pick)]) for v in (cube.along_inlines, cube.along_crosslines, cube.known)]
    section = Evidence(*part, 0.0, 0.0, 0.2, 0.8, STEP)
    support = scan_planes(section)
    assert support.score.shape == part[0].shape
    points = grid()[tuple(pick)]
    on_plane = (np.abs(distance_from(strike, 65.0, points)) < 0.5) & (np.abs(points[..., 2] - 32) < 16)
    whole = scan_planes(cube).score[tuple(pick)]
    assert support.score[on_plane].mean() == pytest.approx(whole[on_plane].mean(), rel=0.1)
    ridges = thin(support, section, least=0.5)
    assert len(ridges.score) > 20
    assert np.percentile(np.abs(distance_from(strike, 65.0, ridges.positions)), 90) < 0.5
    assert not ridges.positions[:, axis].any()


def test_one_thread_and_two_give_the_same_bits():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread is all there is")
    evidence = evidence_of(30.0, 65.0, noise=0.5)
    before = numba.get_num_threads()
    try:
        results = []
        for n_threads in (1, 2):
            numba.set_num_threads(n_threads)
            results.append(scan_planes(evidence))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0].score, results[1].score)
    np.testing.assert_array_equal(results[0].orientation, results[1].orientation)


def test_progress_rises_to_one():
    told = []
    scan_planes(
        evidence_of(shape=(12, 12, 24)),
        settings=ScanSettings(n_strikes=4, n_dips=(3, 3)),
        progress=lambda *step: told.append(step),
    )
    assert {stage for stage, _ in told} == {"scan"}
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


# ----- thinning


def flat_support(profile):
    """Support that depends on the inline alone, with a vertical plane across inlines as the best everywhere."""
    score = np.broadcast_to(np.asarray(profile, np.float32)[:, None, None], (len(profile), 5, 4)).copy()
    support = PlanarSupport(score, np.zeros(score.shape, np.int16), np.array([[1.0, 0.0, 0.0]], np.float32))
    known = np.ones(score.shape, np.float32)
    return support, Evidence(score, score, known, 0.0, 0.0, 0.0, 1.0, STEP)


@pytest.mark.parametrize("peak", [3.0, 3.2, 3.49, 2.7])
def test_parabola_gives_the_crest_between_voxels(peak):
    support, evidence = flat_support(5.0 - 0.2 * (np.arange(7) - peak) ** 2)
    ridges = thin(support, evidence, least=0.5)
    assert len(ridges.score) == 20
    np.testing.assert_allclose(ridges.positions[:, 0], peak, atol=1e-4)
    np.testing.assert_array_equal(ridges.voxels[:, 0], round(peak))
    np.testing.assert_array_equal(ridges.positions[:, 2], STEP * ridges.voxels[:, 2])


def test_weak_crests_and_rises_towards_the_edge_are_left_out():
    support, evidence = flat_support([4, 3, 2, 1, 1.4, 1, 2, 3])
    assert len(thin(support, evidence, least=1.5).score) == 0
    assert set(thin(support, evidence, least=0.5).voxels[:, 0]) == {4}


def test_crest_between_flanks_below_the_mean_is_kept():
    support, evidence = flat_support([-0.6, -0.5, 1.2, -0.4, -0.6])
    assert set(thin(support, evidence, least=0.5).voxels[:, 0]) == {2}


def crests_at(strike_deg, dip_degs):
    """One crest for each dip, at different samples of one trace."""
    samples = STEP * np.arange(len(dip_degs))
    voxels = np.column_stack([np.full((len(dip_degs), 2), (7, 9)), samples // STEP]).astype(np.int32)
    planes = np.array([(*normal, cot) for normal, cot in (plane_of(strike_deg, dip) for dip in dip_degs)], np.float32)
    positions = np.column_stack([voxels[:, :2], samples]).astype(np.float32)
    return RidgePoints(voxels, positions, planes, np.ones(len(dip_degs), np.float32))


def layers_of(strike_deg, dip_deg, shape=(16, 18, 24)):
    normal, cotangent = plane_of(strike_deg, dip_deg)
    return tuple(np.full(shape, part / cotangent, np.float32) for part in normal)


@pytest.mark.parametrize("strike_deg", [0.0, 37.0, 90.0, 211.0])
def test_crests_along_steep_layers_are_left_out(strike_deg):
    dips = np.array([31.0, 34.0, 36.0, 50.0, 64.0, 66.0, 80.0])
    settings = ScanSettings(layer_angles_deg=(15.0, 25.0))
    kept = leave_layers(crests_at(strike_deg, dips), layers_of(strike_deg, 50.0), settings)
    np.testing.assert_array_equal(kept.voxels[:, 2], np.flatnonzero(np.abs(dips - 50.0) > 15.0))


def test_crests_against_the_dip_of_steep_layers_or_across_their_strike_are_kept():
    for turned in (180.0, 90.0, 40.0):
        crests = crests_at(30.0 + turned, [50.0])
        assert len(leave_layers(crests, layers_of(30.0, 50.0), ScanSettings(layer_angles_deg=(15.0, 25.0))).score) == 1


@pytest.mark.parametrize("steep_on", [(0,), (0, 8), (0, -8)], ids=["at it alone", "on one side", "on the other"])
def test_a_break_that_looks_like_steep_layers_is_kept(steep_on):
    p, q = layers_of(0.0, 50.0)
    flat = np.zeros_like(p), np.zeros_like(q)
    for off in steep_on:  # the plane of strike 0 is crossed along crosslines
        for slope, part in zip(flat, (p, q), strict=True):
            slope[7, 9 + off] = part[7, 9 + off]
    assert len(leave_layers(crests_at(0.0, [50.0]), flat, ScanSettings(layer_angles_deg=(15.0, 25.0))).score) == 1


def test_layers_of_a_block_are_read_at_its_corner():
    crests = crests_at(0.0, [50.0, 50.0])
    slopes = layers_of(0.0, 50.0)
    for slope in slopes:
        slope[..., 0] = 0.0
    block = tuple(slope[5:, 1:] for slope in slopes)
    kept = leave_layers(crests, block, ScanSettings(layer_angles_deg=(15.0, 25.0)), corner=(5, 1))
    assert kept.voxels[:, 2].tolist() == [0]


def test_nothing_is_kept_where_nothing_is_known():
    support, evidence = flat_support([0, 1, 3, 1, 0])
    evidence.known[:, :2] = 0.0
    assert set(thin(support, evidence, least=0.5).voxels[:, 1]) == {2, 3, 4}
