"""Parts of a layer, as faults and necks bound them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from seismo3d.seismic.layer_parts import PartSettings, PartWaves, label_parts, place_once

SHAPE = (30, 64)


def joined_blocks(width: int) -> np.ndarray:
    """Crossings of two blocks of 30 x 30 traces with a gap of four, bridged by some inlines."""
    crossings = np.full((1, *SHAPE), np.nan)
    crossings[0, :, :30] = crossings[0, :, 34:] = 20.0
    crossings[0, 3 : 3 + width] = 20.0
    return crossings


def no_cuts() -> np.ndarray:
    return np.zeros((*SHAPE, 40), np.uint8)


@pytest.mark.parametrize("width", [1, 3, 4])
def test_blocks_that_a_neck_joins_are_two_parts(width: int) -> None:
    parts = label_parts(joined_blocks(width), no_cuts())[0]
    assert len(np.unique(parts[parts >= 0])) == 2
    assert len(np.unique(parts[:, :30])) == len(np.unique(parts[:, 34:])) == 1
    # each trace of the neck belongs to the nearer block
    assert (parts[3 : 3 + width, 30:32] == parts[0, 0]).all()
    assert (parts[3 : 3 + width, 32:34] == parts[0, -1]).all()


@pytest.mark.parametrize("width", [0, 5, 30])
def test_blocks_apart_or_widely_joined(width: int) -> None:
    parts = label_parts(joined_blocks(width), no_cuts())[0]
    assert len(np.unique(parts[parts >= 0])) == (2 if width == 0 else 1)
    assert ((parts >= 0) == np.isfinite(joined_blocks(width)[0])).all()


def test_a_narrow_part_is_whole() -> None:
    crossings = np.full((1, *SHAPE), np.nan)
    crossings[0, 10:13] = 20.0
    parts = label_parts(crossings, no_cuts())[0]
    assert len(np.unique(parts[parts >= 0])) == 1


def test_a_block_with_a_narrow_arm_is_whole() -> None:
    crossings = joined_blocks(3)
    crossings[0, :, 40:] = np.nan
    crossings[0, 6:, 34:] = np.nan
    parts = label_parts(crossings, no_cuts())[0]
    assert len(np.unique(parts[parts >= 0])) == 1


def test_a_fault_bounds_parts() -> None:
    cuts = no_cuts()
    cuts[:, 20, 20] = 2  # before the next crossline
    parts = label_parts(np.full((1, *SHAPE), 20.0), cuts)[0]
    assert len(np.unique(parts)) == 2
    assert (parts[:, :21] == parts[0, 0]).all()
    assert (parts[:, 21:] == parts[0, -1]).all()


def move_of_second(rng: np.random.Generator, known: str, settings: PartSettings) -> float:
    """How far a part is moved that fits fairly where it is and by .2 to .3 better, at .87, ten samples off."""
    reach = settings.window + 2 * settings.farthest
    t = np.arange(-reach, reach + 1)
    reference = gaussian_filter1d(rng.normal(size=len(t) + 20), 1.5)
    part = 0.5 * reference[10:-10] + 0.87 * reference[20:]
    counts = np.full((2, len(t)), 100.0)
    if known == "above":
        counts[:, t > 0] = 0.0
    sums = counts * np.stack([reference[10:-10], part])
    waves = PartWaves(np.stack([sums, sums]), np.stack([counts, counts]), np.array([100, 100]))
    share = waves.known(settings.window)
    np.testing.assert_allclose(share, 1.0 if known == "all" else 33 / 65)
    moves, _ = place_once(waves, np.zeros(2), np.array([1.0, 0.0], np.float32), np.array([0]), settings)
    assert moves[0] == 0.0
    return float(moves[1])


@pytest.mark.parametrize(("known", "wary", "moved"), [("all", 1.0, True), ("above", 0.0, True), ("above", 1.0, False)])
def test_a_waveform_that_is_cut_short_must_gain_more_to_be_moved(
    rng: np.random.Generator, known: str, wary: float, moved: bool
) -> None:
    move = move_of_second(rng, known, PartSettings(wary=wary))
    # where it does not gain enough it stays within three samples of where it was
    assert -10.6 <= move <= -9.4 if moved else abs(move) <= 3.5


@pytest.mark.parametrize(("surely", "moved"), [(0.8, True), (0.95, False)])
def test_a_part_must_fit_well_to_be_moved_far(rng: np.random.Generator, surely: float, moved: bool) -> None:
    move = move_of_second(rng, "all", PartSettings(surely=surely))
    assert -10.6 <= move <= -9.4 if moved else abs(move) <= 3.5
