"""Frames that are kept, packed, so that the map can be made anew from corrected poses."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.robot.frames import Measured, Measurer


@dataclass(frozen=True, slots=True, eq=False)
class KeptFrame:
    """A located frame, packed without loss of depth beyond a tenth of a millimetre.

    Attributes
    ----------
    pose : int
        Its row among the located frames.
    camera : int
    depth : ndarray of shape (n,), uint8
        PNG of the depth that was fused, tenths of a millimetre, 0 where nothing was.
    colour : ndarray of shape (n,), uint8
        JPEG of the colour at each depth pixel; empty without colour.
    """

    pose: int
    camera: int
    depth: AnyArray
    colour: AnyArray

    @classmethod
    def of(cls, measured: Measured, pose: int, camera: int) -> KeptFrame:
        """Pack a measured frame; pixels without weight are left out."""
        tenths = np.minimum(measured.depth * np.float32(1e4) + np.float32(0.5), np.float32(65535.0))
        tenths *= measured.trusted
        depth = cv2.imencode(".png", tenths.astype(np.uint16))[1].ravel()
        colour = np.empty(0, dtype=np.uint8)
        if measured.colour.size:
            colour = cv2.imencode(".jpg", measured.colour, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].ravel()
        return cls(pose, camera, depth, colour)

    def unpacked(self, measurer: Measurer) -> Measured:
        """Return the frame as it was fused."""
        depth = np.asarray(cv2.imdecode(self.depth, cv2.IMREAD_UNCHANGED)).astype(np.float32) * np.float32(1e-4)
        colour = np.zeros((0, 0, 3), dtype=np.uint8)
        if self.colour.size:
            colour = np.where(
                depth[:, :, None] > 0.0, np.asarray(cv2.imdecode(self.colour, cv2.IMREAD_COLOR)), 0
            ).astype(np.uint8)
            colour = np.where((depth[:, :, None] > 0.0) & (colour == 0), np.uint8(1), colour)
        return measurer.measured(depth, colour)

    @property
    def n_bytes(self) -> int:
        """Memory that it takes."""
        return self.depth.size + self.colour.size
