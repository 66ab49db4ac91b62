"""Whole registrations from raw arrays against small_gicp and open3d, on the same points in the same run."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.experiments.registration_table import plane_icp, planes_alone
from seismo3d.experiments.rotated_frames import draw_room, rotate_frame
from seismo3d.registration.register import register


@pytest.fixture(scope="module")
def frames():
    return rotate_frame(draw_room(size=(300, 400)), 5.0, np.random.default_rng(0))


@pytest.mark.parametrize("method", ["seismo3d", "PLANE_ICP", "VGICP"])
def test_local_stage(benchmark, frames, method):
    small_gicp = pytest.importorskip("small_gicp")
    target, source = frames.target.points, frames.source.points
    if method == "seismo3d":
        benchmark(lambda: register(target, source, stages=("local",), voxel_size=0.03, n_threads=2))
    else:
        benchmark(
            lambda: small_gicp.align(
                target,
                source,
                registration_type=method,
                downsampling_resolution=0.03,
                voxel_resolution=0.12,
                max_correspondence_distance=0.3,
                num_threads=2,
            )
        )


@pytest.mark.parametrize("method", [planes_alone, plane_icp])
def test_rotated_frame(benchmark, frames, method):
    benchmark(lambda: method(frames))
