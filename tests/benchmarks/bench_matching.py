"""Time of the matcher: a whole pair against SIFT's in the same run, windows of several radii, and volumes.

Run: ``python -m pytest -o addopts= --import-mode=importlib tests/benchmarks/bench_matching.py``.
"""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy import ndimage

from seismo3d.experiments.matching_speed import RADII, standard_pair
from seismo3d.features import _kernels
from seismo3d.features.inputs import Grey
from seismo3d.features.matching import match
from seismo3d.features.solid import SolidSettings, describe_solid
from seismo3d.features.windows import slide_window, window_half_widths
from seismo3d.synthetic import fault_cube

pytest.importorskip("pytest_benchmark")


@pytest.fixture(scope="module")
def pair():
    return standard_pair()


@pytest.mark.benchmark(group="640 x 480 pair, 500 points")
def test_match(benchmark, pair):
    assert len(benchmark(match, *pair, n_points=500)) > 300


@pytest.mark.benchmark(group="640 x 480 pair, 500 points")
def test_sift(benchmark, pair):
    def sift():
        feature = cv2.SIFT_create(500)
        first, second = (feature.detectAndCompute(image, None)[1] for image in pair)
        return cv2.BFMatcher(cv2.NORM_L2).knnMatch(first, second, 2)

    assert len(benchmark(sift)) >= 500


@pytest.mark.benchmark(group="16 planes of 640 x 480, sliding")
@pytest.mark.parametrize("radius", RADII)
def test_slide(benchmark, radius):
    planes = np.random.default_rng(0).integers(0, 1000, (16, 480, 640)).astype(np.int32)
    assert benchmark(slide_window, planes, radius).shape == planes.shape


@pytest.mark.benchmark(group="1 plane of 640 x 480, summed afresh")
@pytest.mark.parametrize("radius", [3.0, 12.0])
def test_sum_afresh(benchmark, radius):
    planes = np.random.default_rng(0).integers(0, 1000, (1, 480, 640)).astype(np.int32)
    assert benchmark(_kernels.window_sums, planes, window_half_widths(radius)).shape == planes.shape


@pytest.fixture(scope="module")
def cube():
    return np.asarray(fault_cube("crossing", seed=3, shape=(128, 128, 128)).seismic)


@pytest.mark.benchmark(group="128^3 cube")
def test_describe_volume(benchmark, cube):
    def describe():
        return describe_solid(Grey(cube), SolidSettings()).corners

    assert len(benchmark(describe)) == 300


@pytest.mark.benchmark(group="128^3 cube")
def test_gaussian_filter(benchmark, cube):
    assert benchmark(ndimage.gaussian_filter, cube, 4).shape == cube.shape
