"""Plain sheets with plain throws, for tests of what is made of sheets."""

from __future__ import annotations

import numpy as np

from seismo3d.seismic.sheets import Sheet
from seismo3d.seismic.throw import SheetThrow


def candidate(rows=60, columns=40, *, origin=(0.0, 0.0), across=(1.0, 0.0), score=0.6, throw=6.0, fit=0.8, dip=90.0):
    """A sheet of rows traces by 2 * columns samples, upright by default, that begins at `origin`, and its throw."""
    shape = (rows, columns)
    w = np.broadcast_to(2.0 * np.arange(columns) / np.tan(np.radians(dip)), shape).astype(np.float32)
    sheet = Sheet(np.array(origin), np.array(across), 0, 2, 0.0, w, np.full(shape, score, np.float32))
    return sheet, SheetThrow(np.full(shape, throw, np.float32), np.full(shape, fit, np.float32), 1)
