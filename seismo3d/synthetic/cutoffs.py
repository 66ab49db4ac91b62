"""Where the two sides of a synthetic cube's faults that once touched lie today, and where all lay before they moved.

A cube's ``throw`` is that of the fault when it moved, at the place where its surface then was. What can be measured
today is how far a layer in the hanging wall lies from the same layer in the footwall. The two differ where throw
changes down the surface and the footwall moved too, and where later faults have strained an earlier one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array
from seismo3d._validate import as_kind, as_points, freeze
from seismo3d.errors import ShapeError
from seismo3d.synthetic._kernels_cutoffs import find_counterparts, follow_grains, undo_all
from seismo3d.synthetic.cubes import SyntheticCube
from seismo3d.synthetic.faulting import fault_rows


def present_slip(cube: SyntheticCube) -> Float32Array:
    """Vectors from the footwall counterpart to each fault voxel of a cube, as they lie today.

    The counterpart of a voxel is where the footwall grain that touched its hanging-wall grain before the fault moved
    lies now.

    Parameters
    ----------
    cube : SyntheticCube
        A cube, of three axes.

    Returns
    -------
    ndarray of shape (inline, crossline, sample, 3), float32
        Index units; the last component is the throw that can be seen today, in samples, positive where the hanging wall
        is down. NaN off the faults, and on faults older than an unconformity.

    Raises
    ------
    ShapeError
        If the cube is a section.

    Examples
    --------
    >>> from seismo3d.synthetic import fault_cube
    >>> cube = fault_cube("clean", shape=(24, 24, 32), seed=3)
    >>> present_slip(cube).shape
    (24, 24, 32, 3)
    """
    n_old, rows = _faults_that_show(cube)
    voxels = np.argwhere(cube.faults > n_old)
    run: Any = find_counterparts
    slips = run(voxels.astype(np.float64), cube.faults[cube.faults > n_old].astype(np.int64) - n_old - 1, rows)
    out = np.full((*cube.faults.shape, 3), np.nan, np.float32)
    out[tuple(voxels.T)] = slips
    return freeze(out)


def exact_displacement(cube: SyntheticCube) -> Float32Array:
    """Find where each place of a cube, as it was before its faults moved, lies today.

    It is what :func:`seismo3d.seismic.unfaulting.find_slip_field` looks for, but for a motion of the whole.

    Parameters
    ----------
    cube : SyntheticCube
        A cube, of three axes.

    Returns
    -------
    ndarray of shape (3, inline, crossline, sample), float32
        In traces and samples: what lay at place ``x`` is at ``x + displacement`` today. NaN where faults closed up on
        it. Faults older than an unconformity count as not moved.

    Raises
    ------
    ShapeError
        If the cube is a section.
    """
    _, rows = _faults_that_show(cube)
    run: Any = follow_grains
    moves = run(cube.faults.shape, rows)
    return freeze(moves)


def places_before(cube: SyntheticCube, points: Float64Array) -> Float64Array:
    """Find where what lies at points of a cube today lay before its faults moved.

    Parameters
    ----------
    cube : SyntheticCube
        A cube, of three axes.
    points : ndarray of shape (n, 3), float64
        In index coordinates.

    Returns
    -------
    ndarray of shape (n, 3), float64
        The inverse of :func:`exact_displacement`.

    Raises
    ------
    ShapeError
        If the cube is a section.
    """
    run: Any = undo_all
    return np.asarray(run(as_points(points, "points", dim=3), _faults_that_show(cube)[1]))


def _faults_that_show(cube: SyntheticCube) -> tuple[int, Float64Array]:
    """Return how many faults are older than an unconformity, and the others as the kernels take them."""
    as_kind(cube, SyntheticCube, "cube", remedy="Give what fault_cube or make_cube returned.")
    if cube.faults.ndim != 3:
        raise ShapeError(f"cube has faults of shape {cube.faults.shape}; expected three axes. Make it with fault_cube.")
    n_old = sum(fault.buried for fault in cube.fault_list)
    return n_old, fault_rows(cube.fault_list[n_old:])
