"""An interpretation back into a fault set: labels and throws follow the edited surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from seismo3d._typing import AnyArray, Float32Array, Int32Array
from seismo3d._validate import freeze
from seismo3d.errors import ParameterError
from seismo3d.seismic.faultset import FaultSet, FaultSurface
from seismo3d.viewer.interpretation import Fault, Interpretation

_LARGEST = 2**31
"""Samples of a cube above which volumes of labels are not made in memory."""


def as_faults(cube: Any, state: Interpretation, *, opened: FaultSet | None) -> FaultSet:
    """Make a fault set of an interpretation: surfaces largest first, labels and throws drawn anew where edited.

    A voxel keeps the fault it had; where that one was split, it goes to the part with the nearest vertex; where it was
    deleted, it is cleared. Faults traced in this session are drawn where there is none, or one less likely.

    Parameters
    ----------
    cube : DataArray or ndarray
        The cube.
    state : Interpretation
        Its faults.
    opened : FaultSet or None
        Gives the volumes to start from.

    Returns
    -------
    FaultSet
    """
    faults = in_order(state)
    shape = tuple(int(n) for n in cube.shape)
    if opened is None and int(np.prod(shape)) > _LARGEST:
        raise ParameterError(
            f"the cube has shape {shape}; expected at most {_LARGEST} samples for new label volumes. "
            "Trace it by 'seismo3d faults' first, or open a part of it."
        )
    labels, throw, likelihood = _start_volumes(shape, opened)
    _relabel(labels, throw, faults)
    for number, fault in enumerate(faults, start=1):
        if fault.is_new:
            _draw_new(fault, number, faults, labels, throw, likelihood)
    return FaultSet(
        surfaces=tuple(fault.surface for fault in faults),
        likelihood=_like(cube, likelihood, "likelihood"),
        labels=_like(cube, labels, "labels"),
        throw=_like(cube, throw, "throw"),
        settings=dict(opened.settings) if opened is not None else {},
    )


def in_order(state: Interpretation) -> list[Fault]:
    """Return the faults of an interpretation as they are numbered in files: largest first."""
    return sorted(state.faults, key=lambda fault: -fault.surface.area)


def _start_volumes(shape: tuple[int, ...], opened: FaultSet | None) -> tuple[Int32Array, Float32Array, Float32Array]:
    if opened is None:
        return np.zeros(shape, np.int32), np.full(shape, np.nan, np.float32), np.zeros(shape, np.float32)
    names = ("labels", "throw", "likelihood")
    labels, throw, likelihood = (np.array(getattr(opened, name)) for name in names)
    return labels, throw, likelihood


def _relabel(labels: Int32Array, throw: Float32Array, faults: list[Fault]) -> None:
    """Give every labelled voxel the number of the fault that it belongs to now, in place."""
    owners: dict[int, list[int]] = {}
    for number, fault in enumerate(faults, start=1):
        for source in fault.sources:
            owners.setdefault(source, []).append(number)
    at = np.nonzero(labels)
    old = labels[at]
    new = np.zeros_like(old)
    for source in np.unique(old):
        chosen = old == source
        numbers = owners.get(int(source), [])
        if len(numbers) == 1:
            new[chosen] = numbers[0]
        elif numbers:
            places = np.stack([axis[chosen] for axis in at], axis=1)
            vertices = [faults[number - 1].surface.vertices for number in numbers]
            _, nearest = cKDTree(np.concatenate(vertices)).query(places)
            new[chosen] = np.repeat(numbers, [len(v) for v in vertices])[nearest]
    labels[at] = new
    throw[tuple(axis[new == 0] for axis in at)] = np.nan


def _draw_new(
    fault: Fault, number: int, faults: list[Fault], labels: Int32Array, throw: Float32Array, likelihood: Float32Array
) -> None:
    """Draw a fault that is in no volume yet, in place, where there is none or one less likely."""
    voxels, vertex = _surface_voxels(fault.surface, labels.shape)
    at = tuple(voxels.T)
    confidence = np.array([0.0, *(f.surface.confidence for f in faults)])
    wins = confidence[labels[at]] < np.maximum(fault.surface.confidence, 1e-6)
    at, vertex = tuple(voxels[wins].T), vertex[wins]
    labels[at] = number
    throw[at] = fault.surface.throw[vertex]
    likelihood[at] = np.maximum(likelihood[at], fault.surface.likelihood[vertex])


def _surface_voxels(surface: FaultSurface, shape: tuple[int, ...]) -> tuple[Int32Array, AnyArray]:
    """Voxels that a surface passes through, and the vertex nearest to each."""
    corners = surface.vertices[surface.cells].astype(np.float64)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(initial=1.0)
    n = int(np.ceil(longest / 0.5))
    first, second = (part.ravel() / n for part in np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij"))
    inside = first + second <= 1.0 + 1e-9
    weights = np.stack([first, second, 1.0 - first - second], axis=1)[inside]
    points = np.einsum("wk,tkd->twd", weights, corners).reshape(-1, 3)
    voxels = np.unique(np.rint(points).astype(np.int32), axis=0)
    voxels = voxels[((voxels >= 0) & (voxels < np.array(shape))).all(axis=1)]
    _, vertex = cKDTree(surface.vertices).query(voxels)
    return voxels, np.asarray(vertex)


def _like(cube: Any, values: AnyArray, name: str) -> Any:
    if not hasattr(cube, "dims"):
        return freeze(values)
    kept = cube.drop_vars([key for key, entry in cube.coords.items() if not isinstance(entry.data, np.ndarray)])
    return kept.copy(data=freeze(values)).rename(name)
