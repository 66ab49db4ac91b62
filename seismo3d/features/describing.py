"""Describe an image or a volume once, to match it to many others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_whole_number, freeze
from seismo3d.features.inputs import as_grey, as_grid
from seismo3d.features.planar import ImageFeatures, PlanarSettings, describe_image
from seismo3d.features.solid import SolidFeatures, SolidSettings, describe_solid


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """The points of an image or a volume, ready to be matched with :func:`seismo3d.match`.

    Attributes
    ----------
    points : ndarray of shape (n, d), float64
        Images: (column, row) in pixels. Volumes: (inline, crossline, sample).
    n_points : int
        Points asked for.
    described : ImageFeatures or SolidFeatures
        What matching compares: the image with its pyramid, 4.3 times its size in float32, or the smoothed volume; and
        descriptors, 0.4 MB for 500 points of an image.
    """

    points: Float64Array
    n_points: int
    described: ImageFeatures | SolidFeatures

    def __len__(self) -> int:
        return len(self.points)

    @property
    def ndim(self) -> int:
        """Two for an image, three for a volume."""
        return int(self.points.shape[1])


def describe(values: Any, *, mask: ArrayLike | None = None, n_points: int | None = None) -> Features:
    """Detect and describe the points of an image or a volume.

    Parameters
    ----------
    values : array_like, DataArray or Scan
        Image (rows, columns), grey or colour, or volume (inline, crossline, sample), each side 16 or longer. NaN
        counts as missing.
    mask : array_like of bool, optional
        True where there is data.
    n_points : int, optional
        At most so many: 500 in images and 300 in volumes where not given.

    Returns
    -------
    Features
        Without points where nothing stands out.

    Raises
    ------
    ShapeError
        If it is neither an image nor a volume, is too small, or the mask's shape differs.
    ParameterError
        If ``n_points`` is out of bounds.

    Examples
    --------
    >>> from skimage import data
    >>> from seismo3d import match
    >>> image = data.camera()
    >>> described = describe(image[:, 40:])
    >>> [len(match(other, described)) > 100 for other in (image[:, :-40], image[30:])]
    [True, True]
    """
    return described(values, "values", mask, n_points)


def described(values: Any, name: str, mask: ArrayLike | None, n_points: int | None) -> Features:
    """Describe an image or a volume under the name that its argument has; described ones are returned as they are."""
    if isinstance(values, Features):
        return values
    grid = as_grid(values, name)
    n = (500 if grid.ndim == 2 else 300) if n_points is None else as_count(n_points)
    grey = as_grey(grid, mask, name)
    if grid.ndim == 3:
        solid = describe_solid(grey, SolidSettings(n_points=n))
        return Features(freeze(solid.corners.points.copy()), n, solid)
    planar = describe_image(grey, PlanarSettings(n_points=n))
    return Features(freeze(planar.view.keypoints.points.copy()), n, planar)


def as_count(n_points: int) -> int:
    """Refuse a number of points that is out of bounds."""
    return as_whole_number(n_points, "n_points", low=1, high=100_000)
