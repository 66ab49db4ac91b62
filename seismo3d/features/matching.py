r"""Match two images or two volumes.

Points of both are described by histograms of oriented gradients in several round windows; descriptors are compared
under all their cyclic shifts at once, which gives the rotation between them; matches are refined to a fraction of a
pixel and checked by their neighbours; good matches find more beside them. In the manner of [1]_ and [2]_, with
satellite windows and refinement added.

References
----------
.. [1] A. Vokhmintcev, M. Timchenko, "The new combined method of the generation of a 3d dense map of environment based
   on history of camera positions and the robot's movements"; it refers to the next.
.. [2] D. Miramontes-Jaramillo, V. Kober, V. H. Diaz-Ramirez, V. Karnaukhov, "A novel image matching algorithm based on
   sliding histograms of oriented gradients", J. Commun. Technol. Electron. 59, 2014.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, Float64Array
from seismo3d._validate import freeze, is_among, told
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.features.describing import Features, as_count, described
from seismo3d.features.inputs import as_grid
from seismo3d.features.pairs import Pairs
from seismo3d.features.planar import ImageFeatures, PlanarSettings, match_images
from seismo3d.features.solid import SolidFeatures, SolidMatches, SolidSettings, match_volumes


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Places that two images or volumes have in common, best first.

    Attributes
    ----------
    points_target, points_source : ndarray of shape (n, d), float64
        Images: (column, row) in pixels. Volumes: (inline, crossline, sample). Row ``i`` of one matches row ``i`` of
        the other.
    score : ndarray of shape (n,), float64
        Correlation of the two patches after refinement, 0 to 1.
    angle : ndarray of shape (n,), float64
        Rotation from source to target, radians. Images: -pi to pi, x right, y down; volumes: 0 to pi, about the
        axis of ``A_target_source``.
    scale : ndarray of shape (n,), float64
        Size in the target over size in the source.
    A_target_source : ndarray of shape (n, d, d), float64
        Linear part of each match's own map from source to target.
    n_points : tuple of int
        Points that were compared in the target and in the source.
    """

    points_target: Float64Array
    points_source: Float64Array
    score: Float64Array
    angle: Float64Array
    scale: Float64Array
    A_target_source: Float64Array
    n_points: tuple[int, int]

    def __len__(self) -> int:
        return len(self.score)


def match(
    target: Any,
    source: Any,
    *,
    mask_target: ArrayLike | None = None,
    mask_source: ArrayLike | None = None,
    n_points: int | None = None,
    tilts: str = "auto",
) -> Matches:
    """Find places that two images or two volumes have in common.

    Parameters
    ----------
    target, source : array_like, DataArray, Scan or Features
        Both images (rows, columns), grey or colour, or both volumes (inline, crossline, sample), each side 16 or
        longer. NaN counts as missing: no match lies there, and windows look across single pixels or traces of it. What
        is matched often is best given as :func:`seismo3d.describe` makes it.
    mask_target, mask_source : array_like of bool, optional
        True where there is data: dead traces and missing depth are left out by False.
    n_points : int, optional
        Points compared, at most, in each: 500 in images and 300 in volumes where not given.
    tilts : {"auto", "always", "never"}
        Whether images are also compared as if seen from the side: always, never, or only where few matches are found
        without. It takes matching from 45 to beyond 70 degrees of tilt, at about twenty times the cost. Volumes have
        no tilt.

    Returns
    -------
    Matches
        Empty where nothing is alike, as in constant or unrelated images.

    Raises
    ------
    ShapeError
        If the two are not both images or both volumes, are too small, or a mask's shape differs.
    ParameterError
        If a setting is out of bounds, or a mask or ``n_points`` is given for what is described already.

    Notes
    -----
    Images may be of scenes in depth: matches are checked by their neighbours, and where one plane does not explain
    them and epipolar lines do, by those. Volumes are taken
    to be carried into each other by one rigid motion of any size; ``align_pairs`` gets the transform from the matches.
    Beyond its input, a pair of images of 640 x 480 pixels takes 22 MB; a pair of cubes, 8 times one's size in float32.

    Examples
    --------
    >>> import numpy as np
    >>> from skimage import data
    >>> image = data.camera()
    >>> found = match(image[:, :-40], image[:, 40:])
    >>> shift = np.median(found.points_target - found.points_source, axis=0)
    >>> bool(np.abs(shift - [40, 0]).max() < 0.01)
    True
    """
    if n_points is not None:
        as_count(n_points)
    if not is_among(tilts, ("auto", "always", "never")):
        raise ParameterError(f"tilts is {told(tilts)}; expected 'auto', 'always' or 'never'.")
    first, second = _both_described(target, source, mask_target, mask_source, n_points)
    one, other = first.described, second.described
    if isinstance(one, ImageFeatures) and isinstance(other, ImageFeatures):
        settings = PlanarSettings(n_points=max(first.n_points, second.n_points), tilts=tilts)
        return _of_images(match_images(one, other, settings), (len(first), len(second)))
    if isinstance(one, SolidFeatures) and isinstance(other, SolidFeatures):
        return _of_volumes(match_volumes(one, other, SolidSettings()), (len(first), len(second)))
    raise ShapeError(f"target has {first.ndim} axes and source {second.ndim}; expected two images or two volumes.")


def _both_described(
    target: Any,
    source: Any,
    mask_target: ArrayLike | None,
    mask_source: ArrayLike | None,
    n_points: int | None,
) -> tuple[Features, Features]:
    """Describe what is not described yet: at the same time where OpenCV may use more than one thread."""
    import cv2

    _refuse_settings(target, "target", mask_target, n_points)
    _refuse_settings(source, "source", mask_source, n_points)
    if not isinstance(target, Features) and not isinstance(source, Features):
        dims = as_grid(target, "target").ndim, as_grid(source, "source").ndim
        if dims[0] != dims[1]:
            raise ShapeError(f"target has {dims[0]} axes and source {dims[1]}; expected two images or two volumes.")
        if dims[0] == 2 and cv2.getNumThreads() > 1:
            with ThreadPoolExecutor(1) as pool:
                later = pool.submit(described, source, "source", mask_source, n_points)
                return described(target, "target", mask_target, n_points), later.result()
    return described(target, "target", mask_target, n_points), described(source, "source", mask_source, n_points)


def _refuse_settings(values: Any, name: str, mask: ArrayLike | None, n_points: int | None) -> None:
    if isinstance(values, Features) and (mask is not None or n_points is not None):
        raise ParameterError(
            f"{name} is described already; expected no mask_{name} or n_points. Give them to describe."
        )


def _of_images(pairs: Pairs, n_points: tuple[int, int]) -> Matches:
    A = np.linalg.inv(pairs.linear)
    angle = np.arctan2(A[:, 1, 0] - A[:, 0, 1], A[:, 0, 0] + A[:, 1, 1])
    scale = np.sqrt(np.abs(np.linalg.det(A)))
    return _frozen(pairs.target, pairs.source, pairs.correlation, angle, scale, A, n_points)


def _of_volumes(found: SolidMatches, n_points: tuple[int, int]) -> Matches:
    n = len(found.target)
    angle = np.full(n, np.arccos(np.clip(0.5 * (np.trace(found.R) - 1.0), -1.0, 1.0)))
    A = np.repeat(found.R[None], n, axis=0)
    return _frozen(found.target, found.source, found.correlation, angle, np.ones(n), A, n_points)


def _frozen(
    target: Float64Array,
    source: Float64Array,
    score: Float64Array,
    angle: AnyArray,
    scale: AnyArray,
    A: AnyArray,
    n_points: tuple[int, int],
) -> Matches:
    order = np.argsort(-score, kind="stable")

    def sort(values: AnyArray) -> Float64Array:
        return freeze(np.ascontiguousarray(values[order], dtype=np.float64))

    return Matches(sort(target), sort(source), sort(score), sort(angle), sort(scale), sort(A), n_points)
