"""What a depth camera does to depth."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """What a structured-light depth camera does to depth, by default about what the first Kinect does [1]_.

    Attributes
    ----------
    throw : float
        Focal length times baseline, pixel metres: disparity in pixels is ``throw / depth``.
    sigma, step : float
        Noise and step of disparity, pixels. Depth's standard deviation is
        ``depth**2 / throw * sqrt(sigma**2 + step**2 / 12)``.
    least, greatest : float
        Depths beyond which nothing is measured, metres.
    blind, clear : float
        Cosine of incidence below which nothing, and above which everything, comes back.
    jump, lost_edges : float
        Second difference of depth, as a share of depth, that makes an edge, and the share of edge pixels lost.
    lost : float
        Share of all pixels lost.
    colour : float
        Noise of the colour image, grey levels.

    References
    ----------
    .. [1] K. Khoshelham, S. O. Elberink, Sensors 12(2), 1437-1454, 2012. :doi:`10.3390/s120201437`
    """

    throw: float = 43.5
    sigma: float = 0.0625
    step: float = 0.125
    least: float = 0.45
    greatest: float = 6.0
    blind: float = 0.08
    clear: float = 0.25
    jump: float = 0.03
    lost_edges: float = 0.6
    lost: float = 0.005
    colour: float = 2.0

    def settings(self) -> tuple[float, ...]:
        """Return what the compiled model of the sensor reads, in its order."""
        return tuple(getattr(self, field.name) for field in fields(self) if field.name != "colour")


NOISE_FREE = DepthNoise(
    sigma=0.0, step=0.0, least=0.0, greatest=1e6, blind=-1.0, clear=0.0, lost_edges=0.0, lost=0.0, colour=0.0
)
"""A camera that measures every pixel exactly, but for what its projector does not light."""
