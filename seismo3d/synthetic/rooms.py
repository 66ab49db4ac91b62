"""Rooms and outdoor terrains whose every surface is known: boxes, balls and a smooth relief, painted at all scales.

The world's frame has z up, in metres; the floor of a room, and the mean of a terrain, is at z = 0, around the origin.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_points, freeze
from seismo3d.geometry.rotations import exp_rotation
from seismo3d.synthetic import _kernels_render as k

ROOM_SIZE = (6.4, 5.6, 2.7)
RELIEF_REACH = 14.0
_SPACING = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Surfaces to look at, at rest.

    Attributes
    ----------
    shapes : ndarray of shape (n, 20), float64
        One box or ball a row; see :mod:`seismo3d.synthetic._kernels_render`.
    relief : ndarray of shape (rows, columns), float64
        Coefficients of a cubic B-spline over y and x; without elements in a room.
    frame : tuple of float
        x and y of the first coefficient and their spacing, metres.
    ground : tuple of float
        Colour of the relief, 0 to 255, and the seed of its texture.
    light : tuple of float
        Unit vector towards the light.
    tiles : ndarray of shape (m, n, 2), float64
        Bounds on the relief's height and slope in squares of 0.8 m.
    """

    shapes: Float64Array
    relief: Float64Array
    frame: tuple[float, float, float]
    ground: tuple[float, float, float, float]
    light: tuple[float, float, float]
    tiles: Float64Array

    def distance_to_surface(self, points: ArrayLike) -> Float64Array:
        """Return how far points lie from the nearest surface.

        Parameters
        ----------
        points : array_like of shape (n, 3)
            In the world's frame, metres.

        Returns
        -------
        ndarray of shape (n,), float64
            Not negative. Exact for boxes and balls; of the relief exact to 1e-6 m within half a metre of it.
        """
        p = as_points(points, "points", dim=3)
        nearest = np.full(len(p), np.inf)
        for shape in self.shapes:
            np.minimum(nearest, np.abs(_signed_distance(p, shape)), out=nearest)
        if self.relief.size:
            np.minimum(nearest, self._distance_to_relief(p), out=nearest)
        return nearest

    def ground_height(self, xy: ArrayLike) -> Float64Array:
        """Return the height of the ground, or of what stands on it, at points (x, y).

        Parameters
        ----------
        xy : array_like of shape (n, 2)
            Metres.

        Returns
        -------
        ndarray of shape (n,), float64
            Metres; NaN outside a room.
        """
        p = as_points(xy, "xy", dim=2)
        top = self.relief_height(p)[:, 0] if self.relief.size else np.full(len(p), np.nan)
        for shape in self.shapes:
            height = _top_of(p, shape)
            top = np.fmax(top, height)
        return top

    def relief_height(self, xy: Float64Array) -> Float64Array:
        """Return (height, slope along x, slope along y) of the bare relief at points (n, 2); shape (n, 3)."""
        out = np.empty((len(xy), 3))
        k.relief_heights(np.ascontiguousarray(xy), self.relief, self.frame, out)
        return out

    def _distance_to_relief(self, p: Float64Array) -> Float64Array:
        foot = p[:, :2].copy()
        for _ in range(30):  # Gauss and Newton's steps to the nearest point of the surface
            h, hx, hy = self.relief_height(foot).T
            rx, ry, rz = foot[:, 0] - p[:, 0], foot[:, 1] - p[:, 1], h - p[:, 2]
            gx, gy = rx + hx * rz, ry + hy * rz
            a, b, c = 1.0 + hx * hx, hx * hy, 1.0 + hy * hy
            det = a * c - b * b
            foot -= np.stack([(c * gx - b * gy) / det, (a * gy - b * gx) / det], axis=1)
        h = self.relief_height(foot)[:, 0]
        return np.sqrt(((foot - p[:, :2]) ** 2).sum(axis=1) + (h - p[:, 2]) ** 2)


def box(
    centre: ArrayLike, half: ArrayLike, *, yaw: float = 0.0, colour: ArrayLike = (150, 150, 150), seed: int = 0
) -> Float64Array:
    """Return the row of a box: its centre, half sizes (metres), turn about z (radians), colour 0 to 255."""
    return shape_row(k.BOX, centre, half, exp_rotation([0.0, 0.0, yaw]), colour, seed)


def ball(centre: ArrayLike, radius: float, *, colour: ArrayLike = (150, 150, 150), seed: int = 0) -> Float64Array:
    """Return the row of a ball of so many metres."""
    return shape_row(k.SPHERE, centre, [radius] * 3, np.eye(3), colour, seed)


def shape_row(
    kind: int, centre: ArrayLike, half: ArrayLike, R: ArrayLike, colour: ArrayLike, seed: int
) -> Float64Array:
    """Return the numbers of one shape; ``R`` turns the shape's frame into the world's."""
    row = np.zeros(k.N_COLUMNS)
    row[k.KIND], row[k.SEED] = kind, seed
    row[k.CX : k.CX + 3], row[k.R0 : k.R0 + 9] = centre, np.asarray(R).ravel()
    row[k.HX : k.HX + 3], row[k.RED : k.RED + 3] = half, colour
    return row


def make_room(rng: np.random.Generator) -> Scene:
    """Furnish a room of 6.4 x 5.6 x 2.7 m: a table, cupboards, shelves and boxes along its walls, balls, a pillar.

    Parameters
    ----------
    rng : numpy.random.Generator
        What stands where, and every colour, is drawn from it.

    Returns
    -------
    Scene
    """
    x, y, z = (0.5 * size for size in ROOM_SIZE)
    tint = lambda: rng.uniform(70.0, 190.0, 3)  # noqa: E731 - a word for one draw
    seed = lambda: int(rng.integers(1, 1 << 40))  # noqa: E731
    rows = [shape_row(k.INSIDE, [0.0, 0.0, z], [x, y, z], np.eye(3), [150, 145, 135], seed())]
    for wall in range(4):
        turn = wall * np.pi / 2
        R = exp_rotation([0.0, 0.0, turn])
        depth_of_wall, half_width = (x, y) if wall % 2 == 0 else (y, x)
        places = np.linspace(-half_width + 0.8, half_width - 0.8, 4) + rng.uniform(-0.15, 0.15, 4)
        for place in places:
            deep, wide, tall = rng.uniform(0.15, 0.4), rng.uniform(0.2, 0.45), rng.uniform(0.2, 0.95)
            centre = R @ [depth_of_wall - deep - rng.uniform(0.0, 0.2), place, tall]
            yaw = turn + rng.uniform(-0.25, 0.25)
            rows.append(box(centre, [deep, wide, tall], yaw=yaw, colour=tint(), seed=seed()))
            if rng.random() < 0.7:
                small = rng.uniform(0.06, 0.14, 3)
                top = [*centre[:2], 2 * tall + small[2]]
                rows.append(box(top, small, yaw=rng.uniform(0, np.pi), colour=tint(), seed=seed()))
        shelf = R @ [depth_of_wall - 0.14, rng.uniform(-1.0, 1.0), rng.uniform(1.9, 2.2)]
        rows.append(box(shelf, [0.14, 0.6, 0.02], yaw=turn, colour=tint(), seed=seed()))
        radius = rng.uniform(0.09, 0.13)
        rows.append(ball([shelf[0], shelf[1], shelf[2] + 0.02 + radius], radius, colour=tint(), seed=seed()))
    rows.append(box([0.0, 0.0, 0.36], [0.42, 0.3, 0.36], yaw=0.4, colour=tint(), seed=seed()))
    rows.append(ball([0.1, 0.05, 0.86], 0.14, colour=tint(), seed=seed()))
    return Scene(
        freeze(np.array(rows)),
        freeze(np.zeros((0, 0))),
        (0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0, 0.0),
        _unit(0.3, 0.5, 0.8),
        freeze(np.zeros((0, 0, 2))),
    )


def make_terrain(rng: np.random.Generator) -> Scene:
    """Lay out 28 x 28 m of open ground: hills and bumps of 6 to 0.35 m across, with boulders half buried.

    Parameters
    ----------
    rng : numpy.random.Generator
        What lies where is drawn from it.

    Returns
    -------
    Scene
    """
    n = round(2 * RELIEF_REACH / _SPACING) + 3
    relief = np.zeros((n, n))
    for across, rise in ((6.0, 0.42), (3.0, 0.16), (1.4, 0.06), (0.7, 0.022), (0.35, 0.008)):
        sigma = 0.25 * across / _SPACING
        bumps = ndimage.gaussian_filter(rng.standard_normal((n, n)), sigma, mode="reflect")
        relief += rise * bumps / bumps.std()
    relief = freeze(relief - relief.mean())
    first = -RELIEF_REACH - _SPACING
    frame = (first, first, _SPACING)
    scene = Scene(
        freeze(np.zeros((0, k.N_COLUMNS))),
        relief,
        frame,
        (128.0, 112.0, 88.0, 77.0),
        _unit(0.5, 0.3, 0.6),
        _bounds_of(relief, frame),
    )
    xy = rng.uniform(-RELIEF_REACH + 1.0, RELIEF_REACH - 1.0, (170, 2))
    xy = xy[np.abs(np.hypot(*xy.T) - ORBIT_RADIUS) > 0.9]  # the way itself is free
    rows = []
    for place, height in zip(xy, scene.ground_height(xy), strict=True):
        radius = rng.uniform(0.1, 0.45)
        centre = [*place, height - 0.35 * radius]
        rows.append(ball(centre, radius, colour=rng.uniform(80.0, 160.0, 3), seed=int(rng.integers(1, 1 << 40))))
    return replace(scene, shapes=freeze(np.array(rows)))


ORBIT_RADIUS = 3.2
"""Radius of the way through a terrain, metres."""


def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    length = float(np.linalg.norm([x, y, z]))
    return x / length, y / length, z / length


def _bounds_of(relief: Float64Array, frame: tuple[float, float, float]) -> Float64Array:
    tiles = np.empty(((relief.shape[0] - 3) // k.TILE, (relief.shape[1] - 3) // k.TILE, 2))
    k.relief_tiles(relief, frame, tiles)
    return np.asarray(freeze(tiles))


def _signed_distance(points: Float64Array, shape: Float64Array) -> Float64Array:
    local = (points - shape[k.CX : k.CX + 3]) @ shape[k.R0 : k.R0 + 9].reshape(3, 3)
    half = shape[k.HX : k.HX + 3]
    if shape[k.KIND] == k.SPHERE:
        return np.asarray(np.linalg.norm(local, axis=1) - half[0])
    over = np.abs(local) - half
    outside = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    return np.asarray(outside + np.minimum(over.max(axis=1), 0.0))


def _top_of(xy: Float64Array, shape: Float64Array) -> Float64Array:
    """Height of a shape's upper side, or of a room's floor, at (x, y); NaN beside it."""
    away = xy - shape[k.CX : k.CX + 2]
    if shape[k.KIND] == k.SPHERE:
        rest = shape[k.HX] ** 2 - (away**2).sum(axis=1)
        return np.where(rest >= 0.0, shape[k.CZ] + np.sqrt(np.maximum(rest, 0.0)), np.nan)
    local = away @ shape[k.R0 : k.R0 + 9].reshape(3, 3)[:2, :2]
    under = (np.abs(local) <= shape[k.HX : k.HX + 2]).all(axis=1)
    side = -1.0 if shape[k.KIND] == k.INSIDE else 1.0
    return np.where(under, shape[k.CZ] + side * shape[k.HZ], np.nan)
