"""Frames that are kept, packed, so that the map can be made anew from corrected poses."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.robot import _kernels_kept as kernels
from seismo3d.robot.frames import Measured, Measurer


@dataclass(frozen=True, slots=True, eq=False)
class KeptFrame:
    """A located frame, packed without loss of depth beyond a tenth of a millimetre.

    Attributes
    ----------
    pose : int
        Its row among the located frames.
    camera : int
    shape : (int, int)
        Rows and columns.
    depth : ndarray of shape (n,), uint8
        Tenths of a millimetre of the depth that was fused, as :mod:`seismo3d.robot._kernels_kept` packs them.
    colour : ndarray of shape (n,), uint8
        JPEG of the colour at each depth pixel that was fused; empty without colour.
    """

    pose: int
    camera: int
    shape: tuple[int, int]
    depth: AnyArray
    colour: AnyArray

    @classmethod
    def of(cls, measured: Measured, pose: int, camera: int) -> KeptFrame:
        """Pack a measured frame; pixels without weight are left out."""
        room = np.empty(kernels.MOST_BYTES * measured.depth.size, dtype=np.uint8)
        size = kernels.pack_depth(measured.depth.reshape(-1), measured.pixels, room)
        colour = np.empty(0, dtype=np.uint8)
        if measured.has_colour:
            colour = cv2.imencode(".jpg", measured.colour, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].ravel()
        rows, columns = measured.depth.shape
        return cls(pose, camera, (rows, columns), room[:size].copy(), colour)

    def unpacked(self, measurer: Measurer) -> Measured:
        """Return the frame as it was fused.

        Raises
        ------
        ValueError
            If it is damaged.
        """
        depth = np.empty(self.shape, dtype=np.float32)
        if not kernels.unpack_depth(self.depth, depth.reshape(-1)):
            raise ValueError(f"the depth of a kept frame does not fill its {depth.size} pixels")
        colour = np.zeros((0, 0, 3), dtype=np.uint8)
        if self.colour.size:
            colour = np.asarray(cv2.imdecode(self.colour, cv2.IMREAD_COLOR))
        return measurer.measured(depth, colour)

    @property
    def n_bytes(self) -> int:
        """Memory that it takes."""
        return self.depth.size + self.colour.size
