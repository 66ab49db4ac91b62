"""Blocks on the two sides of a fault, matched in layer time."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.seismic._kernels_layers import find_breaks
from seismo3d.seismic.block_links import BlockLinks, label_blocks, match_blocks
from seismo3d.seismic.fault_links import SurfaceGrid, cut_grid

SHAPE, STEP = (40, 40, 96), 4


def vertical_fault(column: float) -> SurfaceGrid:
    """Return a vertical fault between two crosslines, through the whole cube."""
    size = (SHAPE[0], SHAPE[2])
    w = np.full(size, column)
    # rows run against the inlines where the hanging wall lies towards growing crosslines
    return SurfaceGrid(np.array([0.0, 1.0]), (-SHAPE[0] + 1, 0), w, np.ones(size, bool), np.zeros(size))


def layered(rng: np.random.Generator, throw: int) -> np.ndarray:
    """Return level layers, those beyond crossline 20 deeper by a throw."""
    row = np.convolve(rng.normal(size=SHAPE[2] + 80), np.hanning(9), mode="same")
    cube = np.empty(SHAPE, np.float32)
    cube[:, :20] = row[40 : 40 + SHAPE[2]]
    cube[:, 20:] = row[40 - throw : 40 - throw + SHAPE[2]]
    return cube


@pytest.fixture
def blocks() -> tuple[SurfaceGrid, np.ndarray, np.ndarray]:
    cuts = np.zeros(SHAPE, np.uint8)
    grid = vertical_fault(19.5)
    cut_grid(grid, cuts)
    breaks = np.empty((*SHAPE[:2], SHAPE[2] // STEP), np.uint8)
    find_breaks(cuts, STEP, breaks)
    return grid, label_blocks(cuts, breaks, STEP), breaks


def test_a_fault_parts_the_cube(blocks: tuple[SurfaceGrid, np.ndarray, np.ndarray]) -> None:
    _, labels, _ = blocks
    assert len(np.unique(labels)) == 2
    assert (labels[:, :20] == labels[0, 0, 0]).all()
    assert (labels[:, 20:] == labels[0, -1, 0]).all()


@pytest.mark.parametrize("wrong_by", [0.0, 9.0, -14.0])
def test_links_know_the_throw_whatever_the_layer_time(
    rng: np.random.Generator, blocks: tuple[SurfaceGrid, np.ndarray, np.ndarray], wrong_by: float
) -> None:
    grid, labels, breaks = blocks
    throw = 7
    cube = layered(rng, throw)
    values = np.zeros((10, 10, SHAPE[2] // STEP), np.float32)
    values[:, 5:] = -throw + wrong_by  # layer time less sample, beyond the fault
    links = match_blocks(grid, values, labels, breaks, cube, np.ones(SHAPE, bool), stride=4, step=STEP)
    assert len(links.share) > 50
    # on either side, and seen from either side, layers lie deeper beyond the fault by the throw
    sign = np.where(links.first[:, 1] < 20, -1.0, 1.0)
    np.testing.assert_allclose(links.measured * sign, throw, atol=0.3)
    assert ((links.first[:, 1] < 20) != (links.second[:, 1] < 20)).all()
    edges = links.edges(breaks.shape, 2)
    assert len(edges) == len(links.share)
    assert int(edges.first.max()) < 20 * 20 * breaks.shape[2]


def test_noise_is_not_linked(rng: np.random.Generator, blocks: tuple[SurfaceGrid, np.ndarray, np.ndarray]) -> None:
    grid, labels, breaks = blocks
    cube = rng.normal(size=SHAPE).astype(np.float32)
    values = np.zeros((10, 10, SHAPE[2] // STEP), np.float32)
    links = match_blocks(grid, values, labels, breaks, cube, np.ones(SHAPE, bool), stride=4, step=STEP)
    assert len(links.share) == 0
    assert len(BlockLinks.none().edges(breaks.shape, 4)) == 0
