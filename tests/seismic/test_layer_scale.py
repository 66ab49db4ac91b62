"""Layer time keeps the scale of its samples."""

from __future__ import annotations

import numpy as np
import pytest

from seismo3d.graph.scalars import ScalarEdges
from seismo3d.seismic.layer_graph import LayerTimeSettings, smooth_thickness
from seismo3d.seismic.layer_system import LayerSystem, LinkFields
from seismo3d.seismic.layer_time import model_layers
from seismo3d.seismic.linking import InMemory
from seismo3d.synthetic import fault_cube

SHAPE, STEP = (24, 30, 40), 4


def system(*, at_a_time: int = 2**62) -> LayerSystem:
    breaks = np.zeros(SHAPE, np.uint8)
    fields = LinkFields.empty([(0, 1), (1, 1)], SHAPE, InMemory())
    return LayerSystem.of(fields, breaks, ScalarEdges.none(), InMemory(), step=STEP, bytes_at_a_time=at_a_time)


def layers() -> np.ndarray:
    """Layer times in samples, of level layers that dip by half a sample a trace."""
    i, _, k = np.indices(SHAPE)
    return STEP * k - 0.5 * i


def drawn_out(times: np.ndarray, **given: int) -> np.ndarray:
    depth = STEP * np.arange(SHAPE[2])
    values = (times - depth).astype(np.float32)
    return system(**given).measure_scale(values).draw_out(values) + depth


@pytest.mark.parametrize("shrunken", [lambda t: 0.1 * t, lambda t: 3.0 * t + 20.0, lambda t: 40.0 * np.tanh(t / 90.0)])
def test_any_growing_function_of_layer_time_is_taken_back(shrunken) -> None:  # type: ignore[no-untyped-def]
    truth = layers()
    found = drawn_out(shrunken(truth))
    inner = (truth > 0.0) & (truth < truth[-1].max())
    np.testing.assert_allclose((found - found[0, 0, 4] + truth[0, 0, 4])[inner], truth[inner], atol=1.5)


def test_what_is_to_scale_stays_as_it_is() -> None:
    truth = layers()
    np.testing.assert_allclose(drawn_out(truth), truth, atol=0.01)


def test_a_part_at_a_time_gives_the_same_bits() -> None:
    rng = np.random.default_rng(5)
    times = 0.3 * layers() + rng.normal(0.0, 0.5, SHAPE)
    np.testing.assert_array_equal(drawn_out(times), drawn_out(times, at_a_time=200_000))


def test_layer_time_that_nothing_tells_stays_as_it_is() -> None:
    np.testing.assert_array_equal(drawn_out(np.zeros(SHAPE) + 7.0)[:, :, 0], 7.0)


@pytest.mark.parametrize("noise", [0.0, 0.8])
def test_layer_time_is_told_in_samples_whatever_the_noise(noise: float) -> None:
    cube = fault_cube("fault_free", seed=4, shape=(48, 48, 96), noise=noise)
    growth = np.diff(model_layers(cube.seismic).times, axis=2)
    assert growth.mean() == pytest.approx(1.0, abs=0.1)


def test_what_layers_are_expected_to_measure_is_to_scale() -> None:
    """However far all has drawn together in the rounds before, thickness is one sample a sample on the mean."""
    settings = LayerTimeSettings()
    depth = STEP * np.arange(SHAPE[2])
    values = (0.05 * layers() - depth).astype(np.float32)
    drawn = system().measure_scale(values).draw_out(values)
    thickness = smooth_thickness(drawn, np.zeros(SHAPE, np.uint8), settings, 1)
    np.testing.assert_allclose(thickness[4:-4, :, 4:-4], 0.0, atol=0.1 * STEP)
