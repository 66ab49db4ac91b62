from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image

from seismo3d.errors import ParameterError
from seismo3d.geometry.axis import Axis
from seismo3d.seismic.tracks import Track
from seismo3d.viewer.colours import ATTRIBUTES, make_scale, vertex_values
from seismo3d.viewer.interpretation import Fault, Horizon
from seismo3d.viewer.panels import cut_fault, encode_slice, fault_paths, horizon_path, nearest_fault, segments_path
from seismo3d.viewer.slices import Slice


def decode(uri):
    assert uri.startswith("data:image/png;base64,")
    return np.array(Image.open(io.BytesIO(base64.b64decode(uri.split(",")[1]))).convert("RGB"))


def test_amplitudes_become_shades():
    values = np.array([[-2.0, 0.0, 2.0], [np.nan, 9.0, -9.0]], np.float32)
    picture = decode(encode_slice(Slice(values, (1, 1), (2, 3)), limits=(-2.0, 2.0)))
    np.testing.assert_array_equal(picture[0, :, 0], [0, 128, 255])
    assert tuple(picture[1, 0]) == (233, 237, 242)
    np.testing.assert_array_equal(picture[1, 1:, 0], [255, 0])


@pytest.mark.parametrize(("axis", "index"), [(0, 12), (1, 20), (2, 30)])
def test_cuts_lie_on_the_fault(faults, axis, index):
    # the first fault is the plane crossline = 20 + (sample - 24.5) / 2
    cut = cut_fault(Fault(1, faults.surfaces[0]), axis, index)
    column, row = cut.segments[..., 0], cut.segments[..., 1]
    crossline = np.full(column.shape, 20.0) if axis == 1 else column
    sample = np.full(column.shape, 30.0) if axis == 2 else row
    np.testing.assert_allclose(crossline, 20.0 + 0.5 * (sample - 24.5), atol=1e-4)


def test_a_fault_that_the_slice_misses_gives_no_cut(faults):
    assert cut_fault(Fault(1, faults.surfaces[0]), 2, 49) is None


def test_interpolated_means_are_those_of_the_cut(faults):
    surface = faults.surfaces[0]
    cut = cut_fault(Fault(1, surface), 0, 12)
    np.testing.assert_allclose(
        cut.means(surface.vertices[:, 2].astype(float)), cut.segments[..., 1].mean(axis=1), atol=1e-5
    )


def test_paths_are_coloured_by_value(faults):
    cuts = [cut_fault(Fault(n, s), 0, 12) for n, s in enumerate(faults.surfaces, start=1)]
    cuts = [cut for cut in cuts if cut is not None]
    surfaces = dict(enumerate(faults.surfaces, start=1))
    n = sum(len(cut.segments) for cut in cuts)
    for attribute in ATTRIBUTES:
        paths = fault_paths(cuts, surfaces, make_scale(faults.surfaces, attribute))
        assert sum(path["d"].count("M") for path in paths) == n
        assert len({path["stroke"] for path in paths}) == len(paths)
    by_fault = fault_paths(cuts, surfaces, make_scale(faults.surfaces, "fault"))
    assert [path["stroke"] for path in by_fault] == ["#e6194b", "#0072b2"]
    assert len(fault_paths(cuts, surfaces, make_scale(faults.surfaces, "throw"))) > 3


def test_unknown_throws_are_white(faults):
    scale = make_scale(faults.surfaces, "throw")
    assert scale.shade(int(scale.classify(np.array([np.nan]))[0])) == "#ffffff"
    np.testing.assert_array_equal(scale.classify(np.array([scale.low - 1, scale.high + 1])), [0, 23])


def test_values_are_those_of_the_surface(faults):
    surface = faults.surfaces[0]
    np.testing.assert_allclose(vertex_values(surface, "throw"), surface.throw * 4.0)
    np.testing.assert_array_equal(vertex_values(surface, "confidence"), np.full(len(surface.vertices), 0.8))
    with pytest.raises(ParameterError, match="expected one of throw, likelihood"):
        vertex_values(surface, "colour")


def test_segments_are_drawn_at_the_middle_of_voxels():
    assert segments_path(np.array([[[0.0, 1.0], [2.0, 3.0]]])) == "M0.5 1.5L2.5 3.5"


def test_horizons_break_where_they_are_not_known():
    depth = np.full((2, 4), np.nan, np.float32)
    depth[1, [0, 1, 3]] = [100.0, 104.0, 112.0]
    horizon = Horizon(1, Track(depth, depth, np.zeros((1, 3)), "ms"))
    axis = Axis(100.0, 4.0, 9)
    assert horizon_path(horizon, axis, 0, 1) == "M0.5 0.50L1.5 1.50M3.5 3.50"
    assert horizon_path(horizon, axis, 0, 0) == ""
    assert horizon_path(horizon, axis, 1, 3) == "M1.5 3.50"
    assert horizon_path(horizon, axis, 2, 0) == ""


def test_a_horizon_is_not_drawn_across_a_fault() -> None:
    depth = np.full((2, 5), 10.0, np.float32)
    depth[:, 3:] = 24.0
    horizon = Horizon(1, Track(depth, np.ones_like(depth), np.zeros((1, 3))))
    path = horizon_path(horizon, Axis(0.0, 1.0, 40), 0, 1)
    assert path == "M0.5 10.50L1.5 10.50L2.5 10.50M3.5 24.50L4.5 24.50"


def test_the_nearest_fault_is_hit_within_reach(faults):
    cuts = [cut_fault(Fault(n, s), 2, 25) for n, s in enumerate(faults.surfaces, start=1)]
    scale = np.array([10.0, 10.0])
    assert nearest_fault(cuts, np.array([20.6, 5.0]), scale=scale, within=9.0) == 1
    assert nearest_fault(cuts, np.array([8.0, 15.4]), scale=scale, within=9.0) == 2
    assert nearest_fault(cuts, np.array([30.0, 5.0]), scale=scale, within=9.0) is None
    assert nearest_fault([], np.array([1.0, 1.0]), scale=scale, within=9.0) is None
