from __future__ import annotations

import numpy as np
import pytest

from seismo3d.synthetic import SyntheticFault, _kernels, ricker
from seismo3d.synthetic.faulting import fault_rows
from seismo3d.synthetic.wavelets import ricker_table

FAULTS = fault_rows(
    [
        SyntheticFault((10, 12, 15), 40.0, 60.0, 5.0, "elliptic", (15, 20), bend=(0.01, 0.002), drag=30, share=0.4),
        SyntheticFault((10, 12, 15), 200.0, 70.0, -4.0, ripple=(1.0, 20.0, 0.2), rake_deg=70.0),
        SyntheticFault((10, 6, 8), 10.0, 60.0, 4.0, listric=(20.0, 10.0)),
    ]
)


@pytest.mark.parametrize("row", range(3))
def test_a_grain_on_the_surface_stays_on_the_surface(row):
    fault, rng = FAULTS[row], np.random.default_rng(1)
    found = 0
    for i, x in rng.uniform(4, 18, (60, 2)):
        depths = np.linspace(0, 30, 3001)
        sides = np.array([_kernels.undo_fault(i, x, s, fault)[3] for s in depths])
        crossing = np.flatnonzero(np.diff(np.sign(sides)))
        if crossing.size == 0:
            continue
        for k in (crossing[0], crossing[0] + 1):
            restored = _kernels.undo_fault(i, x, depths[k], fault)[:3]
            before = _kernels.undo_fault(*restored, fault)[3]
            # Displacement keeps its distance from the surface.
            assert before == pytest.approx(sides[k], abs=1e-9 if row < 2 else 1e-2)
        found += 1
    assert found > 10


@pytest.mark.parametrize("row", range(3))
def test_compiled_equals_interpreted(row):
    for point in np.random.default_rng(2).uniform(0, 25, (40, 3)):
        compiled = _kernels.undo_fault(*point, FAULTS[row])
        np.testing.assert_allclose(
            compiled, getattr(_kernels.undo_fault, "py_func", _kernels.undo_fault)(*point, FAULTS[row]), atol=1e-10
        )


@pytest.mark.parametrize("row", range(2))
def test_displacement_keeps_volume_where_throw_is_uniform_and_never_turns_layers_over(row):
    step = 1e-5
    for point in np.random.default_rng(3).uniform(2, 22, (200, 3)):
        here = np.array(_kernels.undo_fault(*point, FAULTS[row])[:3])
        jacobian = np.array([
            (np.array(_kernels.undo_fault(*(point + step * axis), FAULTS[row])[:3]) - here) / step for axis in np.eye(3)
        ]).T  # fmt: skip
        if np.abs(jacobian).max() > 50:
            continue  # the point lies on the fault
        volume = np.linalg.det(jacobian)
        assert volume > 0.2
        if row == 1:
            assert volume == pytest.approx(1.0, abs=1e-4)


def test_walsh_watterson_profile_known_values():
    fault = FAULTS[0]
    assert _kernels.slip_profile(0.0, 0.0, fault) == 1.0
    # Half way to the tip: 2 (1 - r) sqrt((1 + r)^2 / 4 - r^2) at r = 1/2.
    assert _kernels.slip_profile(7.5, 0.0, fault) == pytest.approx(np.sqrt(0.75**2 - 0.25))
    assert _kernels.slip_profile(0.0, 10.0, fault) == pytest.approx(np.sqrt(0.75**2 - 0.25))
    assert _kernels.slip_profile(15.0, 0.0, fault) == 0.0


def test_wavelet_is_laid_at_fractional_samples():
    out = np.zeros(80)
    _kernels.lay_wavelet(out, 31.37, 2.0, ricker_table(1 / 14.0, 32), 32)
    # Linear interpolation in a table of 32 entries a sample.
    np.testing.assert_allclose(out, 2.0 * ricker(np.arange(80) - 31.37, 1 / 14.0), atol=1e-3)


def test_fold_shift_is_the_sum_of_gaussians():
    bumps = np.array([[3.0, 4.0, 0.5 / 5.0**2, 2.0], [9.0, 1.0, 0.5 / 3.0**2, -1.0]])
    terms = np.array([0.5, 0.01, 0.3, 0.02, -0.03, 6.0, 7.0])
    gauss = 2.0 * np.exp(-(2.0**2 + 1.0) / 50.0) - np.exp(-(4.0**2 + 4.0**2) / 18.0)
    expected = (0.5 + 0.01 * 20.0) * gauss + 0.3 + 0.02 * (5.0 - 6.0) - 0.03 * (5.0 - 7.0)
    assert _kernels.fold_shift(5.0, 5.0, 20.0, bumps, terms) == pytest.approx(expected)


def test_breaks_are_marked_only_where_layer_time_jumps():
    tau = np.array([0.0, 1.0, 2.0, 7.0, 8.0, 9.0, 10.0])
    sides = np.array([1, 1, 1, 0, 0, 2, 2])
    breaks = np.zeros(7, np.uint8)
    _kernels.mark_breaks(tau, sides, np.full(7, -1.0), breaks)
    assert breaks.tolist() == [0, 0, 1, 0, 0, 0, 0]
