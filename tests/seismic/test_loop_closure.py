from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.errors import ShapeError
from seismo3d.plot.run_reports import tracks_page
from seismo3d.plot.track_pictures import loop_map, save_track_pictures
from seismo3d.seismic._kernels_closure import close_loops
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.loop_closure import close_fields, loop_closure, tabulate_loops
from seismo3d.seismic.shifts import ShiftField

SHAPE = (16, 18, 48)
SETTINGS = LayerTimeSettings(lengths=(1, 2), strides=(2, 1))


def layers(depth, *, seed=3):
    """Random reflectivity at each voxel's depth of deposition."""
    values = np.convolve(np.random.default_rng(seed).normal(size=600), np.hanning(9), "same")
    return np.interp(depth, np.arange(-300, 300), values).astype(np.float32)


def grid(shape=SHAPE):
    return np.meshgrid(*(np.arange(n, dtype=np.float64) for n in shape), indexing="ij")


def constant_fields(first, second, *, shape=(8, 9, 6), lengths=(1, 2), variance=1e-3):
    """Shifts that are everywhere alike: `first` samples from an inline to the next, `second` between crosslines."""
    return [
        ShiftField(axis, n, np.full(shape, n * s, np.float32), np.full(shape, variance, np.float32), np.zeros(shape))
        for n in lengths
        for axis, s in enumerate((first, second))
    ]


def closed(fields, cuts=None):
    shape = fields[0].shift.shape
    cuts = np.zeros((*shape[:2], 4 * shape[2]), np.uint8) if cuts is None else cuts
    return close_fields(fields, cuts, settings=SETTINGS)


def test_shifts_of_a_plane_close():
    found = closed(constant_fields(0.7, -0.4))
    assert found.median == pytest.approx(0.0, abs=1e-5)
    assert found.over_one == 0.0
    assert found.length == 2
    assert found.n_loops == 6 * 7 * 6
    assert np.isfinite(found.error[:6, :7]).all()
    assert np.isnan(found.error[6:]).all()
    assert np.isnan(found.error[:, 7:]).all()


def test_one_wrong_shift_opens_the_loops_that_use_it_by_its_error():
    fields = constant_fields(0.7, -0.4)
    fields[2].shift[3, 4] += 1.5
    found = closed(fields)
    # it is the first way of the loop that begins there, and the last of the one two crosslines before
    expected = np.zeros((6, 7))
    expected[3, 4] = expected[3, 2] = 1.5
    np.testing.assert_allclose(found.error[:6, :7], expected, atol=1e-4)
    assert found.over_one == pytest.approx(2 / 42)


def test_loops_that_cross_a_fault_or_a_dead_trace_are_left_out():
    fields = constant_fields(0.0, 0.0)
    cuts = np.zeros((8, 9, 24), np.uint8)
    cuts[4, :, :] = 1
    found = closed(fields, cuts)
    assert np.isnan(found.error[3:5]).all()
    assert np.isfinite(found.error[[0, 1, 2, 5]][:, :7]).all()
    # a shift that was never measured has the largest variance there is
    fields[3].variance[2, 2] = 2 * SETTINGS.shifts.most
    assert np.isnan(closed(fields, cuts).error[2, 2])
    assert np.isnan(closed(fields, cuts).error[0, 2])


def test_no_loop_is_no_number():
    found = closed(constant_fields(0.0, 0.0, variance=10.0))
    assert found.n_loops == 0
    assert np.isnan(found.median)
    assert np.isnan(found.over_one)
    assert np.isnan(found.error).all()
    assert tabulate_loops(found) == {
        "side_traces": 2, "n_loops": 0, "median_error_samples": None, "share_over_one_sample": None,
    }  # fmt: skip
    assert tabulate_loops(None) is None


def test_kernel_follows_shifts_that_change_with_depth(rng):
    n, m, step, length = 5, 4, 3, 2
    far = [rng.normal(size=(n, n, m)).astype(np.float32) for _ in range(2)]
    near = [np.zeros((n, n, m), np.float32) for _ in range(2)]
    error = np.empty((n - length, n - length, m), np.float32)
    close_loops(*far, *near, np.zeros((n, n, m * step), np.uint8), length, step, error)

    def read(row, z):
        return np.interp(z, step * np.arange(m), row)

    for i, j, k in np.ndindex(*error.shape):
        z = k * step
        over = z + read(far[0][i, j], z)
        over += read(far[1][i + length, j], over)
        beside = z + read(far[1][i, j], z)
        beside += read(far[0][i, j + length], beside)
        assert error[i, j, k] == pytest.approx(over - beside, abs=1e-5)


def test_sloping_layers_of_a_cube_close_to_a_hundredth():
    i, x, k = grid()
    found = loop_closure(layers(k - 1.2 * i + 0.6 * x))
    assert found.median < 0.02
    assert found.over_one < 0.01
    assert found.length == 4


def test_noise_does_not_close(rng):
    noise = loop_closure(rng.normal(size=SHAPE).astype(np.float32))
    i, x, k = grid()
    layered = loop_closure(layers(k - 0.3 * i + 0.2 * x))
    assert noise.median > 10 * layered.median


def test_layer_model_has_the_same_figure():
    from seismo3d.seismic.layer_time import model_layers

    i, x, k = grid()
    cube = layers(k - 0.5 * i + 3.0 * np.sin(x / 5.0))
    model, alone = model_layers(cube).closure, s3.loop_closure(cube)
    assert (model.median, model.over_one, model.n_loops) == (alone.median, alone.over_one, alone.n_loops)
    np.testing.assert_array_equal(model.error, alone.error)


def test_refusals():
    with pytest.raises(ShapeError, match="expected \\(inline, crossline, sample\\)"):
        loop_closure(np.zeros((20, 40)))
    with pytest.raises(ShapeError, match="cube has no live trace"):
        loop_closure(np.zeros(SHAPE))
    other = SimpleNamespace(labels=np.zeros((3, 3, 3)), surfaces=())
    with pytest.raises(ShapeError, match="faults are of a cube of shape"):
        loop_closure(np.zeros(SHAPE), faults=other)


def test_report_and_map_tell_the_figures(tmp_path):
    from matplotlib.figure import Figure

    fields = constant_fields(0.7, -0.4)
    fields[2].shift[3, 4] += 1.5
    found = closed(fields)
    cube = np.zeros((8, 9, 24), np.float32)
    axes = loop_map(found, cube, ax=Figure().add_subplot())
    drawn = axes.collections[0].get_array()
    assert drawn.max() == pytest.approx(1.5, abs=1e-4)
    assert drawn.mask.sum() == 8 * 9 - 6 * 7
    with pytest.raises(ShapeError, match=r"closure has shape \(8, 9\)"):
        loop_map(found, np.zeros((4, 4, 8)))
    (file,) = save_track_pictures(tmp_path, cube, [], closure=found)
    assert file.path == tmp_path / "loops.png"
    assert file.path.is_file()
    assert save_track_pictures(tmp_path, cube, []) == []
    page = tracks_page([], cube, title="t", pictures=(), run={"versions": {}, "options": {}}, closure=found)
    assert ("4.8 %", "of the loops miss by more than one sample") in page.numbers
    assert any(name == "Closed loop" for name, _ in page.meanings)
