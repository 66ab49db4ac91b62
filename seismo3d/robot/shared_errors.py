r"""What the pixels of a frame have wrong together, and what that does to its pose.

The noise of thousands of pixels averages out; what neighbours have in common does not: depth that waves with range,
steps of disparity, a lens bent otherwise than stated. So the weighed residuals' pull on the pose is summed over blocks
of the image. Where pixels are independent, the blocks' sums :math:`g_b` scatter as the pairs' own :math:`g_i` say; what
they scatter more is common to many pixels [1]_,

.. math:: S = C \, \Bigl( \frac{n}{n - 6} \sum_b g_b g_b^\top - \sum_i g_i g_i^\top \Bigr)_{\!+} C,

with the registration's covariance :math:`C` and :math:`n` blocks, of which the fit has taken six degrees of freedom.
The same error is there in the next frame, so that it adds up along the way.

Some errors leave no residuals behind. A map whose depth is too small by a hundredth is a smaller map, and one made with
too long a focal length is bent as it is made. They are the lens's: each is one number that all frames share, and how a
pose moves with it follows from the geometry of its pairs, relative to the view that the map was made from there.

References
----------
.. [1] H. White, Econometrica 48(4), 817-838, 1980. :doi:`10.2307/1912934`
"""

from __future__ import annotations

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.camera import PinholeCamera
from seismo3d.geometry.rotations import adjoint, make_transform
from seismo3d.robot import _kernels_shared as kernels
from seismo3d.robot.landmarks import Sightings, View
from seismo3d.robot.pose_errors import PoseErrors
from seismo3d.robot.tracking import Located

_PARAMETERS = 6
_NO_PLANES = (np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0))
_LEAST = 1e-9
"""Share of the largest information below which nothing is known."""


def find_shared_errors(
    located: Located, seen: Sightings, views: list[View], base: View, lens: PinholeCamera
) -> PoseErrors:
    """Return the errors that a located frame's pixels share.

    Parameters
    ----------
    located : Located
    seen : Sightings
        That it was located by.
    views : list of View
        Of the map.
    base : View
        From about which the map has the surfaces that are seen.
    lens : PinholeCamera

    Returns
    -------
    PoseErrors
        Of the pose against the base, but for noise; none along what is blind, and where next to nothing is known.
    """
    T, pairs = located.T_world_camera, located.planes
    planes = _NO_PLANES if pairs is None else (pairs.source, pairs.normals, pairs.weights, pairs.residuals)
    T_views = np.array([views[k].T_world_camera for k in seen.names[:, 0]]).reshape(-1, 4, 4)
    marks = (seen.points, T_views, seen.T_depth_pixel, seen.rays, located.landmark_weights)
    numbers = np.array([lens.fx, lens.fy, lens.cx, lens.cy, lens.width, lens.height], dtype=np.float64)
    H, blocks, own, pulled = kernels.gather_shared(T, base.T_world_camera, planes, marks, numbers)
    to_world = adjoint(make_transform(np.eye(3), T[:3, 3]))
    root = _root_of_covariance(H, located.blind @ np.linalg.inv(to_world).T)
    if root is None:
        return PoseErrors()
    n_blocks = int(np.count_nonzero(blocks.any(axis=1)))
    common = blocks.T @ blocks * (n_blocks / max(n_blocks - _PARAMETERS, 1)) - own
    values, vectors = np.linalg.eigh(root.T @ common @ root)
    out = to_world @ root
    shared = (out @ vectors) * np.sqrt(np.maximum(values, 0.0))
    return PoseErrors(alike=shared @ shared.T, by_lens=out @ (root.T @ pulled))


def _root_of_covariance(H: Float64Array, blind: Float64Array) -> Float64Array | None:
    """Return a root (6, 6 - k) of the covariance of what is known beside what is blind (k, 6); None of next to none."""
    seen = np.linalg.qr(blind.T, mode="complete")[0][:, len(blind) :]
    values, vectors = np.linalg.eigh(seen.T @ H @ seen)
    if values.size == 0 or not values[0] > _LEAST * values[-1]:
        return None
    return np.asarray(seen @ vectors / np.sqrt(values))
