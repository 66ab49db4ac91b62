"""Faults as motions: a surface carried on through the cube, and the slip of what lies on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import ndimage

from seismo3d._typing import AnyArray, BoolArray, Float32Array, Float64Array, IntArray
from seismo3d.seismic._kernels_restore import enlarge_grid, find_near_motion, read_between
from seismo3d.seismic.slip_fields import smooth_field
from seismo3d.seismic.term_fits import fit_terms
from seismo3d.seismic.throw_bells import smooth_about_bell

# what a throw counts that is only carried on, of one that matches
_CARRIED = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A vertical plane along a strike: s along it, w across it.

    Attributes
    ----------
    origin : ndarray of shape (2,), float64
        Inline and crossline of s = 0, w = 0.
    across : ndarray of shape (2,), float64
        Unit horizontal normal of the strike.
    """

    origin: Float64Array
    across: Float64Array

    @property
    def along(self) -> Float64Array:
        """Unit vector of the strike in the time slice."""
        return np.array([-self.across[1], self.across[0]])

    def lay(self, points: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return s, sample and w of points of shape (n, 3)."""
        rest = points[:, :2] - self.origin
        along = self.along
        # sums of two products, not products of matrices, whose last bits depend on threads
        s = rest[:, 0] * along[0] + rest[:, 1] * along[1]
        w = rest[:, 0] * self.across[0] + rest[:, 1] * self.across[1]
        return s, points[:, 2], w

    def place(self, s: Float64Array, samples: Float64Array, w: Float64Array) -> Float64Array:
        """Return points of shape (n, 3)."""
        flat = self.origin + s[:, None] * self.along + w[:, None] * self.across
        return np.column_stack([flat, samples])


@dataclass(frozen=True, slots=True, eq=False)
class FaultMotion:
    """What a fault did: all that lies on its surface slid down it.

    Attributes
    ----------
    frame : Frame
        Of the grid.
    first : (float, float)
        s and sample of the grid's first place; places are one apart.
    height : ndarray of shape (rows, samples), float64
        w of the surface, carried on over the whole grid.
    apart : ndarray of the same shape, float64
        Distance of each place from where the surface was found.
    throw : ndarray of the same shape, float64
        Samples, at places of the hanging wall after the motion.
    slopes : (float, float)
        Mean change of w along s and down, by which it goes on beyond the grid.
    hanging_side : int
        1 where the hanging wall lies along the frame's `across`, else -1.
    share : float
        Slip along strike over throw.
    decay : float
        Share of the slip that is lost with the first trace off the surface, across the strike: it dies away to zero at
        twice the inverse of that, as a parabola does.
    lift : float
        Share of the slip that the hanging wall took; the footwall took the rest, the other way.
    """

    frame: Frame
    first: tuple[float, float]
    height: Float64Array
    apart: Float64Array
    throw: Float64Array
    slopes: tuple[float, float]
    hanging_side: int
    share: float
    decay: float = 0.0
    lift: float = 1.0

    def height_at(self, s: Float64Array, samples: Float64Array) -> Float64Array:
        """Return w of the surface, straight on beyond the grid."""
        rows, columns = s - self.first[0], samples - self.first[1]
        inner = read_between(self.height, rows, columns)
        r, c = (np.clip(at, 0, n - 1) for at, n in zip((rows, columns), self.height.shape, strict=True))
        return np.asarray(inner + self.slopes[0] * (rows - r) + self.slopes[1] * (columns - c))

    def side(self, points: Float64Array) -> Float64Array:
        """Return how far points of shape (n, 3) lie on the side of the hanging wall, across the strike."""
        s, samples, w = self.frame.lay(points)
        return self.hanging_side * (w - self.height_at(s, samples))

    def throw_at(self, points: Float64Array) -> Float64Array:
        """Return the throw where points of shape (n, 3), carried across the strike, lie on the surface."""
        s, samples, _ = self.frame.lay(points)
        return np.asarray(read_between(self.throw, s - self.first[0], samples - self.first[1]), np.float64)

    def apart_at(self, points: Float64Array) -> Float64Array:
        """Return how far points, carried across the strike onto the surface, are from where it was found."""
        s, samples, _ = self.frame.lay(points)
        rows, columns = s - self.first[0], samples - self.first[1]
        r, c = (np.clip(at, 0, n - 1) for at, n in zip((rows, columns), self.height.shape, strict=True))
        return np.asarray(read_between(self.apart, rows, columns) + np.hypot(rows - r, columns - c), np.float64)

    def find_near(
        self, points: Float64Array, *, clear: float, reach: float, edge: float
    ) -> tuple[IntArray, Float64Array]:
        """Find the points of shape (n, 3) between two distances across the strike, no farther than edge from a place.

        Returns their numbers, and how far each lies on the side of the hanging wall.
        """
        found, off = find_near_motion(
            points, self.frame.origin, self.frame.along, self.frame.across, self.first, self.height, self.apart,
            self.slopes, reach, clear, edge,
        )  # fmt: skip
        return found, self.hanging_side * off

    def undo(self, points: Float64Array) -> Float64Array:
        """Return where points of shape (n, 3) lay before the fault moved; a wall that did not move stays as it is."""
        s, samples, w = self.frame.lay(points)
        off = w - self.height_at(s, samples)
        part = np.where(off * self.hanging_side > 0, self.lift, self.lift - 1.0)
        moved = part * slip_left(off, self.decay) * read_between(self.throw, s - self.first[0], samples - self.first[1])
        s0, samples0 = s - self.share * moved, samples - moved
        before = self.frame.place(s0, samples0, self.height_at(s0, samples0) + off)
        return np.where((part != 0.0)[:, None], before, points)


def slip_left(off: Float64Array, decay: float) -> Float64Array:
    """Return the share of a fault's slip that is left at distances off it; a decay is as in :class:`FaultMotion`."""
    return np.asarray(np.maximum(0.0, 1.0 - 0.5 * decay * np.abs(off)) ** 2)


def undo_parts(parts: Sequence[FaultMotion], points: Float64Array) -> Float64Array:
    """Return where points of shape (n, 3) lay before a fault moved that was found in parts.

    A part alone goes on without end; each point is moved by that which was found nearest to it along the fault, so that
    none is moved twice.
    """
    if len(parts) == 1:
        return parts[0].undo(points)
    nearest = nearest_parts(parts, points)
    before = points.copy()
    for number, part in enumerate(parts):
        mine = nearest == number
        before[mine] = part.undo(points[mine])
    return before


def nearest_parts(parts: Sequence[FaultMotion], points: Float64Array) -> IntArray:
    """Return the number of the part of a fault that was found nearest, along it, to each of some points."""
    if len(parts) == 1:
        return np.zeros(len(points), np.int64)
    return np.asarray(np.argmin([part.apart_at(points) for part in parts], axis=0), np.int64)


def find_motion(
    frame: Frame,
    first: tuple[float, float],
    height: Float64Array,
    throw: Float32Array,
    fit: Float32Array,
    *,
    hanging_side: int,
    share: float,
    stiffness: float,
    thin: int = 2,
) -> FaultMotion:
    """Make a motion of a surface and the throws that matched on it.

    What lies between two faults is strained by how throw changes from place to place, which is known less well than
    throw itself: it is taken from a field that is stiffer than the throw, about the bell that is nearest to it. A stiff
    field alone would flatten the top of a bell, and with it how throw changes around.

    Parameters
    ----------
    frame, first
        As in :class:`FaultMotion`.
    height : ndarray of shape (rows, samples), float64
        w of the surface; NaN off it.
    throw, fit : ndarray of shape (ceil(rows / thin), ceil(samples / thin)), float32
        Throw at every `thin`-th place, and its fit, 0 where it is carried on.
    hanging_side, share
        As in :class:`FaultMotion`.
    stiffness : float
        Of what the field has over the bell; see :func:`~seismo3d.seismic.slip_fields.smooth_field`.
    thin : int
        Places of the surface for one of the throw.

    Returns
    -------
    FaultMotion
    """
    inside = np.isfinite(height)
    matched = np.where(inside[::thin, ::thin], np.clip((fit - 0.4) / 0.6, 0.0, 1.0) ** 2, 0.0)
    stiff = partial(smooth_field, weights=np.maximum(matched, _CARRIED).astype(np.float32), stiffness=stiffness)
    field = smooth_about_bell(throw, matched.astype(np.float32), stiff)
    filled, apart = go_straight_on(height, inside)
    slopes = tuple(float(np.diff(filled, axis=axis).mean()) if n > 1 else 0.0 for axis, n in enumerate(height.shape))
    throws = enlarge(field, height.shape, thin).astype(np.float64)
    return FaultMotion(frame, first, filled, apart, throws, (slopes[0], slopes[1]), hanging_side, share)


def enlarge(values: Float32Array, shape: tuple[int, ...], thin: int) -> Float32Array:
    """Interpolate what is known at every `thin`-th place of a grid."""
    rows, columns = (np.minimum(np.arange(n) / thin, m - 1) for n, m in zip(shape, values.shape, strict=True))
    return np.asarray(enlarge_grid(values, rows, columns), np.float32)


def fill_nearest(values: AnyArray) -> Float64Array:
    """Return values on a grid, those of the nearest place where there are none (NaN); at least one must be there."""
    nearest = ndimage.distance_transform_edt(~np.isfinite(values), return_distances=False, return_indices=True)
    return np.asarray(values[tuple(nearest)], np.float64)


def go_straight_on(height: Float64Array, inside: BoolArray) -> tuple[Float64Array, Float64Array]:
    """Carry a surface on over a grid: on a plane, and beside the surface by what that leaves of its nearest place.

    Parameters
    ----------
    height : ndarray of shape (rows, samples), float64
        w of the surface.
    inside : ndarray of the same shape, bool
        Where it was found, somewhere.

    Returns
    -------
    filled, apart : ndarray of the same shape, float64
        Its w everywhere, and the distance of each place from where it was found.
    """
    rows, columns = (np.indices(height.shape)[axis].astype(np.float64) for axis in (0, 1))
    at, values = (np.ones(int(inside.sum())), rows[inside], columns[inside]), height[inside]
    mean = float(values.mean())
    factors, left = fit_terms(at, values - mean)
    nearest = ndimage.distance_transform_edt(~inside, return_distances=False, return_indices=True)
    rest = np.zeros(height.shape)
    rest[inside] = left
    beside = ndimage.gaussian_filter(rest[tuple(nearest)], 3.0)
    plane = mean + factors[0] + factors[1] * rows + factors[2] * columns
    return np.where(inside, height, plane + beside), np.asarray(ndimage.distance_transform_edt(~inside), np.float64)
