"""Pairs of identical samples: found where both scans hold them, never where a source has shrunk onto one of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from seismo3d.registration.constraints import Constraints
from seismo3d.registration.polish import polish
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.solvers import Limits, Prior


def polished(target, source, A, t):
    frame = Frame.of(target, source)
    limits = Limits(*Constraints().limits("affine", 3, frame.size))
    return polish(target, source, frame, SimpleNamespace(A=A, t=t), "affine", Prior(np.eye(3), np.zeros(3)), limits)


def test_the_same_samples_are_found(rng):
    points = rng.normal(size=(500, 3))
    A, t = polished(points, points[::2], np.eye(3) + 1e-3, np.full(3, 1e-3))
    frame = Frame.of(points, points[::2])
    np.testing.assert_allclose(frame.leave(A, t), np.eye(4), atol=1e-9)


def test_a_source_shrunk_onto_one_sample_is_not_the_same(rng):
    target, source = rng.normal(size=(500, 3)), rng.normal(size=(400, 3))
    sample = Frame.of(target, source).target(target[:1])[0]
    assert polished(target, source, 1e-12 * np.eye(3), sample) is None
