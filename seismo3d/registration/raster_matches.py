"""Matches between the grids that two scans were made from: where the global stage starts when none are given."""

from __future__ import annotations

from seismo3d.errors import ShapeError
from seismo3d.features.matching import Matches, match
from seismo3d.scan import Scan


def match_rasters(target: Scan, source: Scan) -> Matches | None:
    """Match the images, volumes, frames or elevation maps of two scans.

    Parameters
    ----------
    target, source : Scan
        Any scans.

    Returns
    -------
    Matches or None
        Pixels (column, row) on the images, or voxels, which are the scans' own coordinates where those are images or
        volumes. None where a scan has no raster, the rasters are of different kinds or too small, or nothing matches.
    """
    if target.raster is None or source.raster is None or target.raster.kind != source.raster.kind:
        return None
    try:
        found = match(target.raster.values, source.raster.values)
    except ShapeError:  # too small for a window: the scan may still be registered by its points
        return None
    return found if len(found) else None
