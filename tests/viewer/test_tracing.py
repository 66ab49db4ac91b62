from __future__ import annotations

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.errors import GeometryError, ParameterError
from seismo3d.viewer.tracing import Tracer, blank_faults, crop_surfaces, follow, place_box, resample


@pytest.mark.parametrize("at", [(0, 0, 0), (200, 300, 50), (399, 499, 99)])
def test_boxes_lie_in_the_cube_around_the_point_and_hold_the_work(at):
    box = place_box((400, 500, 100), [at], most=900_000)
    sizes = [part.stop - part.start for part in box]
    assert sizes == [95, 95, 100]
    for place, part, n in zip(at, box, (400, 500, 100), strict=True):
        assert 0 <= part.start <= place < part.stop <= n


def test_a_narrow_cube_gets_a_longer_box():
    sizes = [part.stop - part.start for part in place_box((20, 900, 100), [(3, 400, 9)], most=900_000)]
    assert sizes == [20, 450, 100]


def test_boxes_hold_the_whole_stick_with_a_margin():
    box = place_box((400, 500, 100), [(50, 100, 0), (50, 300, 99)], most=900_000, margin=24)
    assert box[1].start <= 76
    assert box[1].stop >= 324


def test_cropped_surfaces_lie_in_the_box(faults):
    box = (slice(8, 20), slice(10, 30), slice(0, 50))
    parts = crop_surfaces(faults.surfaces, box)
    assert len(parts) == 2
    for part in parts:
        moved = part.vertices + np.array([8, 10, 0])
        assert (moved >= [4, 6, -4]).all()
        assert (moved <= [23, 33, 53]).all()
    assert crop_surfaces(faults.surfaces, (slice(0, 5), slice(0, 6), slice(40, 44))) == []


def test_blank_faults_take_no_memory(faults):
    made = blank_faults(faults.surfaces, (100_000, 100_000, 1000))
    assert made.labels.shape == (100_000, 100_000, 1000)
    assert made.labels.base.nbytes == 4


def test_sticks_are_sampled_a_voxel_apart():
    points = resample([(5, 0, 0), (5, 3, 4), (5, 3, 10)])
    assert len(points) == 12
    np.testing.assert_allclose(points[-1], (5, 3, 10))
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= 1.0 + 1e-9
    with pytest.raises(ParameterError, match="on one spot"):
        resample([(5, 3, 4), (5, 3, 4)])


def test_the_surface_along_a_stick_is_found(faults):
    stick = resample([(12, 14, 12), (12, 26, 36)])  # crossline = 20 + (sample - 24.5) / 2
    assert follow(faults.surfaces, stick) == 0
    assert follow(faults.surfaces, resample([(27, 30, 2), (27, 38, 20)])) is None
    assert follow([], stick) is None


def test_a_horizon_is_followed_across_a_fault(cube, faults):
    # the layers dip by 0.15 samples an inline, and lie 4 samples deeper beyond the first fault
    bare = cube.copy(data=np.nan_to_num(cube.values))
    tracer = Tracer(bare)
    track, box = tracer.trace_horizon((6.0, 10.0, 27.0), surfaces=faults.surfaces[:1])
    assert box == (slice(0, 30), slice(0, 40), slice(0, 50))
    sample = (track.depth - 1000.0) / 4.0
    layer = 27.0 + 0.15 * (np.arange(30) - 6.0)
    near = np.abs(sample[:, 5:15] - layer[:, None])
    assert np.nanmedian(near) < 0.3
    assert np.isfinite(near).mean() > 0.6
    again, _ = tracer.trace_horizon((6.0, 10.0, 27.0), surfaces=faults.surfaces[:1])
    np.testing.assert_array_equal(track.depth, again.depth)


def test_a_box_deep_in_a_cube_gives_the_track_in_the_cubes_own_coordinates(cube):
    bare = cube.copy(data=np.nan_to_num(cube.values))
    wide = np.concatenate([np.zeros((30, 25, 50), np.float32), bare.values[:, :18]], axis=1)
    tracer = Tracer(wide)
    box = (slice(0, 30), slice(25, 43), slice(0, 50))
    track = tracer._widen(s3.trace_tracks(wide[box], [(6.0, 10.0, 27.0)])[0], box)
    assert np.isnan(track.depth[:, :25]).all()
    assert abs(track.depth[6, 35] - 27.0) < 0.3


def test_seeds_outside_are_refused(cube):
    with pytest.raises(ParameterError, match="lies outside the cube"):
        Tracer(cube).trace_horizon((6.0, 10.0, 270.0))


@pytest.fixture(scope="module")
def broken():
    """Forty-eight layers with one fault plane of four samples throw, in some noise."""
    i, j, k = np.meshgrid(np.arange(40), np.arange(56), np.arange(72), indexing="ij")
    plane = 28.0 + 0.4 * (k - 36.0)
    time = (k - np.where(j > plane, 5.0, 0.0)) * 1.0 + 0.05 * i
    rng = np.random.default_rng(3)
    layers = np.convolve(rng.normal(size=200), np.hanning(7), mode="same")
    values = np.interp(time, np.arange(200) - 50, layers)
    return (values + 0.05 * rng.normal(size=values.shape)).astype(np.float32)


def test_a_fault_is_traced_along_a_stick(broken):
    stick = [(20, 28.0 + 0.4 * (z - 36.0), z) for z in (14.0, 36.0, 58.0)]
    surface, _ = Tracer(broken).trace_fault(stick)
    off = surface.vertices[:, 1] - (28.0 + 0.4 * (surface.vertices[:, 2] - 36.0))
    assert np.median(np.abs(off)) < 1.0
    assert surface.area > 1000


def test_where_nothing_is_broken_no_fault_is_made_up(broken):
    with pytest.raises(GeometryError, match="no break of the layers"):
        Tracer(broken).trace_fault([(20, 8.0, 14.0), (20, 10.0, 58.0)])


def test_the_box_of_a_stick_is_moved_back_into_the_cube(broken, monkeypatch):
    padded = np.concatenate([np.zeros((40, 30, 72), np.float32), broken], axis=1)
    from seismo3d.viewer import tracing

    monkeypatch.setitem(tracing.REACHES, "near", 40 * 60 * 72)
    stick = [(20, 58.0 + 0.4 * (z - 36.0), z) for z in (14.0, 36.0, 58.0)]
    surface, box = Tracer(padded).trace_fault(stick)
    assert box[1].start > 0
    off = surface.vertices[:, 1] - (58.0 + 0.4 * (surface.vertices[:, 2] - 36.0))
    assert np.median(np.abs(off)) < 1.0
