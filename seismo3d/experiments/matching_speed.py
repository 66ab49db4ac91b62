"""Time of the matcher against SIFT's, and of the sliding window against its radius, in the same run."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Sequence

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.experiments.matching_scenes import add_noise, load_photos, rotation, warp_image

RADII = (3.0, 6.0, 12.0, 24.0, 48.0)


def standard_pair() -> tuple[AnyArray, AnyArray]:
    """Return a photograph at 640 x 480 and the same turned by 30 degrees, both with noise."""
    import cv2

    image = cv2.resize(load_photos()["coffee"], (640, 480), interpolation=cv2.INTER_CUBIC)
    rng = np.random.default_rng(0)
    turned = warp_image(image, rotation(30.0)(image.shape))
    return add_noise(image, 2.0, rng), add_noise(turned, 2.0, rng)


def median_seconds(jobs: Sequence[Callable[[], object]], *, n_repeats: int = 9, cpu: bool = True) -> list[float]:
    """Median time of jobs that take turns, so that a busy machine is unfair to none; the first round does not count."""
    clock = time.process_time if cpu else time.perf_counter
    seconds: list[list[float]] = [[] for _ in jobs]
    for k in range(n_repeats + 1):
        for job, own in zip(jobs, seconds):
            start = clock()
            job()
            if k:
                own.append(clock() - start)
    return [float(np.median(own)) for own in seconds]


def time_against_sift(*, n_points: int = 500, n_repeats: int = 9, cpu: bool = True) -> tuple[float, float]:
    """Seconds of this package and of OpenCV's SIFT to detect, describe and match a 640 x 480 pair."""
    import cv2

    from seismo3d.features.matching import match

    target, source = standard_pair()

    def sift() -> None:
        feature = cv2.SIFT_create(n_points)  # type: ignore[attr-defined]
        first, second = (feature.detectAndCompute(image, None)[1] for image in (target, source))
        cv2.BFMatcher(cv2.NORM_L2).knnMatch(first, second, 2)

    ours, theirs = median_seconds(
        [lambda: match(target, source, n_points=n_points), sift], n_repeats=n_repeats, cpu=cpu
    )
    return ours, theirs


def time_against_radius(*, shape: tuple[int, int] = (480, 640), n_bins: int = 16) -> dict[float, float]:
    """Seconds to slide windows of several radii over all planes of a histogram, by radius."""
    from seismo3d.features.windows import slide_window

    planes = np.random.default_rng(0).integers(0, 1000, (n_bins, *shape)).astype(np.int32)
    jobs = [lambda r=radius: slide_window(planes, r) for radius in RADII]
    return dict(zip(RADII, median_seconds(jobs, n_repeats=5)))


def peak_memory_mb() -> float:
    """Largest resident size of this process so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
