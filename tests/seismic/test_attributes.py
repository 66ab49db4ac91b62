from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from seismo3d.errors import ParameterError, ShapeError
from seismo3d.seismic import _kernels_attributes as kernels
from seismo3d.seismic.attributes import compute_attributes

INSIDE = (slice(6, -6), slice(6, -6), slice(10, -10))


def plane_wave(p: float, q: float, shape: tuple[int, int, int] = (30, 32, 60)) -> np.ndarray:
    i, j, k = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    return np.sin(2 * np.pi * (k - p * i - q * j) / 12.0).astype(np.float32)


@pytest.mark.parametrize(("p", "q"), [(0.3, 0.0), (0.0, -0.5), (0.4, 0.3), (-0.6, 0.2)])
def test_plane_wave_has_its_dip_and_azimuth(p: float, q: float) -> None:
    found = compute_attributes(plane_wave(p, q))
    # the tensor of a single plane wave is exact up to the truncated filters
    np.testing.assert_allclose(found["dip"][INSIDE], np.degrees(np.arctan(np.hypot(p, q))), atol=0.3)
    difference = (found["azimuth"][INSIDE] - np.degrees(np.arctan2(q, p)) + 180) % 360 - 180
    assert np.abs(difference).max() < 0.5
    assert found["semblance"][INSIDE].min() > 0.99
    for name in ("curvature_most_positive", "curvature_most_negative"):
        assert np.abs(found[name][INSIDE]).max() < 2e-3


def test_dome_is_positive_and_basin_negative() -> None:
    i, j, k = np.meshgrid(np.arange(41), np.arange(41), np.arange(60), indexing="ij")
    radius = 150.0
    bend = ((i - 20) ** 2 + (j - 20) ** 2) / (2 * radius)
    centre = (slice(14, 27), slice(14, 27), slice(20, 40))
    dome = compute_attributes(np.sin(2 * np.pi * (k - bend) / 12.0).astype(np.float32))
    np.testing.assert_allclose(dome["curvature_most_positive"][centre].mean(), 1 / radius, rtol=0.1)
    np.testing.assert_allclose(dome["curvature_most_negative"][centre].mean(), 1 / radius, rtol=0.15)
    basin = compute_attributes(np.sin(2 * np.pi * (k + bend) / 12.0).astype(np.float32))
    np.testing.assert_allclose(basin["curvature_most_negative"][centre].mean(), -1 / radius, rtol=0.1)


def test_fold_curves_across_its_axis_only() -> None:
    j, k = np.arange(60), np.arange(60)
    bend = 3.0 * np.cos(2 * np.pi * (j - 30) / 60)
    layers = np.sin(2 * np.pi * (k[None, :] + bend[:, None]) / 12.0)
    cube = np.repeat(layers[None], 24, axis=0).astype(np.float32)
    found = compute_attributes(cube)
    crest = 3.0 * (2 * np.pi / 60) ** 2  # an anticline at trace 30: z decreases by 3 cos
    at = (slice(8, 16), 30, slice(20, 40))
    np.testing.assert_allclose(found["curvature_most_positive"][at].mean(), crest, rtol=0.15)
    assert np.abs(found["curvature_most_negative"][at]).max() < 0.1 * crest


def test_depth_cube_on_a_map_has_true_dips_and_north() -> None:
    p, q = 0.4, 0.0
    values = plane_wave(p, q)
    n_i, n_j, n_k = values.shape
    x, y = np.meshgrid(25.0 * np.arange(n_i), 12.5 * np.arange(n_j), indexing="ij")  # inlines grow eastwards
    cube = xr.DataArray(
        values,
        dims=("inline", "crossline", "depth"),
        coords={
            "inline": np.arange(n_i),
            "crossline": np.arange(n_j),
            "depth": 10.0 * np.arange(n_k),
            "cdp_x": (("inline", "crossline"), x),
            "cdp_y": (("inline", "crossline"), y),
        },
        attrs={"sample_unit": "m"},
    )
    found = compute_attributes(cube)
    np.testing.assert_allclose(found["dip"].values[INSIDE], np.degrees(np.arctan(p * 10 / 25)), atol=0.3)
    np.testing.assert_allclose(found["azimuth"].values[INSIDE], 90.0, atol=0.5)
    assert found["dip"].dims == cube.dims
    assert found["dip"].attrs["units"] == "degrees"


def test_semblance_falls_at_a_fault() -> None:
    cube = plane_wave(0.1, 0.0)
    cube[:, 16:] = np.roll(cube[:, 16:], 5, axis=2)
    semblance = compute_attributes(cube)["semblance"]
    # at half a period of difference a third of the traces cancels another: at most 0.4 of full likeness
    assert semblance[10:20, 15:17, 20:40].mean() < 0.6
    assert semblance[10:20, 4:10, 20:40].mean() > 0.97


def test_what_all_amplitudes_share_does_not_count(rng: np.random.Generator) -> None:
    waves = plane_wave(0.1, 0.0) + rng.normal(0.0, 0.3, (30, 32, 60))
    signed = np.rint(40.0 * waves).clip(-127, 127)
    found, wanted = (compute_attributes(c)["semblance"] for c in ((signed + 128.0).astype(np.uint8), signed))
    np.testing.assert_allclose(found, wanted, atol=0.02)
    assert np.median(wanted) < 0.95


@pytest.mark.parametrize("size", [1e5, 1e20, 1e30])
def test_a_spike_counts_only_where_it_is(size: float) -> None:
    cube = plane_wave(0.3, 0.2)
    whole = compute_attributes(cube)
    cube[12, 12, 30] = size
    found = compute_attributes(cube)
    i, j, k = np.meshgrid(*(np.arange(n) for n in cube.shape), indexing="ij")
    # what smooths it has sigmas of 2 traces and 4 samples, twice: nothing is left three of them off
    far = (np.abs(i - 12) > 9) | (np.abs(j - 12) > 9) | (np.abs(k - 30) > 20)
    for name, values in found.items():
        np.testing.assert_allclose(values[far], whole[name][far], atol=0.05, err_msg=name)
    assert np.isfinite(found["azimuth"]).all()


def test_dip_where_nearly_all_amplitudes_are_nothing() -> None:
    cube = plane_wave(0.3, 0.0)
    cube[:, :, 4:] = 0.0
    whole = compute_attributes(cube)["dip"]
    cube[12, 12, 50] = 1e30
    np.testing.assert_allclose(compute_attributes(cube)["dip"][:, :, :4], whole[:, :, :4], atol=0.05)
    assert np.median(whole[:, :, :4]) > 10.0


def test_dead_and_missing_traces_stay_apart() -> None:
    cube = plane_wave(0.3, 0.2)
    whole = compute_attributes(cube)
    holed = cube.copy()
    holed[10:12, 10:12] = np.nan
    holed[20, 20] = 0.0
    found = compute_attributes(holed)
    for values in found.values():
        assert np.isnan(values[10:12, 10:12]).all()
        assert np.isnan(values[20, 20]).all()
    np.testing.assert_allclose(found["dip"][12:14, 12:14, 10:-10], whole["dip"][12:14, 12:14, 10:-10], atol=1.5)


def test_muted_top_is_blank_and_takes_nothing_else_along() -> None:
    cube = plane_wave(0.3, 0.2)
    whole = compute_attributes(cube)
    i, j, k = np.meshgrid(*(np.arange(n) for n in cube.shape), indexing="ij")
    muted = k < 8 + i // 6 + j // 4
    holed = np.where(muted, np.float32("nan"), cube)
    holed[12, 12, 40] = np.inf
    found = compute_attributes(holed)
    blank = muted.copy()
    blank[12, 12, 40] = True
    for values in found.values():
        np.testing.assert_array_equal(np.isnan(values), blank)
    # at the mute the layers are as alike as elsewhere; dips there come from one side of it
    assert found["semblance"][6:-6, 6:-6, :-10][~blank[6:-6, 6:-6, :-10]].min() > 0.99
    off = np.where(blank, 0.0, found["dip"] - whole["dip"])
    assert np.abs(off[6:-6, 6:-6, :-10]).max() < 0.5
    axes = {"inline": np.arange(30), "crossline": np.arange(32), "time": np.arange(60)}
    lazy = compute_attributes(xr.DataArray(holed, dims=tuple(axes), coords=axes).chunk({"inline": 7, "time": 20}))
    for name, values in found.items():
        np.testing.assert_array_equal(lazy[name].values, values)


def test_nothing_live_is_all_nan() -> None:
    found = compute_attributes(np.zeros((6, 7, 20), np.float32))
    assert all(np.isnan(values).all() for values in found.values())


def test_section_has_signed_dip_and_one_curvature() -> None:
    i, k = np.meshgrid(np.arange(50), np.arange(60), indexing="ij")
    found = compute_attributes(np.sin(2 * np.pi * (k + 0.4 * i) / 12.0).astype(np.float32))
    assert set(found) == {"dip", "semblance", "curvature"}
    np.testing.assert_allclose(found["dip"][6:-6, 10:-10], -np.degrees(np.arctan(0.4)), atol=0.3)


def test_total_variation_evens_out_noise(rng: np.random.Generator) -> None:
    noisy = plane_wave(0.3, 0.0) + 0.8 * rng.standard_normal((30, 32, 60)).astype(np.float32)
    plain, smooth = compute_attributes(noisy), compute_attributes(noisy, smooth_tv=0.1)
    assert smooth["dip"][INSIDE].std() < 0.7 * plain["dip"][INSIDE].std()
    truth = np.degrees(np.arctan(0.3))
    assert abs(smooth["dip"][INSIDE].mean() - truth) < 2.0


def test_progress_runs_to_the_end() -> None:
    seen: list[tuple[str, float]] = []
    compute_attributes(plane_wave(0.1, 0.1, (8, 9, 30)), progress=lambda stage, share: seen.append((stage, share)))
    assert list(dict.fromkeys(stage for stage, _ in seen)) == ["dips", "semblance", "curvature"]
    assert seen[-1] == ("curvature", 1.0)


def test_refusals() -> None:
    with pytest.raises(ShapeError, match="expected"):
        compute_attributes(np.zeros(5))
    with pytest.raises(ParameterError, match="smooth_tv"):
        compute_attributes(np.ones((5, 5, 5)), smooth_tv=0.0)


def test_stack_kernel_equals_plain_numpy(rng: np.random.Generator) -> None:
    cube = rng.standard_normal((3, 4, 9))
    live = np.ones((3, 4), bool)
    live[0, 1] = False
    p, q = 0.4 * rng.standard_normal((2, 3, 4, 9))
    stack, energy = np.empty((4, 9)), np.empty((4, 9))
    kernels.stack_along_dip(cube, live, p, q, 1, stack, energy)
    j, k = 1, 4
    taken = [
        np.interp(k + di * p[1, j, k] + dj * q[1, j, k], np.arange(9), cube[1 + di, j + dj])
        for di in (-1, 0, 1)
        for dj in (-1, 0, 1)
        if live[1 + di, j + dj]
    ]
    assert stack[j, k] == pytest.approx(sum(taken) ** 2 / len(taken))
    assert energy[j, k] == pytest.approx(np.square(taken).sum())
    cube[0, 1], live[0, 1] = np.nan, True
    kernels.stack_along_dip(cube, live, p, q, 1, stack, energy)
    assert energy[j, k] == pytest.approx(np.square(taken).sum())
