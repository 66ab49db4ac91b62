"""Flat panels of the page: a slice as a small PNG, and faults and horizons as SVG paths over it, in index units."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float64Array
from seismo3d.geometry.triangles import cut_mesh
from seismo3d.seismic.faultset import FaultSurface
from seismo3d.seismic.track_pieces import LARGEST_STEP, are_joined
from seismo3d.viewer.colours import Scale, vertex_values
from seismo3d.viewer.interpretation import Fault, Horizon
from seismo3d.viewer.slices import Slice

CMAPS = ("gray", "seismic", "RdGy", "cividis")
HORIZON_COLOURS = ("#ffd54f", "#4fc3f7", "#aed581", "#ff8a65", "#ba68c8")
NO_DATA = (233, 237, 242)
_N_SHADES = 255


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """A fault on a panel.

    Attributes
    ----------
    number : int
        The fault.
    segments : ndarray of shape (s, 2, 2), float64
        Both ends of each segment as (column, row) in index units.
    edges, weights : ndarray
        Of which vertices the points are made, to interpolate values.
    ends : ndarray of shape (s, 2), int64
        Rows of ``edges`` at both ends.
    """

    number: int
    segments: Float64Array
    edges: AnyArray
    weights: Float64Array
    ends: AnyArray

    def means(self, values: AnyArray) -> Float64Array:
        """Mean of a vertex attribute over each segment."""
        low, high = values[self.edges[:, 0]], values[self.edges[:, 1]]
        at = low + self.weights * (high - low)
        mean: Float64Array = at[self.ends].mean(axis=1)
        return mean


def encode_slice(part: Slice, *, limits: tuple[float, float], cmap: str = "gray") -> str:
    """Draw a slice as a PNG in a data URI; one colour of its palette says that there is no data.

    Parameters
    ----------
    part : Slice
        What to draw.
    limits : tuple of float
        Amplitudes that get the strongest colours.
    cmap : str
        A matplotlib colour map.
    """
    from PIL import Image

    values = part.values
    known = np.isfinite(values)
    share = (np.where(known, values, 0.0) - limits[0]) / (limits[1] - limits[0])
    shades = np.clip(share * _N_SHADES, 0, _N_SHADES - 1).astype(np.uint8)
    shades[~known] = _N_SHADES
    rows, columns = shades.shape
    picture = Image.frombytes("P", (columns, rows), shades.tobytes())
    picture.putpalette(_palette(cmap))
    stream = io.BytesIO()
    picture.save(stream, format="PNG", compress_level=1)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()


def _palette(cmap: str) -> bytes:
    from matplotlib import colormaps

    colours = (255.0 * colormaps[cmap]((np.arange(_N_SHADES) + 0.5) / _N_SHADES)[:, :3]).round().astype(np.uint8)
    return colours.tobytes() + bytes(NO_DATA)


def cut_fault(fault: Fault, axis: int, index: float) -> Cut | None:
    """Cut a fault by a slice; None where it misses it."""
    surface = fault.surface
    across = surface.vertices[:, axis]
    if not len(across) or not float(across.min()) <= index <= float(across.max()):
        return None
    cut = cut_mesh(surface.vertices, surface.cells, axis=axis, value=index)
    if not len(cut.segments):
        return None
    kept = np.delete(cut.points, axis, axis=1)
    flat = kept[:, ::-1] if axis == 2 else kept
    return Cut(fault.number, flat[cut.segments], cut.edges, cut.weights, cut.segments)


def fault_paths(cuts: Sequence[Cut], surfaces: dict[int, FaultSurface], scale: Scale) -> list[dict[str, str]]:
    """SVG paths of all faults on a panel, one a colour.

    Parameters
    ----------
    cuts : sequence of Cut
        The faults on the panel.
    surfaces : dict
        By number.
    scale : Scale
        The colours.

    Returns
    -------
    list of dict
        ``d`` and ``stroke``.
    """
    by_class: dict[int, list[Float64Array]] = {}
    for cut in cuts:
        if scale.attribute == "fault":
            classes = np.full(len(cut.segments), cut.number - 1)
        else:
            classes = scale.classify(cut.means(vertex_values(surfaces[cut.number], scale.attribute)))
        for number in np.unique(classes):
            by_class.setdefault(int(number), []).append(cut.segments[classes == number])
    return [
        {"d": segments_path(np.concatenate(parts)), "stroke": scale.shade(number)}
        for number, parts in sorted(by_class.items())
    ]


def segments_path(segments: Float64Array) -> str:
    """SVG path of loose segments; the middle of the first column and row is at one half."""
    return "".join(f"M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}" for a, b, c, d in (segments + 0.5).reshape(-1, 4))


def horizon_path(horizon: Horizon, sample_axis: Any, axis: int, index: int) -> str:
    """SVG path of a horizon on a vertical panel, broken where it jumps; empty on a horizontal one.

    Parameters
    ----------
    horizon : Horizon
        The horizon.
    sample_axis : Axis
        Turns its depths into samples.
    axis, index : int
        The panel.
    """
    if axis == 2:
        return ""
    line = horizon.track.depth[index] if axis == 0 else horizon.track.depth[:, index]
    samples = np.asarray(sample_axis.index(line.astype(np.float64)))
    goes_on = np.insert(are_joined(samples, LARGEST_STEP), 0, False)
    return "".join(
        f"{'L' if goes_on[column] else 'M'}{column + 0.5:.1f} {samples[column] + 0.5:.2f}"
        for column in np.flatnonzero(np.isfinite(samples))
    )


def nearest_fault(cuts: Sequence[Cut], point: Float64Array, *, scale: Float64Array, within: float) -> int | None:
    """Return the number of the fault nearest to a click.

    Parameters
    ----------
    cuts : sequence of Cut
        The faults on the panel.
    point : ndarray of shape (2,)
        (column, row) in index units.
    scale : ndarray of shape (2,)
        Screen size of a column and of a row.
    within : float
        Screen distance beyond which nothing is hit.
    """
    best, least = None, within
    for cut in cuts:
        start = (cut.segments[:, 0] - point) * scale
        way = (cut.segments[:, 1] - cut.segments[:, 0]) * scale
        share = np.clip(-(start * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12), 0.0, 1.0)
        distance = float(np.linalg.norm(start + share[:, None] * way, axis=1).min())
        if distance <= least:
            best, least = cut.number, distance
    return best
