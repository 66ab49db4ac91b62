from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, ParameterError, ShapeError
from seismo3d.seismic.blocks.layering import layer_in_blocks, open_layer_time, whole_layers_bytes
from seismo3d.seismic.blocks.plan import BASE_BYTES, Box, layer_needs, plan_blocks
from seismo3d.seismic.blocks.store import BrickStore, DamagedBlock
from seismo3d.seismic.blocks.stored_layers import layers_within
from seismo3d.seismic.blocks.tracing import trace_in_blocks
from seismo3d.seismic.faults import FaultSettings, trace_faults
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.horizon_search import find_horizons
from seismo3d.seismic.layer_graph import LayerTimeSettings
from seismo3d.seismic.layer_time import layer_time, model_layers
from seismo3d.seismic.tracks import trace_tracks
from seismo3d.synthetic import SyntheticFault, fault_cube

SHAPE = (52, 60, 64)
KILLED = """
import os, signal, sys
from pathlib import Path
import numpy as np
from seismo3d.seismic.blocks import run, store
from seismo3d.seismic.faultset import FaultSet
from test_layering import layer

left = int(sys.argv[1])
def count(kind, name):
    before = getattr(kind, name)
    def call(*given, **named):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return before(*given, **named)
    setattr(kind, name, call)
count(run.BlockRun, "write_part")
count(run.BlockRun, "write_fact")
count(store.BrickStore, "write")
folder = Path(sys.argv[2])
layer(np.load(folder / "cube.npy"), FaultSet.load(folder / "faults"), folder / "run")
"""


def layer(cube, faults, folder, *, settings=None, memory=10**9, **options):
    settings = settings or LayerTimeSettings()
    plan = plan_blocks(np.shape(cube), memory, settings, edge=32, needs=layer_needs)
    options = {"progress": lambda *_: None} | options
    run = layer_in_blocks(cube, faults, plan, settings, folder=folder, **options)
    return np.asarray(open_layer_time(run, cube))


@pytest.fixture(scope="module")
def cube():
    """A folded cube with two faults, no data at a corner and at its foot."""
    faults = (
        SyntheticFault((26.0, 26.0, 32.0), 40.0, 65.0, 8.0),
        SyntheticFault((20.0, 40.0, 32.0), 130.0, 70.0, -6.0),
    )
    recipe = {"shape": SHAPE, "wavelength": (14.0, 14.0), "population": None, "faults": faults}
    cube = fault_cube("folded", seed=7, noise=0.1, **recipe).seismic.copy()
    cube[:6, :9] = np.nan
    cube[:, :, 60:] = 0.0
    return cube


@pytest.fixture(scope="module")
def faults(cube):
    found = trace_faults(cube)
    assert len(found.surfaces) > 0
    return found


@pytest.fixture(scope="module")
def whole(cube, faults):
    return model_layers(cube, faults=faults)


@pytest.fixture(scope="module")
def wanted(cube, faults, tmp_path_factory):
    """Layer time in blocks, undisturbed."""
    return layer(cube, faults, tmp_path_factory.mktemp("layers") / "run")


def test_blocks_give_what_one_piece_gives_to_the_bit(cube, faults, wanted):
    np.testing.assert_array_equal(wanted, layer_time(cube, faults=faults))
    assert np.isnan(wanted[:6, :9]).all()
    assert np.isfinite(wanted[6:]).all()


def test_all_that_the_graph_is_made_from_is_that_of_one_piece(cube, faults, whole, tmp_path, monkeypatch):
    from seismo3d.seismic.blocks import layers
    from seismo3d.seismic.layer_time import estimate_slopes, measure_shifts

    found = {}

    def look(run, stride):  # noqa: ARG001 - called by name
        box = Box(0, SHAPE[0], 0, SHAPE[1])
        found["fields"] = [layers.read_field(run, box, number) for number in range(6)]
        found["cuts"] = run.store.read("cuts", box)
        found["loops"] = run.fact("loop_medians")["median"], run.fact("loops")["over"]
        raise KeyboardInterrupt

    monkeypatch.setattr("seismo3d.seismic.blocks.layer_solve.solve", look)
    with pytest.raises(KeyboardInterrupt):
        layer(cube, faults, tmp_path / "run")
    np.testing.assert_array_equal(found["cuts"], whole.cuts)
    assert found["loops"][0] == whole.closure.median
    assert found["loops"][1] == round(whole.closure.over_one * whole.closure.n_loops)
    settings = LayerTimeSettings()
    slopes = estimate_slopes(whole.volume, whole.valid, settings=settings.dip)
    p, q = (np.ascontiguousarray(s[:, :, ::4]) for s in slopes)
    fields = measure_shifts(
        whole.volume, whole.valid, (p, q), cuts=whole.cuts, lengths=settings.lengths, settings=settings.shifts
    )
    for one, other in zip(found["fields"], fields, strict=True):
        for name in ("shift", "variance", "misfit"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_from_disk_and_on_any_threads_the_bits_are_the_same(cube, faults, wanted, tmp_path, monkeypatch):
    import numba

    from seismo3d.seismic.blocks import layer_solve
    from seismo3d.seismic.blocks.room import OnDisk

    monkeypatch.setattr(layer_solve, "_choose_room", lambda run, _: (OnDisk(run.work / "solve"), 2 * 10**6))
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        np.testing.assert_array_equal(layer(cube, faults, tmp_path / "run"), wanted)
    finally:
        numba.set_num_threads(before)
    assert not (tmp_path / "run" / "work" / "solve").exists()


def test_killed_at_any_moment_it_ends_the_same(cube, faults, wanted, tmp_path):
    np.save(tmp_path / "cube.npy", cube)
    (tmp_path / "faults").mkdir()
    faults.save(tmp_path / "faults")
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    for after in (61, 101):
        command = [sys.executable, "-c", KILLED, str(after), str(tmp_path)]
        assert subprocess.run(command, env=env, check=False).returncode == -signal.SIGKILL
    np.testing.assert_array_equal(layer(cube, FaultSet.load(tmp_path / "faults"), tmp_path / "run"), wanted)


def test_a_damaged_block_is_computed_again(cube, faults, wanted, tmp_path):
    spoiled = []

    def spoil(*_):
        work = tmp_path / "run" / "work"
        for name, after in (("shift0_4", "loop_medians"), ("values_4_7", "solve_4"), ("breaks", "solve_2")):
            brick = work / "bricks" / name / "c" / "0" / "0" / "0"
            if name not in spoiled and (work / "facts" / f"done_{after}.npz").exists() and brick.exists():
                spoiled.append(name)
                content = bytearray(brick.read_bytes())
                content[100] ^= 255
                brick.write_bytes(content)

    np.testing.assert_array_equal(layer(cube, faults, tmp_path / "run", progress=spoil), wanted)
    assert len(spoiled) == 3


def test_a_finished_run_is_not_done_again_and_what_changed_is_noticed(cube, faults, wanted, tmp_path):
    run = tmp_path / "run"
    layer(cube, faults, run)
    told = []
    np.testing.assert_array_equal(layer(cube, faults, run, progress=lambda *state: told.append(state)), wanted)
    assert told == [("layers", 1.0)]
    other = cube.copy()
    other[30, 30, 30] += 1.0
    with pytest.raises(ParameterError, match=r"the input of the run in .* has changed: samples was"):
        layer(other, faults, run)
    with pytest.raises(ParameterError, match=r"the input of the run in .* has changed: faults was"):
        layer(cube, None, run)
    moved = tuple(replace(surface, separation=surface.separation + 1) for surface in faults.surfaces)
    with pytest.raises(ParameterError, match=r"the input of the run in .* has changed: faults was"):
        layer(cube, replace(faults, surfaces=moved), run)
    thrown = tuple(replace(surface, throw=surface.throw + 1) for surface in faults.surfaces)
    layer(cube, replace(faults, surfaces=thrown), run)
    with pytest.raises(ParameterError, match=r"has changed: thickness was 0\.3, now 0\.5\."):
        layer(cube, faults, run, settings=replace(LayerTimeSettings(), thickness=0.5))
    with pytest.raises(ParameterError, match=r"the memory of the run in .* has changed"):
        layer(cube, faults, run, memory=2 * 10**9)
    settings = FaultSettings()
    plan = plan_blocks(SHAPE, 10**9, settings, edge=32)
    with pytest.raises(ParameterError, match=r"the kind of the run in .* has changed: was layers, now faults"):
        trace_in_blocks(cube, plan, settings, folder=run, progress=lambda *_: None)
    begun = run / "work" / "plan.json"
    begun.write_text(begun.read_text().replace('"version": 26', '"version": 25').replace('"faults": "', '"faults": "0'))
    with pytest.raises(ParameterError, match=r"the format of the run in .* has changed: was 25, now 26"):
        layer(cube, faults, run)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "letter.txt").touch()
    with pytest.raises(FileAccessError, match="holds no run in blocks"):
        layer(cube, faults, tmp_path / "other")


def test_memory_decides_and_a_folder_is_needed(cube, faults, wanted, tmp_path, monkeypatch):
    assert isinstance(layer_time(cube, faults=faults, memory="4GB", folder=tmp_path / "none"), np.ndarray)
    assert not (tmp_path / "none").exists()
    monkeypatch.setattr("seismo3d.seismic.blocks.layering.whole_layers_bytes", lambda _: 2 * 10**9)
    with pytest.raises(ParameterError, match="folder is not given"):
        layer_time(cube, memory="1GB")
    with pytest.raises(ParameterError, match="folder is given without memory"):
        layer_time(cube, folder=tmp_path / "none")
    with pytest.raises(ShapeError, match="traced in"):
        layer_time(cube[:40], faults=faults, memory="1GB", folder=tmp_path / "none")
    with pytest.raises(ShapeError, match="no live trace"):
        layer_time(np.zeros((40, 40, 64), np.float32), memory="1GB", folder=tmp_path / "none")
    found = layer_time(cube, faults=faults, memory="1GB", folder=tmp_path / "run")
    np.testing.assert_array_equal(np.asarray(found), wanted)


def test_tracks_read_from_disk_are_those_of_one_piece(cube, faults, whole, tmp_path, monkeypatch):
    monkeypatch.setattr("seismo3d.seismic.blocks.layering.whole_layers_bytes", lambda _: 2 * 10**9)
    monkeypatch.setattr("seismo3d.seismic.blocks.stored_layers.whole_layers_bytes", lambda _: 2 * 10**9)
    options = {"faults": faults, "event": "peak"}
    bounds = {"memory": "1GB", "folder": tmp_path / "run"}
    seeds = [(30, 30, 30.0), [(12, 40, 24.0), (45, 20, 22.0)]]
    found = trace_tracks(cube, seeds, **options, **bounds)
    stored = layers_within(
        cube, faults, **bounds, scheduler=None, settings=LayerTimeSettings(), progress=lambda *_: None
    )
    assert len(stored.times.places) > 1
    same = trace_tracks(cube, seeds, **options, layers=whole)
    assert all(track.share > 0.5 for track in same)
    for one, other in zip(found, same, strict=True):
        np.testing.assert_array_equal(one.depth, other.depth)
        np.testing.assert_array_equal(one.confidence, other.confidence)
    assert stored.closure.n_loops == whole.closure.n_loops
    np.testing.assert_array_equal(stored.closure.error, whole.closure.error)
    best = trace_tracks(cube, count=2, faults=faults, **bounds)
    in_memory = find_horizons(cube, 2, faults=faults, layers=whole)
    for one, other in zip(best, in_memory, strict=True):
        np.testing.assert_array_equal(one.depth, other.depth)
    with pytest.raises(ParameterError, match="layers is given with memory"):
        trace_tracks(cube, seeds, layers=whole, memory="1GB")


# the highest mark of a process's own memory: what getrusage tells begins with that of the process it was forked from
PEAK = """
import sys
from pathlib import Path
import numpy as np
from seismo3d.seismic.layer_time import layer_time

def peak(shape, folder):
    rng = np.random.default_rng(1)
    trace = np.convolve(rng.normal(size=shape[2]), np.hanning(9), "same").astype(np.float32)
    cube = np.broadcast_to(trace, shape) + 0.1 * rng.standard_normal(shape, dtype=np.float32)
    np.save(Path(folder).with_suffix(".npy"), cube)
    del cube
    bounds = {} if sys.argv[2] == "any" else {"memory": sys.argv[2], "folder": folder}
    layer_time(np.load(Path(folder).with_suffix(".npy"), mmap_mode="r"), **bounds)
    marks = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return 1024 * int(marks["VmHWM"].split()[0])

import seismo3d.seismic.blocks.layering as layering
layering.whole_layers_bytes = lambda shape: 2**40
before = peak((16, 16, 64), sys.argv[1] + "/small")
print(before, peak((128, 136, 128) if len(sys.argv) == 3 else (40, 40, 64), sys.argv[1] + "/large"))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from Linux's /proc")
def test_memory_stays_within_what_is_given(tmp_path):
    """In blocks a cube takes little more than a small one does; in one piece it takes its size's share."""
    memory = 470_000_000
    assert whole_layers_bytes((128, 136, 128)) - BASE_BYTES > 3 * (memory - BASE_BYTES)
    grown = {}
    # the first run compiles what is not in the cache yet, which takes memory of its own
    for name, given in (("first", memory), ("blocks", memory), ("whole", "any")):
        (tmp_path / name).mkdir()
        command = [
            sys.executable,
            "-c",
            PEAK,
            str(tmp_path / name),
            str(given),
            *(["small"] if name == "first" else []),
        ]
        found = subprocess.run(command, capture_output=True, text=True, check=True)
        before, peak = (int(word) for word in found.stdout.split())
        assert peak < memory or name == "first"
        grown[name] = peak - before
    assert grown["blocks"] < 0.6 * grown["whole"]


def test_a_brick_of_zeros_is_stored_and_one_of_none_is_missed(tmp_path):
    store = BrickStore(tmp_path, 8)
    for kind in (np.float32, np.uint8, bool):
        name = np.dtype(kind).name
        store.make(name, (16, 8, 4), kind, packed=kind is np.uint8)
        store.write(name, Box(0, 8, 0, 8), np.zeros((8, 8, 4), kind))
        again = BrickStore(tmp_path, 8)
        assert not again.read(name, Box(0, 8, 0, 8)).any()
        with pytest.raises(DamagedBlock):
            again.read(name, Box(0, 16, 0, 8))
