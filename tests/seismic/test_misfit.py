from __future__ import annotations

import numba
import numpy as np
import pytest

from seismo3d.seismic import _kernels_misfit as kernels
from seismo3d.seismic.misfit import compare_along, depth_energies, energy_floor, fuse_misfits, measure_ratios
from seismo3d.seismic.misfit_settings import MisfitSettings

SHAPE = (24, 24, 64)


def layers(p=0.0, q=0.0, *, shape=SHAPE, seed=3):
    """Layers of random reflectivity that slope everywhere alike."""
    values = np.convolve(np.random.default_rng(seed).normal(size=600), np.hanning(9), "same")
    i, x, k = np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")
    volume = np.interp(k - p * i - q * x, np.arange(-250, 350), values)
    return (volume / volume.std()).astype(np.float32)


def cut(axis, *, at=12, shape=SHAPE):
    """Two sides that have nothing to do with each other, the second from trace `at` on."""
    volume = layers(shape=shape)
    second = [slice(None)] * 3
    second[axis] = slice(at, None)
    volume[tuple(second)] = layers(shape=shape, seed=8)[tuple(second)]
    return volume


def slopes(volume, p=0.0, q=0.0):
    return np.full(volume.shape, p, np.float32), np.full(volume.shape, q, np.float32)


def everywhere(volume):
    return np.ones(volume.shape, bool)


def measure(volume, valid=None, p=0.0, q=0.0, **settings):
    valid = everywhere(volume) if valid is None else valid
    along = compare_along(volume, valid, slopes(volume, p, q))
    return fuse_misfits(volume, valid, [along], settings=MisfitSettings(**settings))


# ----- kernels


def plain_side_misfit(volume, valid, slope, axis, reach):
    """The kernel's definition, for slopes of whole samples."""
    difference, energy = np.zeros(volume.shape), np.full(volume.shape, -1.0)
    for index in np.ndindex(*volume.shape):
        means = []
        for sign in (-1, 1):
            values = []
            for t in range(1, reach + 1):
                at = list(index)
                at[axis] += sign * t
                if not 0 <= at[axis] < volume.shape[axis]:
                    continue
                at[2] += int(sign * t * slope[tuple(at)])
                if 0 <= at[2] < volume.shape[2] and valid[tuple(at)]:
                    values.append(volume[tuple(at)])
            means.append(np.mean(values) if values else None)
        if None not in means:
            difference[index] = (means[0] - means[1]) ** 2
            energy[index] = means[0] ** 2 + means[1] ** 2
    return difference, energy


@pytest.mark.parametrize("axis", [0, 1])
def test_kernel_equals_its_definition(rng, axis):
    shape = (6, 7, 12)
    volume = rng.normal(size=shape).astype(np.float32)
    slope = rng.integers(-1, 2, shape).astype(np.float32)
    # interpolation needs the sample below too: whole traces are missing, so that this makes no difference
    valid = np.repeat(rng.random((*shape[:2], 1)) > 0.2, shape[2], axis=2)
    difference, energy = np.empty_like(volume), np.empty_like(volume)
    kernels.side_misfit(volume, valid, slope, axis, 3, (0, 0), difference, energy)
    expected = plain_side_misfit(volume, valid, slope, axis, 3)
    np.testing.assert_allclose(difference, expected[0], atol=1e-5)
    np.testing.assert_allclose(energy, expected[1], atol=1e-5)
    part = [np.empty((3, 4, 12), np.float32) for _ in range(2)]
    kernels.side_misfit(volume, valid, slope, axis, 3, (2, 1), *part)
    np.testing.assert_array_equal(part, [difference[2:5, 1:5], energy[2:5, 1:5]])


@pytest.mark.parametrize("signed", [-2, 1])
def test_a_trace_without_holes_is_carried_as_one_with_holes_beyond_reach(rng, signed):
    """The branch-free loop and the one that looks for holes give the same bits, at the ends of the trace too."""
    n = 37
    row = rng.normal(size=n).astype(np.float32)
    slope = rng.uniform(-3.0, 3.0, n).astype(np.float32)
    longer, steeper = np.append(row, np.float32(9.0)), np.append(slope, np.float32(0.0))
    found = []
    for values, slopes in ((row, slope), (longer, steeper)):
        side, count = np.full(len(values), 0.5, np.float32), np.zeros(len(values), np.float32)
        usable = np.arange(len(values)) < n
        kernels.add_carried(values, usable, slopes, signed, np.empty(len(values) + 3, np.float32), side, count)
        found.append((side[:n], count[:n]))
    # at the very end the longer trace has a sample to go on to
    z = np.arange(n, dtype=np.float32) + np.float32(signed) * slope
    same = (z < n - 1) | (z > n)
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one[same], other[same])
    assert same.sum() > 30
    np.testing.assert_array_equal(found[0][1], (z >= 0) & (z <= n - 1))


def test_sides_are_compared_where_neither_is_empty():
    side = np.array([[2.0, 6.0, 1.0], [3.0, 1.0, 8.0]], np.float32)
    count = np.array([[2.0, 3.0, 0.0], [1.0, 1.0, 2.0]], np.float32)
    difference, energy = np.empty(3, np.float32), np.empty(3, np.float32)
    kernels.compare_sides(side, count, difference, energy)
    np.testing.assert_array_equal(difference, [4.0, 1.0, 0.0])
    np.testing.assert_array_equal(energy, [10.0, 5.0, -1.0])


def test_interpolation_of_a_smooth_trace_is_exact_to_a_thousandth():
    depth = np.arange(40.0)
    row = np.sin(2 * np.pi * depth / 16).astype(np.float32)
    usable = np.ones(40, bool)
    for z in np.linspace(2.0, 37.0, 90):
        value, weight = kernels._sample(row, usable, z, 40)
        assert weight == 1.0
        assert value == pytest.approx(np.sin(2 * np.pi * z / 16), abs=2e-3)


@pytest.mark.parametrize("z", [-0.1, 39.1, 9.5, 10.5])
def test_interpolation_refuses_what_is_not_there(z):
    usable = np.ones(40, bool)
    usable[10] = False
    assert kernels._sample(np.ones(40, np.float32), usable, z, 40) == (0.0, 0.0)


def test_unknown_energy_is_cleared(rng):
    energy = rng.normal(size=(3, 4, 5)).astype(np.float32)
    energy[energy < 0] = -1.0
    before = energy.copy()
    known = np.empty_like(energy)
    kernels.clear_unknown(energy, known)
    np.testing.assert_array_equal(known, before >= 0)
    np.testing.assert_array_equal(energy, np.maximum(before, 0))


def test_ratio_is_taken_where_it_is_known(rng):
    difference, energy, known = (rng.random((3, 4, 9)).astype(np.float32) for _ in range(3))
    known[1, 1] = 0.0
    out, weight = np.empty_like(known), np.empty_like(known)
    floor = rng.random(9).astype(np.float32)
    kernels.divide_known(difference, energy, known, floor, np.float32(1.5), out, weight)
    ratio = difference / np.maximum(known, 1e-9) / (energy + floor)
    usable = known > 0.05
    np.testing.assert_allclose(out, np.where(usable, np.minimum(ratio, 1.5), 0.0), rtol=1e-5)
    np.testing.assert_allclose(weight, np.where(usable, known, 0.0))


@pytest.mark.parametrize("step", [1, 2, 3])
def test_ratios_of_some_traces_are_those_of_all_in_any_slabs(rng, step):
    volume = rng.normal(size=(30, 28, 17)).astype(np.float32)
    slopes = tuple(rng.uniform(-1.0, 1.0, volume.shape).astype(np.float32) for _ in range(2))
    valid = rng.random(volume.shape) > 0.02
    compare = compare_along(volume, valid, slopes)
    inner = (slice(9, 21), slice(4, 28))
    found = []
    for slab, within in ((64, (slice(0, 30), slice(0, 28))), (5, inner)):
        floor = np.linspace(0.01, 0.02, 17).astype(np.float32)
        ratios, known = measure_ratios(volume.shape, compare, 3, floor, MisfitSettings(slab=slab, step=step), within)
        found.append(np.stack(ratios + known))
    assert found[0].shape == (4, 30, 28, -(-17 // step))
    np.testing.assert_array_equal(found[1], found[0][(slice(None), *inner)])


def test_logarithm_in_place(rng):
    ratio = rng.random((3, 4, 5)).astype(np.float32)
    expected = np.log1p(ratio.astype(np.float64) / 0.05)
    kernels.log_ratio(ratio, np.float32(0.05))
    np.testing.assert_allclose(ratio, expected, rtol=1e-5)


# ----- evidence


@pytest.mark.parametrize(("p", "q"), [(0.0, 0.0), (0.5, -0.25), (-1.0, 1.0), (1.3, 0.4)])
def test_unbroken_layers_leave_no_misfit(p, q):
    evidence = measure(layers(p, q), p=p, q=q)
    assert evidence.noise < 2e-3
    assert evidence.noisiness == 0.0
    raw = measure(layers(p, q), p=p, q=q, levelling=0.0)
    for part in (raw.along_inlines, raw.along_crosslines):
        assert np.median(part) < np.log1p(2e-3 / 0.02)
        assert np.percentile(part[4:-4, 4:-4, 10:-10], 99) < 0.5


def test_wrong_slopes_do_leave_one():
    right, wrong = measure(layers(0.8), p=0.8, levelling=0.0), measure(layers(0.8), levelling=0.0)
    assert right.along_inlines.mean() < 0.2
    assert wrong.along_inlines.mean() > 1.0
    assert wrong.along_crosslines.mean() < 0.5


@pytest.mark.parametrize("axis", [0, 1])
def test_unrelated_sides_stand_out_along_their_own_axis(axis):
    evidence = measure(cut(axis), levelling=0.0, lateral=0.0)
    parts = [evidence.along_inlines, evidence.along_crosslines]
    across = np.moveaxis(parts[axis], axis, 0)
    break_here, far = across[11:13], np.concatenate([across[:8], across[16:]])
    # a ratio of 1 on average is log(1 + 1 / 0.02) = 3.9; single voxels scatter widely below that
    assert 2.2 < break_here.mean() < 4.2
    assert far.mean() < 0.1
    assert parts[1 - axis].mean() < 0.5


def test_ratio_of_unrelated_sides_is_one_on_average():
    shape = (4, 4000, 16)
    volume = np.random.default_rng(2).normal(size=shape).astype(np.float32)
    difference, energy = np.empty_like(volume), np.empty_like(volume)
    kernels.side_misfit(volume, everywhere(volume), np.zeros_like(volume), 1, 2, (0, 0), difference, energy)
    known = energy >= 0
    assert difference[known].sum() / energy[known].sum() == pytest.approx(1.0, abs=0.02)


def test_transposed_cube_exchanges_the_axes():
    volume = cut(0) + 0.3 * np.random.default_rng(4).normal(size=SHAPE).astype(np.float32)
    plain = measure(volume, p=0.2, q=-0.3)
    turned = measure(np.ascontiguousarray(volume.transpose(1, 0, 2)), p=-0.3, q=0.2)
    for one, other in (
        (turned.along_crosslines, plain.along_inlines),
        (turned.along_inlines, plain.along_crosslines),
        (turned.known, plain.known),
    ):
        np.testing.assert_allclose(one.transpose(1, 0, 2), other, atol=1e-3)
    assert turned.noise == pytest.approx(plain.noise, abs=1e-5)


@pytest.mark.parametrize("factor", [-1.0, 1024.0, 2.0**-12])
def test_scale_and_sign_of_amplitudes_do_not_matter(factor):
    volume = cut(0) + 0.3 * np.random.default_rng(4).normal(size=SHAPE).astype(np.float32)
    plain, scaled = measure(volume), measure(volume * np.float32(factor))
    np.testing.assert_allclose(scaled.along_inlines, plain.along_inlines, atol=1e-4)
    np.testing.assert_allclose(scaled.along_crosslines, plain.along_crosslines, atol=1e-4)


@pytest.mark.parametrize("slab", [9])
def test_slabs_give_what_the_whole_cube_gives(slab):
    volume = cut(0) + 0.2 * np.random.default_rng(4).normal(size=SHAPE).astype(np.float32)
    whole, parts = measure(volume), measure(volume, slab=slab)
    np.testing.assert_array_equal(parts.along_inlines, whole.along_inlines)
    np.testing.assert_array_equal(parts.along_crosslines, whole.along_crosslines)
    np.testing.assert_array_equal(parts.known, whole.known)


def test_one_thread_and_two_give_the_same_bits():
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("one thread is all there is")
    volume = cut(1) + 0.2 * np.random.default_rng(4).normal(size=SHAPE).astype(np.float32)
    before = numba.get_num_threads()
    try:
        results = []
        for n_threads in (1, 2):
            numba.set_num_threads(n_threads)
            results.append(measure(volume))
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(results[0].along_inlines, results[1].along_inlines)
    np.testing.assert_array_equal(results[0].along_crosslines, results[1].along_crosslines)
    assert (results[0].mean, results[0].spread) == (results[1].mean, results[1].spread)


def test_noise_is_measured():
    volume = layers(shape=(32, 32, 64))
    own = np.random.default_rng(4).normal(size=volume.shape).astype(np.float32)
    measured = [measure(volume + np.float32(share) * own) for share in (0.0, 0.25, 0.5, 1.0)]
    noise = [evidence.noise for evidence in measured]
    assert noise == sorted(noise)
    assert noise[0] < 1e-3
    alone = measure(own)
    assert 0.2 < alone.noise < 0.8
    assert alone.noisiness == 1.0
    assert all(0.0 <= evidence.noisiness <= 1.0 for evidence in measured)


def test_energy_floor_follows_the_mean_energy_down_the_trace():
    volume = np.ones((4, 5, 768), np.float32)
    volume[..., 512:] = 3.0
    floor = energy_floor(depth_energies(volume, everywhere(volume)), 768, MisfitSettings(floor=0.25))
    # two sides' mean energy in the middle of each third, straight in between, and level at the ends
    np.testing.assert_allclose(floor[[0, 127, 383, 639, 767]], [0.5, 0.5, 0.5, 4.5, 4.5], rtol=0.01)
    assert floor[511] == pytest.approx(2.5, rel=0.01)


def test_energy_floor_is_of_what_there_are_data_of():
    volume = np.full((4, 5, 64), 2.0, np.float32)
    valid = everywhere(volume)
    valid[:, ::2] = False
    assert energy_floor(depth_energies(volume, valid), 64, MisfitSettings(floor=0.1)) == pytest.approx(0.8)


def test_what_is_bright_here_and_there_does_not_raise_the_floor(rng):
    volume = rng.normal(size=(20, 20, 128)).astype(np.float32)
    plain = energy_floor(depth_energies(volume, everywhere(volume)), 128, MisfitSettings())
    spot, reflector = volume.copy(), volume.copy()
    spot[:5, :5, 50:70] *= 20.0
    reflector[..., 4:16] *= 20.0
    for bright in (spot, reflector):
        floor = energy_floor(depth_energies(bright, everywhere(bright)), 128, MisfitSettings())
        assert (floor < 2.0 * plain).all()


def test_a_depth_without_energy_has_a_hundredth_of_the_mean():
    volume = np.ones((3, 3, 512), np.float32)
    volume[..., 256:] = 0.0
    floor = energy_floor(depth_energies(volume, everywhere(volume)), 512, MisfitSettings(floor=0.5))
    assert floor[-1] == pytest.approx(0.005)
    nothing = np.zeros_like(volume)
    assert (energy_floor(depth_energies(nothing, everywhere(nothing)), 512, MisfitSettings()) > 0.0).all()


def test_noise_between_strong_reflectors_is_less_evidence_than_a_break_of_them():
    """Sides that hold noise alone differ much in proportion to themselves, and little to the cube."""
    rng = np.random.default_rng(2)
    volume = cut(0, at=18, shape=(36, 24, 64))
    volume[..., 32:] = 0.0
    volume += 0.15 * rng.normal(size=volume.shape).astype(np.float32)
    ratios = {}
    for floor in (0.01, 0.25):
        evidence = measure(volume, floor=floor, footprint=0.0, levelling=0.0).along_inlines
        ratios[floor] = evidence[4:12, :, 20:].mean() / evidence[17:19, :, 2:14].mean()
    assert ratios[0.25] < 0.75 * ratios[0.01]


def test_dead_traces_are_bridged():
    volume = cut(0)
    dead = np.random.default_rng(6).random(SHAPE[:2]) < 0.12
    valid = everywhere(volume)
    valid[dead] = False
    holed = np.where(valid, volume, 0)
    whole, bridged = measure(volume, levelling=0.0), measure(holed, valid, levelling=0.0)
    # no wall of evidence around a dead trace, and the break is still there
    quiet = np.ones(SHAPE[0], bool)
    quiet[8:16] = False
    assert bridged.along_crosslines[quiet].mean() < 0.1
    assert bridged.along_inlines[quiet].mean() < 0.1
    assert bridged.along_inlines[11:13].mean() > 0.7 * whole.along_inlines[11:13].mean()


def test_evidence_below_a_mute_is_that_of_a_cube_that_begins_there():
    volume = cut(0, shape=(24, 24, 96))
    valid = everywhere(volume)
    valid[:, :, :32] = False
    short = volume[:, :, 32:]
    whole, part = measure(np.where(valid, volume, 0), valid), measure(np.ascontiguousarray(short))
    for name in ("noise", "noisiness", "mean", "spread"):
        assert getattr(whole, name) == pytest.approx(getattr(part, name), rel=5e-3)
    assert part.present is None
    assert not whole.present[:, :, :12].any()
    assert whole.present[:, :, 16:].all()
    # levelling looks up to 22 samples on
    for one, other in ((whole.along_inlines, part.along_inlines), (whole.along_crosslines, part.along_crosslines)):
        np.testing.assert_allclose(one[:, :, 28:], other[:, :, 12:], atol=0.03)
        np.testing.assert_allclose(one[:, :, 16:], other, atol=0.25)


def test_nothing_is_known_where_there_are_no_data():
    volume = layers()
    valid = everywhere(volume)
    valid[:, :12] = False
    volume[~valid] = 0.0
    evidence = measure(volume, valid)
    # one empty trace is looked across by the traces averaged on either side, a wide zone is not
    assert not evidence.known[:, :8].any()
    assert (evidence.known[:, 14:-1] == 1.0).all()
    for part in (evidence.along_inlines, evidence.along_crosslines):
        assert np.isfinite(part).all()
        assert part.max() < 0.5


@pytest.mark.parametrize("some", [True, False])
def test_zeros_and_nothing_at_all(some):
    volume = np.zeros((10, 10, 20), np.float32)
    evidence = measure(volume, np.full(volume.shape, some))
    assert not evidence.along_inlines.any()
    assert not evidence.along_crosslines.any()
    assert evidence.noise == 0.0
    assert evidence.known.any() == some


@pytest.mark.parametrize(("step", "n_samples", "expected"), [(1, 64, 64), (2, 64, 32), (2, 65, 33), (3, 64, 22)])
def test_evidence_is_thinned_along_the_samples(step, n_samples, expected):
    evidence = measure(layers(shape=(8, 8, n_samples)), step=step)
    assert evidence.along_inlines.shape == (8, 8, expected)
    assert evidence.step == step


def test_section_has_evidence_along_its_own_traces_alone():
    evidence = measure(cut(1)[:1])
    assert evidence.known[0, 4:-4].all()
    assert evidence.along_crosslines[0, 11:13].mean() > 1.5
    assert evidence.along_inlines.max() < 0.5
