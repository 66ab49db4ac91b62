"""What a depth camera does to depth."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

from seismo3d._settings import Amount, Correlation, Positive, Share, check_fields


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """What a structured-light depth camera does to depth, by default about what the first Kinect does [1]_.

    Attributes
    ----------
    throw : float in (0, inf)
        Focal length times baseline, pixel metres: disparity in pixels is ``throw / depth``.
    sigma, step : float in [0, inf)
        Noise and step of disparity, pixels. Depth's standard deviation is
        ``depth**2 / throw * sqrt(sigma**2 + step**2 / 12)``.
    least, greatest : float in [0, inf), (least, inf)
        Depths beyond which nothing is measured, metres.
    blind, clear : float in [-1, 1], [blind, 1]
        Cosine of incidence below which nothing, and above which everything, comes back.
    jump, lost_edges : float in [0, inf), [0, 1]
        Second difference of depth, as a share of depth, that makes an edge, and the share of edge pixels lost.
    lost : float in [0, 1]
        Share of all pixels lost.
    colour : float in [0, inf)
        Noise of the colour image, grey levels.

    References
    ----------
    .. [1] K. Khoshelham, S. O. Elberink, Sensors 12(2), 1437-1454, 2012. :doi:`10.3390/s120201437`
    """

    throw: Positive = 43.5
    sigma: Amount = 0.0625
    step: Amount = 0.125
    least: Amount = 0.45
    greatest: Annotated[float, "(least, inf)"] = 6.0
    blind: Correlation = 0.08
    clear: Annotated[float, "[blind, 1]"] = 0.25
    jump: Amount = 0.03
    lost_edges: Share = 0.6
    lost: Share = 0.005
    colour: Amount = 2.0

    def __post_init__(self) -> None:
        check_fields(self)

    def settings(self) -> tuple[float, ...]:
        """Return what the compiled model of the sensor reads, in its order."""
        return tuple(getattr(self, field.name) for field in fields(self) if field.name != "colour")


NOISE_FREE = DepthNoise(
    sigma=0.0, step=0.0, least=0.0, greatest=1e6, blind=-1.0, clear=0.0, lost_edges=0.0, lost=0.0, colour=0.0
)
"""A camera that measures every pixel exactly, but for what its projector does not light."""
