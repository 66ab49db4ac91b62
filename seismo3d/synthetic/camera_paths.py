"""Ways of a camera through a synthetic scene: smooth, closed, and known at every instant."""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import exp_rotation, make_transform
from seismo3d.synthetic.rooms import ORBIT_RADIUS, Scene

_WAVES = 3


def room_poses(phase: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Return poses around a room's middle, facing its walls, at phases in turns; (n, 4, 4), camera to world.

    Position and angles are sums of few harmonics of the phase, so that a whole turn comes back to its start.
    """
    angle = 2.0 * np.pi * phase
    radius = 0.95 + _wobble(phase, rng, 0.08)
    x, y = 1.15 * radius * np.cos(angle), radius * np.sin(angle)
    z = 1.35 + _wobble(phase, rng, 0.08)
    yaw = angle + _wobble(phase, rng, 0.16)
    pitch = -0.14 + _wobble(phase, rng, 0.09)
    roll = _wobble(phase, rng, 0.05)
    return _look(np.stack([x, y, z], axis=1), yaw, pitch, roll)


def terrain_poses(phase: Float64Array, rng: np.random.Generator, scene: Scene) -> Float64Array:
    """Return poses of a rover on a round way over a terrain, looking ahead and down; as :func:`room_poses`."""
    angle = 2.0 * np.pi * phase
    radius = ORBIT_RADIUS + _wobble(phase, rng, 0.2)
    xy = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    around = 0.7 * np.stack([np.cos(np.arange(12) * np.pi / 6), np.sin(np.arange(12) * np.pi / 6)], axis=1)
    height = np.mean([scene.relief_height(xy + step)[:, 0] for step in around], axis=0)
    z = height + 1.25 + _wobble(phase, rng, 0.04)
    yaw = angle + np.pi / 2 + 0.15 + _wobble(phase, rng, 0.16)
    pitch = -0.62 + _wobble(phase, rng, 0.06)
    roll = _wobble(phase, rng, 0.05)
    return _look(np.column_stack([xy, z]), yaw, pitch, roll)


def _wobble(phase: Float64Array, rng: np.random.Generator, size: float) -> Float64Array:
    out = np.zeros(len(phase))
    for wave in range(1, _WAVES + 1):
        out += size / wave * np.sin(2.0 * np.pi * (wave * phase + rng.uniform()))
    return out


def _look(position: Float64Array, yaw: Float64Array, pitch: Float64Array, roll: Float64Array) -> Float64Array:
    poses = np.empty((len(position), 4, 4))
    for n, (a, b, c) in enumerate(zip(yaw, pitch, roll, strict=True)):
        forward = np.array([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
        right = np.array([np.sin(a), -np.cos(a), 0.0])
        level = np.column_stack([right, np.cross(forward, right), forward])
        poses[n] = make_transform(level @ exp_rotation([0.0, 0.0, c]), position[n])
    return poses
