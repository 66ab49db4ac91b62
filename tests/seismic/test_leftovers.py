from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic.extending import ExtendSettings
from seismo3d.seismic.leftovers import link_leftovers
from seismo3d.seismic.scan import RidgePoints
from seismo3d.seismic.sheets import Sheet

SHAPE = (40, 48, 32)
STEP = 2


def upright(crossline, *, inlines=range(40), columns=range(32), score=1.0):
    """A sheet along the inline axis at one crossline."""
    w = np.zeros((len(inlines), len(columns)), np.float32)
    origin, across = np.array([0.0, float(crossline)]), np.array([0.0, 1.0])
    # along its strike inlines fall: rows begin at the last one
    return Sheet(origin, across, STEP * columns[0], STEP, -float(inlines[-1]), w, np.full_like(w, score))


def ridges(*planes):
    """Ridge points of upright planes (normal along the axis, place along it, inlines or crosslines, score)."""
    voxels, normals, scores = [], [], []
    for axis, place, run, score in planes:
        along, k = (a.ravel() for a in np.meshgrid(np.array(run), np.arange(SHAPE[2]), indexing="ij"))
        points = np.stack(
            [np.full_like(along, place), along, k] if axis == 0 else [along, np.full_like(along, place), k]
        )
        voxels.append(points.T)
        normals.append(np.tile([1.0 - axis, axis, 0.0], (len(along), 1)))
        scores.append(np.full(len(along), score))
    found, unit, score = np.concatenate(voxels), np.concatenate(normals), np.concatenate(scores)
    order = np.argsort(found[:, 0], kind="stable")
    found = found[order].astype(np.int32)
    positions = (found * np.array([1, 1, STEP])).astype(np.float32)
    return RidgePoints(found, positions, unit[order].astype(np.float32), score[order].astype(np.float32))


def link(sheets, points, **settings):
    return link_leftovers(sheets, points, SHAPE, step=STEP, least_points=50, settings=ExtendSettings(**settings))


CERTAIN = upright(20, score=2.0)
OWN = (1, 20, range(40), 2.0)
PIECE = (0, 12, range(22, 44), 0.2)


def test_a_weak_piece_beside_a_certain_fault_is_linked():
    (piece,) = link([CERTAIN], ridges(OWN, PIECE))
    assert piece.leftover
    points = piece.nodes()
    assert np.abs(points[:, 0] - 12.0).max() < 0.5
    assert points[:, 1].min() == pytest.approx(22, abs=3.0)
    assert points[:, 1].max() == pytest.approx(43, abs=3.0)
    assert np.nanmean(piece.score) == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize(
    ("sheets", "points"),
    [
        ([CERTAIN], ridges(OWN)),
        ([CERTAIN], ridges(OWN, (1, 22, range(40), 0.3))),
        ([CERTAIN], ridges(OWN, (0, 12, range(22, 44), 0.1))),
        ([CERTAIN], ridges(OWN, (0, 12, range(32, 48), 0.3))),
        ([upright(20, score=0.5)], ridges(OWN, PIECE)),
        ([], ridges(OWN, PIECE)),
    ],
    ids=["its own ridges", "its flank", "too weak", "apart", "beside no certain one", "nothing found before"],
)
def test_nothing_else_is(sheets, points):
    assert link(sheets, points) == []


def test_ridges_across_a_certain_fault_are_no_part_of_it():
    (piece,) = link([CERTAIN], ridges(OWN, (0, 12, range(4, 44), 0.2)))
    crosslines = piece.nodes()[:, 1]
    assert crosslines.min() < 6
    assert crosslines.max() > 41


def test_a_sheet_that_is_not_certain_leaves_its_ridges_over():
    weak = upright(26, score=0.3)
    found = link([CERTAIN, weak], ridges(OWN, (1, 26, range(40), 0.3)))
    assert len(found) == 1
    assert np.abs(found[0].nodes()[:, 1] - 26.0).max() < 0.5


def test_how_far_off_a_sheet_its_ridges_lie_is_a_setting():
    points = ridges(OWN, (1, 22, range(40), 0.3))
    (flank,) = link([CERTAIN], points, off_sheet=1.5)
    assert np.abs(flank.nodes()[:, 1] - 22.0).max() < 0.5
