"""Things in a cube that are not faults: layers, channels, an angular unconformity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array


@dataclass(frozen=True, slots=True)
class Channel:
    """A sinuous incised body, filled with other layers.

    Attributes
    ----------
    layer_time, thickness : float
        Layer time of its flat top, and its thickness on the axis; the base is a parabola.
    centre : tuple of float
        A point (inline, crossline) on the axis.
    azimuth_deg : float
        Direction of the axis, from growing inlines towards growing crosslines.
    meander : tuple of float
        Amplitude, wavelength and phase of the axis.
    half_width : float
        Half of the width at the top.
    contrast : float
        Impedance of the fill over that of the layers; their steps have a root mean square of about 1.
    layering : float
        Factor on the layers' steps of impedance inside: 0 for a fill that is all one.
    """

    layer_time: float
    thickness: float
    centre: tuple[float, float]
    azimuth_deg: float
    meander: tuple[float, float, float]
    half_width: float
    contrast: float = -1.5
    layering: float = 0.4

    def row(self) -> Float64Array:
        """Return the channel as the row of numbers that the compiled loops read."""
        angle = np.deg2rad(self.azimuth_deg)
        amplitude, wavelength, phase = self.meander
        wave = (amplitude, 2.0 * np.pi / wavelength, phase)
        direction = (np.cos(angle), np.sin(angle))
        return np.array(
            [
                self.layer_time,
                self.thickness,
                *self.centre,
                *direction,
                *wave,
                self.half_width,
                self.contrast,
                self.layering,
            ]
        )


def channel_rows(channels: tuple[Channel, ...]) -> Float64Array:
    """Stack channels into one array of shape (n, 12)."""
    return np.array([channel.row() for channel in channels]).reshape(len(channels), 12)


def sample_channels(
    rng: np.random.Generator, shape: tuple[int, int, int], n: int, times: Float64Array
) -> tuple[Channel, ...]:
    """Draw channels whose tops lie at layer times met in the cube."""
    ni, nx, _ = shape
    channels = []
    for _ in range(n):
        half_width = rng.uniform(5.0, 16.0)
        channels.append(
            Channel(
                layer_time=float(rng.choice(times)),
                thickness=half_width * rng.uniform(0.5, 1.3),
                centre=(rng.uniform(0.2, 0.8) * ni, rng.uniform(0.2, 0.8) * nx),
                azimuth_deg=rng.uniform(0.0, 180.0),
                meander=(rng.uniform(0.03, 0.14) * nx, rng.uniform(0.4, 0.9) * nx, rng.uniform(0.0, 2.0 * np.pi)),
                half_width=half_width,
                contrast=rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.8),
                layering=rng.uniform(-0.4, 0.8),
            )
        )
    return tuple(channels)


def erosion_rows(
    rng: np.random.Generator, shape: tuple[int, int, int], *, share: float, relief: float, tilt: float
) -> Float64Array:
    """Draw an erosion surface: a plane with Gaussian hills, at a share of the cube's depth.

    Returns
    -------
    ndarray of shape (1 + n, 7), float64
        First row the plane's terms as :class:`~seismo3d.synthetic.folding.Folding` has them, then one Gaussian a row in
        the first four columns.
    """
    ni, nx, ns = shape
    n = 8
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    rows = np.zeros((1 + n, 7))
    rows[0] = (1.0, 0.0, share * ns, tilt * np.cos(azimuth), tilt * np.sin(azimuth), 0.5 * ni, 0.5 * nx)
    rows[1:, :2] = rng.uniform(0.0, 1.0, (n, 2)) * (ni, nx)
    rows[1:, 2] = 0.5 / (rng.uniform(0.08, 0.25, n) * max(ni, nx)) ** 2
    rows[1:, 3] = rng.uniform(-1.0, 1.0, n) * relief
    return rows


def sample_layers(
    rng: np.random.Generator, low: float, high: float, *, spacing: tuple[float, float]
) -> tuple[Float64Array, Float64Array]:
    """Draw layer boundaries between two layer times and the impedance of the layers.

    Impedance wanders and comes back (an autoregressive sequence), so that its steps are nearly white; they come in
    packages: quiet and strong intervals alternate, as in real sequences.

    Returns
    -------
    times : ndarray of shape (n,), float64
        Layer times of the boundaries, growing.
    impedance : ndarray of shape (n + 1,), float64
        Impedance before the first boundary, between boundaries, and after the last; arbitrary units.
    """
    n = int((high - low) / (0.5 * (spacing[0] + spacing[1]))) + 2
    times = low + np.cumsum(rng.uniform(*spacing, n))
    knots = np.arange(low, high + 60.0, 30.0)
    strengths = rng.uniform(-1.0, 1.0, n) * np.sqrt(3.0) * np.interp(times, knots, rng.uniform(0.4, 1.4, len(knots)))
    impedance = np.zeros(n + 1)
    for k in range(n):
        impedance[k + 1] = 0.85 * impedance[k] + strengths[k]
    return times, impedance
