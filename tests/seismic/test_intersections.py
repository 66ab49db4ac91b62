from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_faults import plane_surface

from seismo3d.seismic.faultset import FaultSurface
from seismo3d.seismic.index_frame import IndexFrame
from seismo3d.seismic.intersections import find_intersections

SIZE = 80
BINS = IndexFrame(np.eye(3), "bin")


def lay_surface(across: np.ndarray, *, axis: int) -> FaultSurface:
    """A surface whose place along an axis is told for every trace along the other, and every sample."""
    a, k = np.meshgrid(np.arange(SIZE), np.arange(SIZE), indexing="ij")
    vertices = np.stack([across, a, k] if axis == 0 else [a, across, k], axis=-1)
    along, down = np.gradient(across)
    up = -np.sign(down.mean())
    one = np.ones_like(across)
    normals = np.stack([one, -along, -down] if axis == 0 else [-along, one, -down], axis=-1)
    normals *= -up / np.linalg.norm(normals, axis=2, keepdims=True)
    n = np.arange(SIZE**2).reshape(SIZE, SIZE)
    p, q, r, s = (m.ravel() for m in (n[:-1, :-1], n[1:, :-1], n[:-1, 1:], n[1:, 1:]))
    cells = np.concatenate([np.stack([p, q, r], 1), np.stack([q, s, r], 1)]).astype(np.int32)
    plane = plane_surface(axis=axis, centre=40.0, dip_deg=60.0, throw=4.0)
    names = ("likelihood", "throw", "separation", "throw_fit", "strike_deg", "dip_deg")
    arrays = dict.fromkeys(names, np.ones(SIZE**2, np.float32))
    flat = {"vertices": vertices, "normals": normals}
    return replace(
        plane, cells=cells, **arrays, **{name: v.reshape(-1, 3).astype(np.float32) for name, v in flat.items()}
    )


def crossed_by_a_younger_fault(throw: float = 8.0) -> tuple[FaultSurface, FaultSurface]:
    """Two planes at a right angle of strike, the older one offset by the younger and bridging that along it."""
    j, k = np.meshgrid(np.arange(float(SIZE)), np.arange(float(SIZE)), indexing="ij")
    younger = 40.0 + (k - 40.0) * 0.4
    beyond = np.clip((j - (40.0 + (k - 40.0) * 0.4)) / 3.0, -1.0, 1.0)
    return lay_surface(40.0 + (k - 40.0) * 0.5 + 0.5 * throw * beyond, axis=0), lay_surface(younger, axis=1)


def conjugate_pair(*, bridge: float, rough: float, seed: int = 0) -> tuple[FaultSurface, FaultSurface]:
    """Two planes of one strike that dip towards each other; the older follows the younger over so many samples."""
    k = np.arange(float(SIZE))
    younger = 40.0 - 0.5 * (k - 40.0)
    older = np.where(np.abs(k - 40.0) < bridge / 2, younger, 40.0 + 0.5 * (k - 40.0) - np.sign(k - 40.0) * bridge / 2)
    wavering = np.random.default_rng(seed).uniform(-rough, rough, (SIZE, SIZE)) * (np.abs(k - 40.0) < bridge / 2)
    return lay_surface(older + wavering, axis=1), lay_surface(np.tile(younger, (SIZE, 1)), axis=1)


def angle_between(a: list[float], b: list[float]) -> float:
    cosine = np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b)
    return float(np.degrees(np.arccos(abs(cosine))))


def test_angle_is_that_of_the_planes_not_of_the_bridge_between_them():
    older, younger = crossed_by_a_younger_fault()
    expected = angle_between([1.0, 0.0, -0.5], [0.0, 1.0, -0.4])
    for pair in ((older, younger), (younger, older)):
        (line,) = find_intersections(pair, frame=BINS)
        assert line.kind == "cross"
        assert line.angle_deg == pytest.approx(expected, abs=0.5)
    # on a map with bins four times as long one way
    frame = IndexFrame(np.diag([4.0, 1.0, 1.0]), "m")
    (line,) = find_intersections((older, younger), frame=frame)
    assert line.angle_deg == pytest.approx(angle_between([0.25, 0.0, -0.5], [0.0, 1.0, -0.4]), abs=0.5)


def test_angle_of_a_surface_that_reaches_less_far_than_a_bridge():
    older, younger = crossed_by_a_younger_fault(throw=0.0)
    near = np.abs(younger.vertices - 40.0).max(axis=1) < 8.0
    small = replace(younger, cells=younger.cells[near[younger.cells].all(axis=1)])
    used = np.unique(small.cells)
    numbers = np.searchsorted(used, small.cells).astype(np.int32)
    names = ("vertices", "normals", "likelihood", "throw", "separation", "throw_fit", "strike_deg", "dip_deg")
    small = replace(small, cells=numbers, **{name: getattr(younger, name)[used] for name in names})
    (line,) = find_intersections((older, small), frame=BINS)
    assert line.angle_deg == pytest.approx(angle_between([1.0, 0.0, -0.5], [0.0, 1.0, -0.4]), abs=0.5)


@pytest.mark.parametrize(("bridge", "rough"), [(0.0, 0.0), (10.0, 0.4), (24.0, 0.4)])
def test_a_line_that_wavers_along_a_bridge_is_as_long_as_it_is(bridge, rough):
    pair = conjugate_pair(bridge=bridge, rough=rough)
    (line,) = find_intersections(pair, frame=BINS)
    # along strike from one side to the other, and at most across the bridge from corner to corner
    assert SIZE - 2.0 <= line.length <= np.hypot(SIZE - 1.0, 1.2 * bridge) + 1.0
    assert line.angle_deg == pytest.approx(angle_between([0.0, 1.0, -0.5], [0.0, 1.0, 0.5]), abs=0.5)
    (long,) = find_intersections(pair, frame=IndexFrame(np.diag([10.0, 1.0, 1.0]), "m"))
    assert long.length == pytest.approx(10.0 * (SIZE - 1.0), rel=0.02)


def test_parts_of_a_line_are_added_up():
    older, younger = crossed_by_a_younger_fault(throw=0.0)
    (whole,) = find_intersections((older, younger), frame=BINS)
    gap = np.abs(older.vertices[:, 2] - 40.0) < 10.0
    parts = [replace(s, cells=s.cells[~gap[s.cells].any(axis=1)]) for s in (older, younger)]
    (line,) = find_intersections((parts[0], parts[1]), frame=BINS)
    assert line.length == pytest.approx(whole.length * (1.0 - 20.0 / 79.0), rel=0.03)
