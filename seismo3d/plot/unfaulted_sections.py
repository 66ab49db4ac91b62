"""A section today beside the same section with the slip of its faults taken out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from seismo3d.errors import ShapeError
from seismo3d.plot.drawing import check_all_axes
from seismo3d.plot.sections import section


def unfaulted_section(
    cube: Any, unfaulted: Any, *, faults: Any = None, axes: Sequence[Any] | None = None, **where: Any
) -> Any:
    """Draw a section of a cube, with its faults, beside the same section of the unfaulted cube.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube of 3 axes.
    unfaulted : DataArray or ndarray
        What :func:`seismo3d.unfault` made of it.
    faults : FaultSet, optional
        Faults of the cube, drawn on it and coloured by throw.
    axes : two matplotlib Axes, optional
        Where to draw; a new pyplot figure by default.
    **where
        ``inline`` or ``crossline``, and whatever else :func:`section` takes.

    Returns
    -------
    list of matplotlib Axes

    Raises
    ------
    ShapeError
        If the two differ in shape.
    """
    if np.shape(cube) != np.shape(unfaulted):
        raise ShapeError(f"unfaulted has shape {np.shape(unfaulted)}; expected the cube's, {np.shape(cube)}.")
    if axes is None:
        import matplotlib.pyplot as plt

        axes = plt.subplots(1, 2, figsize=(14.0, 5.6), layout="constrained", sharex=True, sharey=True)[1]
    today, before = check_all_axes(axes, 2)
    section(cube, ax=today, faults=faults, **({"colour": "throw"} if faults is not None else {}) | where)
    section(unfaulted, ax=before, **where)
    before.set_title("with the slip taken out", loc="left", fontsize="medium")
    before.set_ylabel("")
    return [today, before]
