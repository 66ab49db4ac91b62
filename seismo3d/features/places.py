r"""Recognise a place among many: which described images look most like this one, turned as it may be.

Histograms shift cyclically when the camera turns about its axis; the magnitudes of their Fourier transform over the
shift stay. Each point of a query votes for the images that hold its nearest neighbours, by how much nearer they are
than the first image that is none of those [1]_.

References
----------
.. [1] S. McCann, D. G. Lowe, "Local naive Bayes nearest neighbor for image classification", CVPR 2012.
   :doi:`10.1109/CVPR.2012.6248111`
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int64Array
from seismo3d._validate import as_whole_number, freeze
from seismo3d.errors import ParameterError, ShapeError
from seismo3d.features.describing import Features
from seismo3d.features.planar import ImageFeatures

# lowest frequencies of a descriptor around the circle, whose sizes no turn changes
_N_FREQUENCIES = 4
# images that a point votes for, by how much nearer they are than the next one
_N_NEAREST = 4


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Images most like a query, best first.

    Attributes
    ----------
    index : ndarray of shape (k,), int64
        As :meth:`PlaceIndex.add` returned them.
    votes : ndarray of shape (k,), float64
        Larger for what looks more alike; comparable within one query only. Check candidates with ``match``.
    """

    index: Int64Array
    votes: Float64Array

    def __len__(self) -> int:
        return len(self.index)


class PlaceIndex:
    """Described images, kept in a form that finds those alike quickly.

    An image takes 450 bytes a point. A query among 300 images of 150 points takes about as long as describing one.

    Parameters
    ----------
    n_points : int
        Points that are kept of an image, the strongest of each level of its pyramid.

    Examples
    --------
    >>> from skimage import data
    >>> from seismo3d import describe
    >>> index = PlaceIndex()
    >>> for image in (data.camera(), data.coins(), data.page()):
    ...     number = index.add(describe(image))
    >>> int(index.query(describe(data.coins()[20:, 30:].T)).index[0])
    1
    """

    def __init__(self, *, n_points: int = 150) -> None:
        self._n_points = as_whole_number(n_points, "n_points", low=1, high=100_000)
        self._signatures: list[Float32Array] = []
        self._joined: Float32Array | None = None

    def __len__(self) -> int:
        return len(self._signatures)

    def add(self, features: Features) -> int:
        """Keep an image, as :func:`seismo3d.describe` makes it; return its number, counted from zero.

        Raises
        ------
        ParameterError
            If an image is given that was not described.
        ShapeError
            If a volume is given.
        """
        self._signatures.append(_signatures(_of_image(features), self._n_points))
        self._joined = None
        return len(self._signatures) - 1

    def query(self, features: Features, *, n_best: int = 5, until: int | None = None) -> Places:
        """Find the images most like one.

        Parameters
        ----------
        features : Features
            Of the image.
        n_best : int
            At most so many.
        until : int, optional
            Only images with smaller numbers are compared: a moving camera leaves out what it has just seen.

        Returns
        -------
        Places
            Empty where there is nothing to compare.

        Raises
        ------
        ParameterError
            If an image is given that was not described.
        ShapeError
            If a volume is given.
        """
        n = as_whole_number(n_best, "n_best", low=1, high=1e9)
        n_kept = len(self) if until is None else max(0, min(as_whole_number(until, "until"), len(self)))
        asked = _signatures(_of_image(features), self._n_points)
        sizes = np.array([len(s) for s in self._signatures[:n_kept]], dtype=np.int64)
        filled = np.flatnonzero(sizes)
        if filled.size == 0 or len(asked) == 0:
            return Places(np.empty(0, np.int64), np.empty(0))
        if self._joined is None:
            self._joined = np.concatenate(self._signatures)
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])[filled]
        nearest = np.maximum.reduceat(asked @ self._joined[: sizes.sum()].T, starts, axis=1)
        votes = _votes(nearest.astype(np.float64))
        order = np.argsort(-votes, kind="stable")[:n]
        return Places(freeze(filled[order]), freeze(votes[order]))


def _of_image(features: Features) -> ImageFeatures:
    if not isinstance(features, Features):
        raise ParameterError(
            f"features is a {type(features).__name__}; expected what describe gives. Describe the image first: "
            "describe(image)."
        )
    if not isinstance(features.described, ImageFeatures):
        raise ShapeError(f"features are of {features.ndim} axes; expected an image's. Places are images.")
    return features.described


def _signatures(described: ImageFeatures, n_points: int) -> Float32Array:
    """Magnitudes over the shift of the strongest points of each level, (n, d), unit vectors."""
    level = described.view.keypoints.level
    rank = np.arange(len(level)) - np.searchsorted(level, level)  # strongest first within a level
    share = n_points / max(n_points, len(level))
    chosen = np.flatnonzero(rank < np.ceil(share * np.bincount(level)[level])) if len(level) else rank
    spectrum = np.fft.rfft(described.view.descriptors[chosen], axis=1)[:, :_N_FREQUENCIES]
    signature = np.abs(spectrum).reshape(len(chosen), spectrum.shape[1] * spectrum.shape[2])
    length = np.linalg.norm(signature, axis=1)
    return np.asarray(signature[length > 0.0] / length[length > 0.0, None], dtype=np.float32)


def _votes(similarity: Float64Array) -> Float64Array:
    """Votes (p,) from the best similarity of each query point in each image (n, p)."""
    distance = 1.0 - similarity
    n_images = distance.shape[1]
    kth = min(_N_NEAREST, n_images - 1)
    limit = np.partition(distance, kth, axis=1)[:, kth]
    return np.asarray(np.maximum(limit[:, None] - distance, 0.0).sum(axis=0))
