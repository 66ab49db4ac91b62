from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import seismo3d as s3
from seismo3d.errors import FileAccessError, ParameterError, Seismo3dWarning, ShapeError
from seismo3d.io.cubes import write_npy
from seismo3d.io.zarr_store import write_zarr
from seismo3d.seismic import faults
from seismo3d.seismic.blocks import sheets
from seismo3d.seismic.blocks.plan import BASE_BYTES, plan_blocks
from seismo3d.seismic.blocks.run import describe_source
from seismo3d.seismic.blocks.store import BrickStore
from seismo3d.seismic.blocks.tracing import forget_work, trace_in_blocks
from seismo3d.seismic.choosing import choose_faults
from seismo3d.seismic.faults import FaultSettings, trace_faults
from seismo3d.seismic.faultset import FaultSet
from seismo3d.synthetic import SyntheticFault, fault_cube
from seismo3d.synthetic.bodies import Channel

SHAPE = (52, 60, 64)
KILLED = """
import os, signal, sys
from pathlib import Path
import numpy as np
from seismo3d.seismic.blocks import run, store
from test_tracing import trace

left = int(sys.argv[2])
def count(kind, name):
    before = getattr(kind, name)
    def call(*given, **named):
        global left
        left -= 1
        if left == 0 and name == "write":
            path = given[0].folder / given[1] / "c" / "0" / "0" / "0"
            if path.exists():
                path.write_bytes(path.read_bytes()[:100])
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return before(*given, **named)
    setattr(kind, name, call)
count(run.BlockRun, "write_part")
count(run.BlockRun, "write_fact")
count(store.BrickStore, "write")
trace(np.load(sys.argv[1]), Path(sys.argv[3]))
"""


def trace(cube, folder, *, settings=None, **options):
    settings = settings or FaultSettings()
    plan = plan_blocks(np.shape(cube), 10**9, settings, edge=32)
    options = {"progress": lambda *_: None} | options
    return trace_in_blocks(cube, plan, settings, folder=folder, **options)


def assert_same(found, wanted):
    for name in ("likelihood", "labels", "throw"):
        np.testing.assert_array_equal(np.asarray(getattr(found, name)), np.asarray(getattr(wanted, name)))
    assert len(found.surfaces) == len(wanted.surfaces)
    for one, other in zip(found.surfaces, wanted.surfaces, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
        np.testing.assert_array_equal(one.throw, other.throw)


def make_cube(noise):
    """A cube with two faults, no data at a corner and at its foot, and traces that repeat."""
    moved = (
        SyntheticFault((26.0, 26.0, 32.0), 40.0, 65.0, 8.0),
        SyntheticFault((20.0, 40.0, 32.0), 130.0, 70.0, -6.0),
    )
    recipe = {"shape": SHAPE, "wavelength": (14.0, 14.0), "population": None, "faults": moved}
    cube = fault_cube("clean", seed=7, noise=noise, **recipe).seismic.copy()
    cube[:6, :9] = np.nan
    cube[:, :, 60:] = 0.0
    cube[40, 28:38] = cube[40, 28]
    return cube


@pytest.fixture(scope="module")
def cube():
    return make_cube(0.1)


@pytest.fixture(scope="module")
def wanted(cube):
    found = trace_faults(cube)
    assert len(found.surfaces) > 0
    return found


@pytest.mark.parametrize(
    ("noise", "evidence"),
    [(0.0, "both"), (0.8, "both"), (0.8, "registration"), (0.8, "semblance")],
)
def test_blocks_give_what_one_piece_gives_to_the_bit(noise, evidence, tmp_path):
    cube = make_cube(noise)
    settings = FaultSettings(evidence=evidence)
    assert_same(trace(cube, tmp_path / "run", settings=settings), trace_faults(cube, settings=settings))


def test_blocks_under_a_mute_give_what_one_piece_gives(tmp_path):
    cube = make_cube(0.1)
    cube[np.arange(64) < 0.5 * np.arange(52)[:, None, None] + np.zeros((52, 60, 1))] = 0.0
    wanted = trace_faults(cube)
    assert len(wanted.surfaces) > 0
    assert_same(trace(cube, tmp_path / "run"), wanted)


def test_blocks_read_alike_what_lies_beyond_the_ends_of_sheets(monkeypatch, tmp_path):
    channel = Channel(24.0, 20.0, (26.0, 30.0), 10.0, (3.0, 40.0, 1.0), 6.0, 1.6, 0.3)
    cube = fault_cube("fault_free", seed=5, shape=(52, 60, 80), channels=(channel,), noise=0.0).seismic
    told = []

    def note(candidates, settings):
        told.append([throw.runs_on for _, throw in candidates])
        return choose_faults(candidates, settings)

    for module in (faults, sheets):
        monkeypatch.setattr(module, "choose_faults", note)
    assert_same(trace(cube, tmp_path / "run"), trace_faults(cube))
    assert told[0] == told[1]
    assert max(told[0]) > 0.8


def test_blocks_of_a_cube_of_uneven_strength_give_what_one_piece_gives(wanted, tmp_path):
    gains = 10.0 ** (np.random.default_rng(5).normal(size=(52, 60, 1)) / 2.0)
    gains[33, 20:24] = 1e-6
    cube = (make_cube(0.1) * 10.0 ** (-np.arange(64) / 32.0) * gains).astype(np.float32)
    cube[:, :, 60:] = 0.0
    cube[::9, ::7, :60] = np.random.default_rng(6).normal(size=(6, 9, 60))
    found = trace_faults(cube)
    assert len(found.surfaces) >= len(wanted.surfaces)
    assert_same(trace(cube, tmp_path / "run"), found)


def test_repeats_of_a_noise_free_cube_are_data_in_blocks_too(tmp_path):
    trace_of_all = np.convolve(np.random.default_rng(2).normal(size=200), np.hanning(9), "same")
    depth = np.arange(64.0) - 8.0 * (np.arange(52) > 25)[:, None, None] + np.zeros((52, 60, 1))
    cube = np.interp(depth, np.arange(-50, 150), trace_of_all).astype(np.float32)
    wanted = trace_faults(cube)
    assert len(wanted.surfaces) == 1
    assert_same(trace(cube, tmp_path / "run"), wanted)


def test_a_lazy_cube_keeps_its_coordinates_and_is_saved_where_it_lies(cube, wanted, tmp_path):
    array = xr.DataArray(
        cube, dims=("inline", "crossline", "time"),
        coords={"inline": 10 + 2 * np.arange(SHAPE[0]), "crossline": np.arange(SHAPE[1]),
                "time": 4.0 * np.arange(SHAPE[2]), "live": (("inline", "crossline"), np.isfinite(cube).any(axis=2))},
    ).chunk({"inline": 20, "crossline": 25, "time": 64})  # fmt: skip
    found = trace(array, tmp_path / "run")
    assert_same(found, wanted)
    assert found.labels.chunks is not None
    np.testing.assert_array_equal(found.labels["inline"], array["inline"])
    assert found.surfaces[0].sample_interval == 4.0
    before = (tmp_path / "run" / "labels.zarr" / "zarr.json").stat().st_ino
    found.save(tmp_path / "run")
    forget_work(tmp_path / "run")
    assert (tmp_path / "run" / "labels.zarr" / "zarr.json").stat().st_ino == before
    back = FaultSet.load(tmp_path / "run")
    assert_same(back, wanted)
    np.testing.assert_array_equal(back.throw["time"], array["time"])
    back.save(tmp_path / "elsewhere")
    assert_same(FaultSet.load(tmp_path / "elsewhere"), wanted)


def test_a_run_killed_at_any_point_goes_on_to_the_same(cube, wanted, tmp_path):
    np.save(tmp_path / "cube.npy", cube)
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])}
    n_killed = 0
    for after in (5, 61, 10**6):
        command = [sys.executable, "-c", KILLED, str(tmp_path / "cube.npy"), str(after), str(tmp_path / "run")]
        code = subprocess.run(command, env=env, check=False).returncode
        assert code in (0, -signal.SIGKILL)
        n_killed += code != 0
    assert n_killed == 2
    assert code == 0
    assert_same(trace(cube, tmp_path / "run"), wanted)


@pytest.mark.parametrize(
    ("damage", "stage"),
    [("missing", "misfit"), ("bytes", "scan"), ("part", "sides")],
)
def test_a_damaged_block_is_computed_again(cube, wanted, tmp_path, damage, stage):
    def spoil(*_):
        work = tmp_path / "run" / "work"
        if (work / "spoiled").exists() or not (work / "facts" / f"done_{stage}.npz").exists():
            return
        (work / "spoiled").touch()
        name = {"dip": "p", "misfit": "q", "scan": "score"}.get(stage, "")
        brick = work / "bricks" / name / "c" / "1" / "0" / "0"
        if damage == "missing":
            brick.unlink()
        elif damage == "bytes":
            content = bytearray(brick.read_bytes())
            content[1000] ^= 255
            brick.write_bytes(content)
        else:
            path = work / "parts" / stage / "000001.npz"
            path.write_bytes(path.read_bytes()[:60])

    stage = {"misfit": "dip"}.get(stage, stage) if damage == "missing" else stage
    assert_same(trace(cube, tmp_path / "run", progress=spoil), wanted)


def test_a_full_disk_is_one_clear_error_and_nothing_is_lost(cube, wanted, tmp_path, monkeypatch):
    n_written = []
    write = BrickStore._write_brick

    def fill_up(store, path, room):
        n_written.append(path)
        if len(n_written) == 9:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(store, path, room)

    with monkeypatch.context() as patch:
        patch.setattr(BrickStore, "_write_brick", fill_up)
        with pytest.raises(FileAccessError, match="cannot be written: No space left on device"):
            trace(cube, tmp_path / "run")
    n_before = len(list((tmp_path / "run" / "work" / "parts").rglob("*.npz")))
    assert n_before > 4
    assert_same(trace(cube, tmp_path / "run"), wanted)


def test_a_finished_run_is_not_done_again_and_what_changed_is_noticed(cube, wanted, tmp_path):
    run = tmp_path / "run"
    assert_same(trace(cube, run), wanted)
    told = []
    (run / "work" / "facts" / "choice.npz").write_bytes(b"damaged")
    assert_same(trace(cube, run, progress=lambda *state: told.append(state)), wanted)
    assert {stage for stage, _ in told} == {"surfaces"}
    other = cube.copy()
    other[30, 30, 30] += 1.0
    with pytest.raises(ParameterError, match=r"the input of the run in .* has changed: samples was"):
        trace(other, run)
    settings = FaultSettings()
    changed = replace(settings, dip=replace(settings.dip, lateral=4.0))
    with pytest.raises(
        ParameterError, match=r"the setting of the run in .* has changed: dip\.lateral was 5\.0, now 4\.0\."
    ):
        trace(cube, run, settings=changed)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "letter.txt").touch()
    with pytest.raises(FileAccessError, match="holds no run in blocks"):
        trace(cube, tmp_path / "other")


def test_a_second_run_in_a_folder_is_refused_and_leaves_the_first_alone(cube, wanted, tmp_path):
    run = tmp_path / "run"
    refused = []

    def start_another(*_):
        if refused:
            return
        aside = run / "work" / "parts" / "scan" / ".000001.npz.1.part"
        aside.parent.mkdir(parents=True, exist_ok=True)
        aside.touch()
        with pytest.raises(FileAccessError, match="is being worked on by another run"):
            trace(cube, run)
        refused.append(aside.exists())

    assert_same(trace(cube, run, progress=start_another), wanted)
    assert refused == [True]
    assert_same(trace(cube, run), wanted)
    assert not list(run.rglob(".*.part"))


def test_memory_decides_and_a_folder_is_needed(cube, wanted, tmp_path, monkeypatch):
    assert isinstance(trace_faults(cube, memory="4GB", folder=tmp_path / "none").labels, np.ndarray)
    assert not (tmp_path / "none").exists()
    with pytest.raises(ParameterError, match="folder is not given"):
        trace_faults(cube, memory="440MB")
    with pytest.raises(ParameterError, match="folder is given without memory"):
        trace_faults(cube, folder=tmp_path / "none")
    monkeypatch.setattr("seismo3d.seismic.blocks.tracing.whole_cube_bytes", lambda _: 2 * 10**9)
    assert_same(trace_faults(cube, memory="1GB", folder=tmp_path / "run"), wanted)


@pytest.mark.parametrize(("work", "takes"), [(s3.trace_faults, 44), (s3.trace_tracks, 9 * 80)])
def test_a_section_that_does_not_fit_is_refused(work, takes):
    section = np.broadcast_to(np.float32(1.0), (3500, 4000))
    needed = f"{(takes * section.size + BASE_BYTES) / 1e9:.2g}"
    with pytest.raises(ParameterError, match=rf"memory is 0.5 GB; a section of .* takes {needed} GB.*in one piece"):
        work(section, memory="0.5GB")
    with pytest.raises(ParameterError, match=r"scheduler is given for a section.*Leave it out"):
        work(section, scheduler="tcp://node1:8786")


def test_what_was_done_to_a_cube_of_a_file_is_noticed(cube, tmp_path):
    axes = [np.arange(n) for n in cube.shape]
    named = dict(zip(("inline", "crossline", "time"), axes, strict=True))
    whole = xr.DataArray(cube, dims=tuple(named), coords=named)
    for name in ("a.sgy", "a.zarr", "a.npy"):
        path = tmp_path / name
        {"a.sgy": s3.write_segy, "a.zarr": write_zarr, "a.npy": write_npy}[name](path, whole)
        stored = s3.open_cube(path, lazy=True)
        own = describe_source(stored)
        assert "file" in own
        assert describe_source(s3.open_cube(path, lazy=True)) == own
        assert describe_source(stored.chunk({"inline": 10})) == own
        part = describe_source(stored[5:40])
        assert "file" in part
        assert part != own
        # what keeps the attributes of the file, as xarray's arithmetic does
        local = stored.where(stored.crossline != 7, 0.0).assign_attrs(stored.attrs)
        for other in (
            stored * 2.0,
            stored[::-1].assign_coords(inline=stored.inline),
            local,
            stored.copy(data=cube + 1),
        ):
            assert other.attrs["path"] == str(path)
            assert describe_source(other) != own
        assert "file" not in describe_source(stored.compute() * 2.0)


def test_what_cannot_be_traced_is_refused_as_in_one_piece(tmp_path):
    refused = {7.0: "cube has no live trace", np.nan: "cube has no live trace", 1e200: "samples up to"}
    for number, (value, words) in enumerate(refused.items()):
        with pytest.raises((ShapeError, ParameterError), match=words):
            trace(np.full(SHAPE, value), tmp_path / str(number))
    lines = np.random.default_rng(0).normal(size=SHAPE)
    lines[::2] = 0.0
    with pytest.warns(Seismo3dWarning, match="0 % of the live traces have a live one on the next inline"):
        trace(lines, tmp_path / "lines")
