"""Scan: what everything becomes before it is matched."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from seismo3d._edges import edge_elements
from seismo3d._typing import AnyArray, ArrayLike, Float32Array, Float64Array
from seismo3d._validate import as_array, as_kind, as_number, as_points, as_real_array, freeze, told
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.geometry.camera import PinholeCamera, as_camera
from seismo3d.geometry.voxels import downsample_points, estimate_normals


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Sparse keypoints with descriptors.

    Attributes
    ----------
    points : ndarray of shape (k, d), float64
        In the scan's frame and units.
    descriptors : ndarray of shape (k, m)
    """

    points: Float64Array
    descriptors: AnyArray


@dataclass(frozen=True, slots=True, eq=False)
class Raster:
    """The grid that a scan was made from, for matchers that work on grids.

    Attributes
    ----------
    values : ndarray
        Image [row, column], volume (inline, crossline, sample), or elevation [row, column].
    kind : str
        "image", "volume", "rgbd" or "elevation".
    points : ndarray of shape (rows, columns, 3) or None
        Point of each pixel in the scan's frame, NaN where there is none; for "rgbd" and "elevation".
    camera : PinholeCamera or None
    """

    values: AnyArray
    kind: str
    points: Float64Array | None = None
    camera: PinholeCamera | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """Points with normals, features and weights, in two or three dimensions.

    Attributes
    ----------
    points : ndarray of shape (n, d), float64
        Finite; metres, pixels (column, row) or voxels (inline, crossline, sample).
    normals : ndarray of shape (n, d), float32, or None
        Unit normals; their signs carry no meaning.
    weights : ndarray of shape (n,), float64, or None
        Not negative; None stands for 1.
    features : Features or None
    raster : Raster or None
        The grid that the scan was made from.
    """

    points: Float64Array
    normals: Float32Array | None = None
    weights: Float64Array | None = None
    features: Features | None = None
    raster: Raster | None = None

    def __post_init__(self) -> None:
        if getattr(self.points, "dtype", None) != np.float64 or self.points.ndim != 2:
            raise ShapeError(f"points is {told(self.points)}; expected rows of float64. Make it by Scan.from_points.")

    @property
    def dim(self) -> int:
        """Number of dimensions, 2 or 3."""
        return int(self.points.shape[1])

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def from_points(
        cls,
        points: ArrayLike,
        normals: ArrayLike | None = None,
        *,
        weights: ArrayLike | None = None,
        features: Features | None = None,
    ) -> Scan:
        """Make a scan of points.

        Parameters
        ----------
        points : array_like of shape (n, 2) or (n, 3)
            Finite points, at least one.
        normals : array_like of the same shape, optional
            Their length does not matter; zero vectors are refused.
        weights : array_like of shape (n,), optional
            Not negative, at least one positive.
        features : Features, optional
            Keypoints with descriptors in the same frame, kept with the scan: ``register`` takes matched ones.

        Returns
        -------
        Scan
        """
        p = as_points(points, "points")
        if len(p) == 0:
            raise ShapeError(f"points has shape {p.shape}: it is empty. Give at least one point.")
        n = None if normals is None else _as_unit(normals, p)
        w = None
        if weights is not None:
            w = np.array(as_real_array(weights, "weights", ndim=1), dtype=np.float64)
            if w.shape != (len(p),):
                raise ShapeError(f"weights has shape {w.shape}; expected ({len(p)},), one a point.")
            if not np.isfinite(w).all() or (w < 0).any() or not w.sum() > 0:
                raise ParameterError("weights holds negative, infinite or only zero values; expected finite weights.")
        if features is not None:
            as_kind(features, Features, "features", remedy="Give Features(points, descriptors), or leave it out.")
        return cls(_own(p, points), n, w, features)

    @classmethod
    def from_file(cls, path: str | Path) -> Scan:
        """Make a scan of a point file; see :func:`seismo3d.io.points.read_points` for the formats."""
        from seismo3d.io.points import read_points

        held = read_points(path)
        return cls.from_points(held.points, held.normals)

    @classmethod
    def from_image(cls, image: ArrayLike, *, smoothing: float = 1.5, share: float = 0.1) -> Scan:
        """Make a scan of the edges of an image; coordinates are (column, row) in pixels.

        Parameters
        ----------
        image : array_like of shape (rows, columns) or (rows, columns, channels)
            Grey or colour; channels are averaged.
        smoothing : float
            Standard deviation of the Gaussian under the gradient, in pixels.
        share : float
            Share of the pixels, at most, that become points.

        Returns
        -------
        Scan
            With normals along the gradient, weights by its strength, and the image as raster.

        Raises
        ------
        GeometryError
            If the image has no edges.
        """
        grey = one_channel(image)
        return cls._from_edges(grey, "image", smoothing, share)

    @classmethod
    def from_volume(cls, volume: ArrayLike, *, smoothing: float = 1.0, share: float = 0.03) -> Scan:
        """Make a scan of the surfaces in a volume where the amplitude changes most; (inline, crossline, sample).

        Parameters
        ----------
        volume : array_like of shape (inlines, crosslines, samples)
            NaN where there is nothing.
        smoothing, share
            As for :meth:`from_image`.

        Returns
        -------
        Scan
        """
        values = as_real_array(volume, "volume", ndim=3)
        return cls._from_edges(values, "volume", smoothing, share)

    @classmethod
    def from_rgbd(cls, rgb: ArrayLike | None, depth: ArrayLike, camera: object, *, max_depth: float = 10.0) -> Scan:
        """Make a scan of a colour and depth frame, in the camera's frame (x right, y down, z forwards), in metres.

        Parameters
        ----------
        rgb : array_like of shape (rows, columns[, 3]), or None
            Registered with the depth image; kept for the matching of features.
        depth : array_like of shape (rows, columns)
            ``camera.depth_scale`` of its values are a metre; 0 or NaN where there is none.
        camera : PinholeCamera, dict, or object with its fields
        max_depth : float
            Farther points are left out, in metres.

        Returns
        -------
        Scan
            Without normals: those of neighbouring pixels are mostly noise, and matching estimates its own. Weights fall
            with the fourth power of depth beyond a metre, as the variance of a structured-light sensor grows.

        Raises
        ------
        GeometryError
            If no pixel has a depth.
        """
        lens = as_camera(camera)
        grid = lens.back_project(depth)
        grid[grid[:, :, 2] > as_number(max_depth, "max_depth", low=0.0, strict=True)] = np.nan
        grey = None if rgb is None else one_channel(rgb, "rgb")
        if grey is not None and grey.shape != grid.shape[:2]:
            raise ShapeError(
                f"rgb has shape {grey.shape} and depth {grid.shape[:2]}; expected the same. Register them first."
            )
        normals = grid_normals(grid)
        good = np.isfinite(normals).all(axis=2) & np.isfinite(grid).all(axis=2)
        if not good.any():
            raise GeometryError(
                "depth has no pixel with a depth and a surface; expected a depth image whose values over the camera's "
                f"depth_scale of {lens.depth_scale:g} are metres, {max_depth:g} at most. Millimetres have one of 1000."
            )
        points = grid[good]
        weights = 1.0 / np.maximum(points[:, 2], 1.0) ** 4
        raster = Raster(grid[:, :, 2] if grey is None else grey, "rgbd", grid, lens)
        return cls(freeze(points), None, freeze(weights), None, raster)

    @classmethod
    def from_elevation(cls, elevation: ArrayLike, spacing: float | tuple[float, float] = 1.0) -> Scan:
        """Make a scan of an elevation map: x along the columns, y along the rows, z up, all in the spacing's units.

        Parameters
        ----------
        elevation : array_like of shape (rows, columns)
            NaN where there is none.
        spacing : float or (float, float)
            Distance of neighbouring columns and rows.

        Returns
        -------
        Scan
        """
        z = np.asarray(as_real_array(elevation, "elevation", ndim=2), dtype=np.float64)
        dx, dy = _two_spacings(spacing)
        x, y = np.meshgrid(np.arange(z.shape[1]) * dx, np.arange(z.shape[0]) * dy)
        grid = np.stack([x, y, np.where(np.isfinite(z), z, np.nan)], axis=-1)
        normals = grid_normals(grid)
        good = np.isfinite(normals).all(axis=2) & np.isfinite(z)
        if not good.any():
            raise GeometryError("elevation has no cell with neighbours; expected a map of at least 3 x 3 finite cells.")
        raster = Raster(z, "elevation", grid)
        return cls(freeze(grid[good]), freeze(normals[good].astype(np.float32)), None, None, raster)

    def downsampled(self, voxel_size: float) -> Scan:
        """Return the scan with the points of each voxel replaced by their centroid, normals and weights averaged."""
        points, owner = downsample_points(self.points, voxel_size)
        count = np.bincount(owner, minlength=len(points))
        weights = None if self.weights is None else np.bincount(owner, self.weights, len(points)) / count
        normals = None
        if self.normals is not None:
            first = np.zeros(len(points), dtype=np.int64)
            first[owner[::-1]] = np.arange(len(owner))[::-1]
            sign = np.sign((self.normals * self.normals[first[owner]]).sum(axis=1))
            total = np.stack([np.bincount(owner, sign * column, len(points)) for column in self.normals.T], axis=1)
            length = np.linalg.norm(total, axis=1, keepdims=True)
            normals = (total / np.where(length > 0, length, 1.0)).astype(np.float32)
        return Scan(points, normals, weights, self.features, self.raster)

    def with_normals(self, *, n_neighbours: int = 12) -> Scan:
        """Return the scan with normals: its own where it has them, else estimated from the nearest neighbours."""
        if self.normals is not None:
            return self
        return replace(self, normals=estimate_normals(self.points, n_neighbours=n_neighbours)[0])

    @classmethod
    def _from_edges(cls, values: AnyArray, kind: str, smoothing: float, share: float) -> Scan:
        sigma = as_number(smoothing, "smoothing", low=0.3, high=20.0)
        as_number(share, "share", low=0.0, high=1.0, strict=True)
        if min(values.shape) < 5:
            raise ShapeError(f"{kind} has shape {values.shape}; expected at least 5 along each axis.")
        places, normals, strength = edge_elements(values, smoothing=sigma, share=share)
        if len(places) == 0:
            raise GeometryError(f"{kind} has no edges: its values are all alike; expected structure to register.")
        if kind == "image":
            places, normals = np.ascontiguousarray(places[:, ::-1]), np.ascontiguousarray(normals[:, ::-1])
        weights = strength / strength.max()
        return cls(freeze(places), freeze(normals), freeze(weights), None, Raster(values, kind))


def as_scan(data: Scan | ArrayLike | str | Path, name: str) -> Scan:
    """Return a scan from a scan, a point file, an (n, 2) or (n, 3) array of points, an image or a volume."""
    if isinstance(data, Scan):
        return data
    if isinstance(data, str | Path):
        return Scan.from_file(data)
    array = as_array(data, name)
    if array.ndim == 2 and not {2, 3}.isdisjoint(array.shape):
        points = as_points(array, name, finite=False)
        if len(points) == 0:
            raise ShapeError(f"{name} has shape {points.shape}: it is empty. Give at least one point.")
        return Scan(points)
    if array.ndim == 2:
        return Scan.from_image(array)
    if array.ndim == 3:
        return Scan.from_image(array) if array.shape[2] in (3, 4) else Scan.from_volume(array)
    raise ShapeError(f"{name} has shape {array.shape}; expected points (n, 2) or (n, 3), an image or a volume.")


def one_channel(image: ArrayLike, name: str = "image") -> AnyArray:
    """Return an image of one channel from one of one, three or four channels (the fourth is dropped)."""
    values = as_real_array(image, name, ndim=(2, 3))
    if values.ndim == 3:
        if values.shape[2] not in (1, 3, 4):
            raise ShapeError(
                f"{name} has shape {values.shape}; expected (rows, columns) or (rows, columns, 3), channels last."
            )
        values = values[:, :, :3].mean(axis=2)
    return values


def _two_spacings(spacing: object) -> tuple[float, float]:
    """Return the distances of neighbouring columns and rows from one number for both, or from two."""
    both = spacing if isinstance(spacing, (tuple, list, np.ndarray)) and np.ndim(spacing) else (spacing,)
    if len(both) not in (1, 2):
        raise ParameterError(f"spacing is {told(spacing)}; expected a number, or two: of columns and of rows.")
    dx, dy = (as_number(one, "spacing", low=0.0, strict=True) for one in (both[0], both[-1]))
    return dx, dy


def grid_normals(grid: Float64Array) -> Float64Array:
    """Return unit normals of a grid of points of shape (rows, columns, 3), NaN at edges, holes and jumps of depth."""
    if min(grid.shape[:2]) < 3:
        return np.full(grid.shape, np.nan)
    out = np.full(grid.shape, np.nan)
    across = grid[1:-1, 2:] - grid[1:-1, :-2]
    down = grid[2:, 1:-1] - grid[:-2, 1:-1]
    normal = np.cross(across, down)
    length = np.linalg.norm(normal, axis=2)
    reach = np.linalg.norm(across, axis=2) + np.linalg.norm(down, axis=2)
    with np.errstate(invalid="ignore"):
        usual = np.nanmedian(reach / np.maximum(np.abs(grid[1:-1, 1:-1, 2]), 1e-9)) if np.isfinite(reach).any() else 0.0
        jump = reach > 8.0 * usual * np.abs(grid[1:-1, 1:-1, 2])
        bad = ~(length > 0.0) | (jump if usual > 0.0 and np.nanmin(np.abs(grid[..., 2])) > 0.0 else False)
    normal = normal / np.where(length > 0.0, length, 1.0)[:, :, None]
    normal[bad] = np.nan
    out[1:-1, 1:-1] = normal
    return out


def _as_unit(normals: ArrayLike, points: Float64Array) -> Float32Array:
    n = as_points(normals, "normals", dim=points.shape[1])
    if n.shape != points.shape:
        raise ShapeError(f"normals has shape {n.shape}; expected {points.shape}, one a point.")
    length = np.linalg.norm(n, axis=1, keepdims=True)
    if not (length > 0.0).all():
        raise GeometryError(
            f"normals has {int((length == 0).sum())} rows of length zero; expected directions. Drop those points."
        )
    return (n / length).astype(np.float32)


def _own(points: Float64Array, given: ArrayLike) -> Float64Array:
    return freeze(points.copy() if points is given or np.shares_memory(points, np.asarray(given)) else points)
