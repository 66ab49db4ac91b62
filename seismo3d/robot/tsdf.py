"""The dense map: signed distances to the surface in hashed blocks, with colour; fusion, ray-cast and mesh.

Averaging projected distances follows Curless and Levoy [1]_, hashed blocks Niessner et al. [2]_.

References
----------
.. [1] B. Curless, M. Levoy, "A volumetric method for building complex models from range images", SIGGRAPH 1996.
   :doi:`10.1145/237170.237269`
.. [2] M. Niessner et al., "Real-time 3D reconstruction at scale using voxel hashing", ACM Trans. Graphics 32(6), 2013.
   :doi:`10.1145/2508363.2508374`
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int32Array, Int64Array
from seismo3d.geometry._kernels_voxel_keys import find
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import split_transform
from seismo3d.robot import _kernels_blocks as blocks
from seismo3d.robot import _kernels_carve as carving
from seismo3d.robot import _kernels_fuse as fusing
from seismo3d.robot import _kernels_raycast as rays
from seismo3d.robot.camera import lens_numbers
from seismo3d.robot.frames import Measured
from seismo3d.robot.room import room_to_grow
from seismo3d.robot.voxels import unpack_distance, unpack_weight

REACH = 0.15
"""Metres from the expected depth within which a surface is looked for."""
_ROOM = 1 << 15
"""Blocks that there is room for from the beginning; the system gives the memory when it is written to."""
_MARGIN = 40
_STEADY, _EVERY = np.array([6, 24, 70]), np.array([1, 2, 4, 8])
"""Frames that have shown a block from which on it takes every second one, every fourth, every eighth."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The mapped surface as a camera would see it.

    Attributes
    ----------
    points, normals : ndarray of shape (rows, columns, 3), float32
        In the world frame; NaN where no surface is met. Normals point out of the surface.
    T_world_camera : ndarray of shape (4, 4), float64
    lens : ndarray of shape (4,), float64
        fx, fy, cx, cy of the image, which has no distortion.
    """

    points: Float32Array
    normals: Float32Array
    T_world_camera: Float64Array
    lens: Float64Array


class SurfaceMap:
    """A truncated signed-distance map in hashed blocks of 8 x 8 x 8 voxels.

    Distances and weights are held as :mod:`seismo3d.robot.voxels` says.
    Memory follows the surface that has been seen, 4.1 KB a block, never the volume around it.

    Parameters
    ----------
    voxel_size : float
        Edge of a voxel, metres.
    band : float
        Distances are kept up to this far from the surface, metres.
    heaviest : float
        Largest weight of a voxel: what has been seen longer is forgotten at this rate.
    """

    def __init__(self, voxel_size: float, band: float, *, heaviest: float = 200.0) -> None:
        self.voxel_size = voxel_size
        self.band = band
        self.heaviest = heaviest
        self.n_blocks = self._n_fused = 0
        self.keys = np.empty(_ROOM, dtype=np.int64)
        self.coordinates = np.empty((_ROOM, 3), dtype=np.int32)
        self.distance = room_to_grow((_ROOM, 512), np.uint16)
        self.root = room_to_grow((_ROOM, 512), np.uint16)
        self.colour = room_to_grow((_ROOM, 512, 4), np.uint8)
        self.times_shown = np.zeros(_ROOM, dtype=np.uint8)
        self._tables: dict[tuple[PinholeCamera, tuple[int, ...]], Int32Array] = {}
        self._image = np.zeros(1, dtype=np.uint64)
        self._make_table(12)

    @property
    def block_size(self) -> float:
        """Edge of a block, metres."""
        return blocks.SIDE * self.voxel_size

    @property
    def n_bytes(self) -> int:
        """Memory that the blocks in use take."""
        return self.n_blocks * (512 * (2 + 2 + 4) + 8 + 12 + 1)

    def add_blocks(self, keys: Int64Array) -> Int64Array:
        """Make the blocks of some keys where they are missing; return the numbers of all of them."""
        numbers = np.empty(len(keys), dtype=np.int64)
        while 2 * (self.n_blocks + len(keys)) > len(self._table):
            self._make_table(65 - self._shift)
        self._reserve(self.n_blocks + len(keys))
        first = self.n_blocks
        self.n_blocks = blocks.enter_keys(keys, first, self.keys, numbers, self._table_keys, self._table, self._shift)
        self.coordinates[first : self.n_blocks] = blocks.unpack(self.keys[first : self.n_blocks])
        return numbers

    def distances(self, numbers: int | slice) -> Float32Array:
        """Return the signed distances (..., 512) of a block or more, metres, NaN where not known."""
        return unpack_distance(self.distance[numbers], self.band)

    def weights(self, numbers: int | slice) -> Float32Array:
        """Return the weights (..., 512) of a block or more."""
        return unpack_weight(self.root[numbers], self.heaviest)

    def block_at(self, coordinates: Int32Array) -> int:
        """Return the number of the block at block coordinates (3,), or -1."""
        x, y, z = (int(c) for c in coordinates)
        return int(find(blocks.pack(x, y, z), self._table_keys, self._table, self._shift))

    def fuse(
        self,
        measured: Measured,
        camera: PinholeCamera,
        T_world_camera: Float64Array,
        *,
        carve: bool = False,
        pool: ThreadPoolExecutor,
        n_threads: int,
    ) -> None:
        """Average one frame into the map.

        Parameters
        ----------
        measured : Measured
        camera : PinholeCamera
        T_world_camera : ndarray of shape (4, 4), float64
            Pose at the time of the depth.
        carve : bool
            Whether what the frame sees through is cleared, too.
        pool, n_threads
            Where the work goes; the result doesn't depend on it.
        """
        if carve:
            self._carve(measured, camera, T_world_camera, pool, n_threads)
        R, t = split_transform(T_world_camera)
        reach = self.band + 0.5 * self.voxel_size
        lens, table = lens_numbers(camera), self._pixel_table(camera, measured.depth.shape)
        image = self._image_of(table.size)

        def straighten(pair: tuple[int, int]) -> None:
            fusing.straighten(*pair, table, measured.pixels, image)

        straightened = [pool.submit(straighten, pair) for pair in _ranges(len(table), n_threads)]
        touched = blocks.touched_blocks(measured.vertices, 2, R, t, self.block_size, reach)
        numbers, times = self._due(self.add_blocks(touched))
        for part in straightened:
            part.result()

        def work(pair: tuple[int, int]) -> None:
            part = slice(*pair)
            fusing.fuse_blocks(
                numbers[part], self.coordinates, self.distance, self.root, self.colour.view(np.uint32)[:, :, 0],
                self.voxel_size, R, t, lens, table.shape, _MARGIN, image, times[part], self.band, self.heaviest,
            )  # fmt: skip

        _spread(work, _ranges(len(numbers), 8 * n_threads), pool)

    def _due(self, numbers: Int64Array) -> tuple[Int64Array, Float32Array]:
        """Return those of the blocks that a frame shows that it is put into, and how many times its weight each takes.

        A block that was shown often takes every second frame with twice the weight, later every fourth and eighth, the
        blocks in turn.
        """
        self._n_fused += 1
        shown = self.times_shown[numbers]
        self.times_shown[numbers] += shown < _STEADY[-1]
        every = _EVERY[np.searchsorted(_STEADY, shown, side="right")]
        due = (numbers + self._n_fused) % every == 0
        return numbers[due], every[due].astype(np.float32)

    def _carve(
        self, measured: Measured, camera: PinholeCamera, T: Float64Array, pool: ThreadPoolExecutor, n_threads: int
    ) -> None:
        R, t = split_transform(T)
        half, nearest = halved(camera), carving.nearest_around(measured.depth)
        lens, table = lens_numbers(half), self._pixel_table(half, nearest.shape)
        beyond = carving.straighten_depth(table, nearest)
        farthest = carving.farthest_tiles(beyond, *table.shape)

        def before(pair: tuple[int, int]) -> Int64Array:
            return carving.blocks_before(
                *pair, self.coordinates, self.block_size, R, t, lens, _MARGIN, farthest, 2.0 * self.band
            )

        def work(part: Int64Array) -> None:
            carving.carve_blocks(
                part, self.coordinates, self.distance, self.root, self.voxel_size, R, t, lens, table.shape, _MARGIN,
                beyond, self.band, self.heaviest,
            )  # fmt: skip

        seen = np.concatenate(_spread(before, _ranges(self.n_blocks, 4 * n_threads), pool))
        _spread(work, np.array_split(seen, 8 * n_threads), pool)

    def cast(
        self,
        expected: Float32Array,
        lens: Float64Array,
        T_world_camera: Float64Array,
        *,
        pool: ThreadPoolExecutor,
        n_threads: int,
    ) -> Prediction:
        """Return the surface as a camera without distortion sees it.

        Parameters
        ----------
        expected : ndarray of shape (rows, columns), float32
            Depth near which the surface of each pixel is looked for, within ``REACH``; none where it is not positive.
        lens : ndarray of shape (4,), float64
            fx, fy, cx, cy.
        T_world_camera : ndarray of shape (4, 4), float64
        pool, n_threads
            Where the work goes; the result doesn't depend on it.

        Returns
        -------
        Prediction
        """
        rows, columns = expected.shape
        expected = np.where(expected > 0.0, expected, np.float32(-1e3))
        R, t = split_transform(T_world_camera)
        points = np.empty((rows, columns, 3), dtype=np.float32)
        normals = np.empty((rows, columns, 3), dtype=np.float32)

        def work(first: int, last: int) -> None:
            rays.cast_rows(
                first, last, expected, REACH, R, t, lens, self.voxel_size, self.band, self.distance,
                self._table_keys, self._table, self._shift, points, normals,
            )  # fmt: skip

        _spread(lambda pair: work(*pair), _ranges(rows, 4 * n_threads), pool)
        return Prediction(points, normals, T_world_camera, lens)

    def _image_of(self, n_pixels: int) -> AnyArray:
        """Return the memory of a frame's image without distortion, kept from frame to frame; its last row is zero."""
        if len(self._image) != n_pixels + 1:
            self._image = np.zeros(n_pixels + 1, dtype=np.uint64)
        return self._image

    def _pixel_table(self, camera: PinholeCamera, shape: tuple[int, ...]) -> Int32Array:
        key = (camera, shape)
        if key not in self._tables:
            self._tables[key] = blocks.pixel_table(shape[0], shape[1], _MARGIN, lens_numbers(camera))
        return self._tables[key]

    def _make_table(self, bits: int) -> None:
        self._shift = 64 - bits
        self._table = np.full(1 << bits, -1, dtype=np.int32)
        self._table_keys = np.empty(1 << bits, dtype=np.int64)
        blocks.fill_table(self.keys[: self.n_blocks], self._table_keys, self._table, self._shift)

    def _reserve(self, n: int) -> None:
        if n <= len(self.keys):
            return
        size = max(n, 2 * len(self.keys))
        for name in ("keys", "coordinates", "distance", "root", "colour", "times_shown"):
            old = getattr(self, name)
            new = room_to_grow((size, *old.shape[1:]), old.dtype)
            new[: self.n_blocks] = old[: self.n_blocks]
            setattr(self, name, new)


def halved(camera: PinholeCamera) -> PinholeCamera:
    """Return the camera of an image of half the size, each of its pixels two by two of the whole one."""
    return PinholeCamera(
        camera.fx / 2, camera.fy / 2, (camera.cx + 0.5) / 2 - 0.5, (camera.cy + 0.5) / 2 - 0.5, camera.distortion,
        camera.depth_scale,
    )  # fmt: skip


def _ranges(n: int, n_parts: int) -> list[tuple[int, int]]:
    """Return first and last + 1 of parts of a range, nearly equal ones."""
    return list(pairwise(n * k // n_parts for k in range(n_parts + 1)))


def _spread(work: Callable[[Any], Any], parts: list[Any], pool: ThreadPoolExecutor) -> list[Any]:
    """Do each part on the pool, and return what each gave; errors of a part are raised here."""
    return list(pool.map(work, parts))
