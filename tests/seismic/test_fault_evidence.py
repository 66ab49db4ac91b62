from __future__ import annotations

import numpy as np
import pytest

from seismo3d.errors import ParameterError
from seismo3d.seismic.dip import estimate_slopes
from seismo3d.seismic.fault_evidence import EVIDENCE, check_evidence, measure_evidence
from seismo3d.seismic.faults import trace_faults
from seismo3d.seismic.misfit import compare_along, fuse_misfits, shares_at_noise
from seismo3d.seismic.misfit_settings import MisfitSettings
from seismo3d.seismic.scores import fault_score
from seismo3d.seismic.side_shifts import RegistrationSettings
from seismo3d.synthetic import SyntheticFault, fault_cube

SHAPE = (48, 48, 64)


@pytest.fixture(scope="module")
def broken():
    fault = SyntheticFault((24.0, 24.0, 32.0), 45.0, 65.0, 8.0)
    return fault_cube("clean", seed=1, shape=SHAPE, wavelength=(14.0, 14.0), population=None, faults=(fault,))


@pytest.fixture(scope="module")
def unbroken():
    return fault_cube("clean", seed=5, shape=SHAPE, wavelength=(14.0, 14.0), population=None).seismic


def measure(volume, kind, **settings):
    valid = np.ones(volume.shape, bool)
    scaled = (volume / volume.std()).astype(np.float32)
    return measure_evidence(scaled, valid, estimate_slopes(scaled, valid), kind=kind, **settings)


def contrast(evidence, truth):
    """Mean evidence at true fault voxels above that elsewhere, in standard deviations of the evidence elsewhere."""
    at = truth[:, :, :: evidence.step] > 0
    both = np.maximum(evidence.along_inlines, evidence.along_crosslines)
    away = both[~at]
    return (both[at].mean() - away.mean()) / away.std()


@pytest.mark.parametrize("kind", EVIDENCE)
def test_every_evidence_stands_out_at_a_fault(broken, kind):
    assert contrast(measure(broken.seismic, kind), broken.faults) > 2.0


@pytest.mark.parametrize("kind", EVIDENCE)
def test_layers_that_nothing_breaks_leave_next_to_nothing(unbroken, kind):
    evidence = measure(unbroken, kind)
    assert evidence.noise < 0.02
    assert np.median(evidence.along_inlines) < 0.5


def test_semblance_is_the_misfit_along_slopes(broken):
    volume = (broken.seismic / broken.seismic.std()).astype(np.float32)
    valid = np.ones(volume.shape, bool)
    slopes = estimate_slopes(volume, valid)
    first = measure_evidence(volume, valid, slopes, kind="semblance")
    second = fuse_misfits(volume, valid, [compare_along(volume, valid, slopes)])
    np.testing.assert_array_equal(first.along_inlines, second.along_inlines)
    np.testing.assert_array_equal(first.known, second.known)


def test_one_way_twice_is_that_way(broken):
    volume = (broken.seismic / broken.seismic.std()).astype(np.float32)
    valid = np.ones(volume.shape, bool)
    way = compare_along(volume, valid, estimate_slopes(volume, valid))
    once, twice = fuse_misfits(volume, valid, [way]), fuse_misfits(volume, valid, [way, way])
    np.testing.assert_allclose(twice.along_inlines, once.along_inlines, atol=1e-5)
    np.testing.assert_allclose(twice.along_crosslines, once.along_crosslines, atol=1e-5)
    assert (twice.noise, twice.noisiness) == (once.noise, once.noisiness)
    assert (twice.mean, twice.spread) == pytest.approx((once.mean, once.spread))


def test_registration_does_not_look_at_the_slopes(broken):
    volume = (broken.seismic / broken.seismic.std()).astype(np.float32)
    valid = np.ones(volume.shape, bool)
    wrong = (np.full(SHAPE, 3.0, np.float32), np.full(SHAPE, -3.0, np.float32))
    first = measure_evidence(volume, valid, wrong, kind="registration")
    second = measure_evidence(volume, valid, estimate_slopes(volume, valid), kind="registration")
    np.testing.assert_array_equal(first.along_inlines, second.along_inlines)
    np.testing.assert_array_equal(first.along_crosslines, second.along_crosslines)


@pytest.mark.parametrize("kind", EVIDENCE)
def test_a_fault_is_traced_with_every_evidence(broken, kind):
    faults = trace_faults(broken.seismic, evidence=kind)
    assert fault_score(faults.labels, broken.faults).f1 > 0.9
    assert faults.settings["evidence"] == kind


@pytest.mark.parametrize("kind", EVIDENCE)
def test_layers_that_nothing_breaks_have_no_faults(unbroken, kind):
    assert not trace_faults(unbroken, evidence=kind).surfaces


@pytest.mark.parametrize("kind", ["hog", ""])
def test_refuses_what_is_no_evidence(kind, unbroken):
    with pytest.raises(ParameterError, match=r"expected one of 'semblance', 'registration', 'both'"):
        check_evidence(kind)
    with pytest.raises(ParameterError, match="evidence is"):
        trace_faults(unbroken, evidence=kind)


def noisy(cube, level=0.8):
    noise = np.random.default_rng(6).normal(size=cube.shape) * level * cube.std()
    return (cube + noise).astype(np.float32)


@pytest.mark.parametrize(
    ("noise", "expected"),
    [(0.0, 0.75), (0.0285, 0.375), (0.055, 0.0), (0.057, 0.0), (0.086, 0.5), (0.113, 1.0), (0.115, 1.0), (0.6, 1.0)],
)
def test_share_of_registration_follows_the_noise(noise, expected):
    settings = RegistrationSettings()
    first, second = shares_at_noise(noise, settings.share, settings.share_noises)
    assert second == pytest.approx(expected)
    assert first == 1.0 - second


def test_both_ways_count_in_a_cube_without_noise_and_registration_alone_in_noise(broken):
    calm = {kind: measure(broken.seismic, kind).along_inlines for kind in EVIDENCE}
    assert not np.array_equal(calm["both"], calm["semblance"])
    assert not np.array_equal(calm["both"], calm["registration"])
    loud = {kind: measure(noisy(broken.seismic, 1.6), kind).along_inlines for kind in EVIDENCE}
    np.testing.assert_array_equal(loud["both"], loud["registration"])


def test_registration_is_left_out_where_its_share_is_nothing(broken):
    """What has no share, as in the mild noise of a good survey, is not measured."""
    mild = noisy(broken.seismic, 0.3)
    none = RegistrationSettings(share=(0.0, 0.0, 1.0), share_noises=(0.0, 0.2, 0.4))
    assert 0.01 < measure(mild, "semblance").noise < 0.1
    both = measure(mild, "both", registration=none)
    np.testing.assert_array_equal(both.along_inlines, measure(mild, "semblance").along_inlines)


def test_shares_are_means_of_the_logarithms(broken):
    volume = (broken.seismic / broken.seismic.std()).astype(np.float32)
    valid = np.ones(volume.shape, bool)
    flat = (np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.float32))
    ways = [compare_along(volume, valid, estimate_slopes(volume, valid)), compare_along(volume, valid, flat)]
    settings = MisfitSettings(footprint=0.0, levelling=0.0)
    first, second = (fuse_misfits(volume, valid, [way], settings=settings) for way in ways)
    mixed = fuse_misfits(volume, valid, ways, share=(0.25, 0.25, 0.25), settings=settings)
    # at the edges one way may know what the other does not
    inner = np.s_[10:-10, 10:-10, 10:-10]
    expected = 0.75 * first.along_inlines[inner] + 0.25 * second.along_inlines[inner]
    np.testing.assert_allclose(mixed.along_inlines[inner], expected, atol=1e-4)
    assert mixed.noise == min(first.noise, second.noise)


def test_a_share_may_be_measured_over_one_trace_more(broken):
    volume = (broken.seismic / broken.seismic.std()).astype(np.float32)
    valid = np.ones(volume.shape, bool)
    way = compare_along(volume, valid, estimate_slopes(volume, valid))
    near, far = (MisfitSettings(footprint=0.0, levelling=0.0, reach=(n, n)) for n in (2, 3))
    first, second = (fuse_misfits(volume, valid, [way], settings=settings) for settings in (near, far))
    mixed = fuse_misfits(volume, valid, [way], farther=0.25, settings=near)
    inner = np.s_[10:-10, 10:-10, 10:-10]
    expected = 0.75 * first.along_inlines[inner] + 0.25 * second.along_inlines[inner]
    np.testing.assert_allclose(mixed.along_inlines[inner], expected, atol=1e-4)
    np.testing.assert_array_equal(
        fuse_misfits(volume, valid, [way], farther=1.0, settings=near).along_inlines, second.along_inlines
    )
