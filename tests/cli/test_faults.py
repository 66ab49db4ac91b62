from __future__ import annotations

import json
import sys
import types
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import segyio
from fake_faults import fake_trace_faults, make_cube, make_faults, make_section

from seismo3d.cli import _run
from seismo3d.errors import Seismo3dWarning
from seismo3d.io.cubes import open_cube
from seismo3d.io.segy import write_segy
from seismo3d.io.zarr_store import write_zarr
from seismo3d.seismic.faultset import FaultSet

FILES = {
    "faults.csv",
    "faultset.npz",
    "labels.sgy",
    "likelihood.sgy",
    "report.html",
    "run.json",
    "scene.png",
    "sticks_opendtect.txt",
    "sticks_petrel.txt",
    "strike.png",
    "surfaces.ts",
    "surfaces.vtp",
    "throw.png",
    "throw_map.png",
    "time_slice.png",
}


def use_tracer(monkeypatch: pytest.MonkeyPatch, tracer: Callable[..., Any]) -> None:
    module = types.ModuleType("seismo3d.seismic.faults")
    module.trace_faults = tracer  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "seismo3d.seismic.faults", module)


@pytest.fixture
def demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A SEG-Y cube with two missing and two dead traces; the working folder is its own."""
    use_tracer(monkeypatch, fake_trace_faults)
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    write_segy(work / "demo.sgy", make_cube(), like=None)
    return work / "demo.sgy"


def run(*words: str) -> int:
    return _run(list(words), debug=False)


def test_run_writes_everything(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("faults", "demo.sgy", "-o", "out") == 0
    out = demo.parent / "out"
    names = {entry.name for entry in out.iterdir()}
    assert names - FILES == {name for name in names if name.startswith("section_")}
    assert names >= FILES
    assert len(names - FILES) == 2
    assert {entry.name for entry in demo.parent.iterdir()} == {"demo.sgy", "out"}
    said = capsys.readouterr()
    assert said.out.splitlines()[0] == "2 faults"
    assert said.out.splitlines()[-1] == "out/report.html"
    assert "throw    16.0 mean    24.0 largest (ms)" in said.out


def test_what_the_file_made_odd_is_told(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = bytearray(demo.read_bytes())
    trace_bytes = 240 + 4 * make_cube().shape[2]
    place = 3600 + 3 * trace_bytes + 108
    content[place : place + 2] = (int.from_bytes(content[place : place + 2], "big") + 1).to_bytes(2, "big")
    demo.write_bytes(content)
    assert run("faults", "demo.sgy", "-o", "out", "--json") == 0
    said = capsys.readouterr()
    assert "seismo3d: demo.sgy: traces start at different times" in said.err
    json.loads(said.out)


def test_a_file_without_data_is_refused(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_segy(demo, 0.0 * make_cube(), like=None)
    assert run("faults", "demo.sgy", "-o", "out") == 2
    assert "demo.sgy has no live trace" in capsys.readouterr().err
    assert {entry.name for entry in demo.parent.iterdir()} == {"demo.sgy"}


def test_volumes_are_on_the_input_s_own_geometry_and_headers(demo: Path) -> None:
    run("faults", "demo.sgy", "-o", "out")
    expected = make_faults(make_cube())
    with segyio.open(demo, ignore_geometry=True) as source:
        headers = [dict(header) for header in source.header]
    for name in ("labels", "likelihood"):
        found = open_cube(demo.parent / "out" / f"{name}.sgy")
        live = open_cube(demo)["live"].values
        missing = np.isnan(open_cube(demo).values).all(axis=2)
        values = np.where(missing[:, :, None], np.nan, getattr(expected, name).values.astype(np.float32))
        np.testing.assert_allclose(found.values, values)
        assert live.sum() == 30 * 40 - 4
        with segyio.open(demo.parent / "out" / f"{name}.sgy", ignore_geometry=True) as written:
            assert [dict(header) for header in written.header] == headers


def test_record_lets_a_result_be_traced(demo: Path) -> None:
    run("faults", "demo.sgy", "-o", "out", "--inline-byte", "189")
    record = json.loads((demo.parent / "out" / "run.json").read_text())
    assert record["input"]["file"] == "demo.sgy"
    assert record["input"]["size_bytes"] == demo.stat().st_size
    assert len(record["input"]["sha256"]) == 64
    assert record["options"] == {"inline_byte": 189, "evidence": "both", "attributes": False}
    assert record["settings"]["threshold"] == 0.2
    assert record["n_faults"] == 2
    assert record["geometry"]["axes"]["inline"] == {"first": 100, "last": 158, "step": 2, "n": 30}
    assert {"seismo3d", "python", "numpy", "vtk"} <= set(record["versions"])
    assert list(record["timings_s"]) == ["dips", "scan", "export", "pictures", "report"]
    assert all(seconds >= 0 for seconds in record["timings_s"].values())


def test_evidence_is_handed_on_and_noted(demo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def tracer(cube: Any, *, evidence: str, progress: Any = None) -> FaultSet:
        asked.append(evidence)
        return fake_trace_faults(cube, evidence=evidence, progress=progress)

    use_tracer(monkeypatch, tracer)
    assert run("faults", "demo.sgy", "-o", "out", "--evidence", "registration") == 0
    assert asked == ["registration"]
    assert json.loads((demo.parent / "out" / "run.json").read_text())["options"]["evidence"] == "registration"


def test_unknown_evidence_is_refused_before_any_work(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("faults", "demo.sgy", "-o", "out", "--evidence", "hog") == 2
    assert "evidence is 'hog'; expected one of 'semblance', 'registration', 'both'" in capsys.readouterr().err
    assert not (demo.parent / "out").exists()


def test_fault_set_is_loaded_from_the_folder(demo: Path) -> None:
    run("faults", "demo.sgy", "-o", "out")
    found = FaultSet.load(demo.parent / "out")
    assert len(found.surfaces) == 2
    np.testing.assert_array_equal(found.surfaces[0].throw, make_faults(make_cube()).surfaces[0].throw)
    assert found.labels.dims == ("inline", "crossline", "time")


def test_attributes_are_written_on_request(demo: Path) -> None:
    assert run("faults", "demo.sgy", "-o", "out", "--attributes", "--smooth-tv", "0.05") == 0
    names = {entry.name for entry in (demo.parent / "out").glob("attribute_*.sgy")}
    kinds = ("azimuth", "curvature_most_negative", "curvature_most_positive", "dip", "semblance")
    assert names == {f"attribute_{kind}.sgy" for kind in kinds}
    semblance = open_cube(demo.parent / "out" / "attribute_semblance.sgy").values
    assert 0.9 < np.nanmedian(semblance) <= 1.0


def test_section_runs_through_the_same_command(demo: Path) -> None:
    write_segy(demo.with_name("line.sgy"), make_section()[0], like=None)
    assert run("faults", "line.sgy", "-o", "line") == 0
    names = {entry.name for entry in (demo.parent / "line").iterdir()}
    assert {"surfaces.pl", "section_faults.png", "labels.sgy", "report.html", "run.json"} <= names
    np.testing.assert_array_equal(open_cube("line/labels.sgy").values, make_section()[1].labels.values)


def test_lazy_cube_gives_the_same(demo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run("faults", "demo.sgy", "-o", "whole") == 0
    monkeypatch.setattr("seismo3d.io.cubes.LAZY_ABOVE", 1000)
    assert open_cube(demo).chunks is not None
    assert run("faults", "demo.sgy", "-o", "lazy") == 0
    for name in ("labels.sgy", "surfaces.vtp", "faults.csv", "sticks_petrel.txt"):
        assert Path("lazy", name).read_bytes() == Path("whole", name).read_bytes()
    record = json.loads(Path("lazy", "run.json").read_text())
    assert next(iter(record["timings_s"])) == "live traces"


def test_bare_array_is_a_cube_too(demo: Path) -> None:
    np.save(demo.with_name("cube.npy"), make_cube().values)
    assert run("faults", "cube.npy", "-o", "out") == 0
    found = open_cube("out/labels.sgy")
    np.testing.assert_array_equal(np.nan_to_num(found.values), make_faults(make_cube()).labels.values)
    assert "distances are in bins" in Path("out/report.html").read_text()


def test_existing_folder_is_kept_or_replaced_on_request(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = demo.parent / "out"
    assert run("faults", "demo.sgy", "-o", "out") == 0
    first = (out / "run.json").stat().st_ino
    assert run("faults", "demo.sgy", "-o", "out") == 2
    assert "out exists already. Choose another folder, or replace it with --overwrite." in capsys.readouterr().err
    assert (out / "run.json").stat().st_ino == first
    assert run("faults", "demo.sgy", "-o", "out", "--overwrite") == 0
    assert (out / "run.json").stat().st_ino != first
    assert {entry.name for entry in demo.parent.iterdir()} == {"demo.sgy", "out"}


def test_what_no_run_wrote_is_never_removed(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = demo.parent / "out"
    assert run("faults", "demo.sgy", "-o", "out") == 0
    (out / "notes.txt").write_text("look at fault 3")
    (out / "mine").mkdir()
    assert run("faults", "demo.sgy", "-o", "out", "--overwrite") == 2
    assert "out holds mine and 1 more, which no run there wrote" in capsys.readouterr().err
    assert (out / "notes.txt").read_text() == "look at fault 3"
    (out / "mine").rmdir()
    (out / "notes.txt").unlink()
    # a run made of the old faults goes with them
    (out / "network").mkdir()
    (out / "network" / "run.json").write_text(json.dumps({"command": "network"}))
    assert run("faults", "demo.sgy", "-o", "out", "--overwrite") == 0
    assert not (out / "network").exists()


def test_only_runs_are_ever_replaced(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    precious = demo.parent / "precious"
    precious.mkdir()
    (precious / "thesis.txt").write_text("text")
    assert run("faults", "demo.sgy", "-o", "precious", "--overwrite") == 2
    assert "holds no run.json" in capsys.readouterr().err
    assert run("faults", "demo.sgy", "-o", ".", "--overwrite") == 2
    assert "holds the input" in capsys.readouterr().err
    assert run("faults", "demo.sgy", "-o", "demo.sgy", "--overwrite") == 2
    assert "is a file" in capsys.readouterr().err
    assert run("faults", "demo.sgy", "-o", "no/such/out") == 2
    assert "is not a folder" in capsys.readouterr().err
    assert (precious / "thesis.txt").read_text() == "text"
    assert {entry.name for entry in demo.parent.iterdir()} == {"demo.sgy", "precious"}


@pytest.mark.parametrize("stage", ["trace", "pictures"])
def test_interrupted_run_leaves_nothing(
    demo: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], stage: str
) -> None:
    def interrupt(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    if stage == "trace":
        use_tracer(monkeypatch, interrupt)
    else:
        monkeypatch.setattr("seismo3d.plot.picture_set.save_pictures", interrupt)
    assert run("faults", "demo.sgy", "-o", "out") == 130
    assert "nothing half-written" in capsys.readouterr().err
    assert {entry.name for entry in demo.parent.iterdir()} == {"demo.sgy"}


def test_interrupted_overwrite_keeps_the_old_run(demo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run("faults", "demo.sgy", "-o", "out")
    before = (demo.parent / "out" / "run.json").read_bytes()

    def interrupt(*_: Any, **__: Any) -> Any:
        raise KeyboardInterrupt

    use_tracer(monkeypatch, interrupt)
    assert run("faults", "demo.sgy", "-o", "out", "--overwrite") == 130
    assert (demo.parent / "out" / "run.json").read_bytes() == before
    assert {entry.name for entry in demo.parent.iterdir()} == {"demo.sgy", "out"}


@pytest.mark.parametrize(
    ("content", "message"), [(b"", "bytes"), (b"this is a text file\n" * 300, "sgy"), (None, "does not exist")]
)
def test_bad_input_is_one_line_and_nothing_is_written(
    demo: Path, capsys: pytest.CaptureFixture[str], content: bytes | None, message: str
) -> None:
    if content is not None:
        Path("bad.sgy").write_bytes(content)
    assert run("faults", "bad.sgy", "-o", "out") == 2
    said = capsys.readouterr()
    assert len(said.err.strip().splitlines()) == 1
    assert message in said.err
    assert said.out == ""
    assert not (demo.parent / "out").exists()


def test_smoothing_without_attributes_is_refused(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert demo.exists()
    assert run("faults", "demo.sgy", "-o", "out", "--smooth-tv", "0.1") == 2
    assert "Add --attributes" in capsys.readouterr().err


def test_stages_are_timed_in_order() -> None:
    from seismo3d._stages import StageClock

    seen: list[tuple[str, float]] = []
    clock = StageClock(lambda stage, share: seen.append((stage, share)))
    for stage in ("a", "b", "a"):
        clock(stage, 0.5)
    assert list(clock.stop()) == ["a", "b"]
    assert seen == [("a", 0.5), ("b", 0.5), ("a", 0.5)]


def test_demo_writes_a_cube_that_opens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from seismo3d import synthetic

    make = synthetic.fault_cube
    monkeypatch.setattr(synthetic, "fault_cube", lambda kind, **more: make(kind, shape=(20, 24, 40), **more))
    path = tmp_path / "demo.sgy"
    assert run("demo", "-o", str(path), "--kind", "clean", "--seed", "3") == 0
    assert "20 x 24 x 40 samples" in capsys.readouterr().out
    cube = open_cube(path)
    assert cube.shape == (20, 24, 40)
    assert cube.dims == ("inline", "crossline", "time")
    np.testing.assert_allclose(cube.values, make("clean", seed=3, shape=(20, 24, 40)).seismic)
    assert run("demo", "-o", str(path)) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert run("demo", "-o", str(tmp_path / "x.sgy"), "--kind", "nothing") == 2
    assert "expected one of clean" in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["demo.sgy"]


def test_json_has_the_table_and_the_timings(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("faults", demo.name, "-o", "out", "--json") == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert [row["fault"] for row in found["faults"]] == [1, 2]
    assert found["folder"] == "out"
    assert found["timings_s"] == json.loads(Path("out/run.json").read_text())["timings_s"]
    assert err.startswith("time     ")


def test_unfaulted_cube_is_written_on_request(demo: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("faults", "demo.sgy", "-o", "out", "--unfault") == 0
    found = open_cube(demo.parent / "out" / "unfaulted.sgy")
    assert found.shape == (30, 40, 50)
    # the layers of the two sides agree better across the first fault than before
    cube = open_cube(demo).values
    before, after = (np.abs(v[8:14, 26:30, 12:38] - v[8:14, 10:14, 12:38]).mean() for v in (cube, found.values))
    assert after < 0.8 * before
    assert len(list((demo.parent / "out").glob("unfaulted_*.png"))) == 2
    write_segy(demo.with_name("line.sgy"), make_section()[0], like=None)
    assert run("faults", "line.sgy", "-o", "line", "--unfault") == 2
    assert "for a 2D line" in capsys.readouterr().err


def test_warnings_of_our_own_are_one_line(
    demo: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def trace(cube: Any, **how: Any) -> FaultSet:
        warnings.warn("every other\nline is dead.", Seismo3dWarning, stacklevel=2)
        return fake_trace_faults(cube, **how)

    use_tracer(monkeypatch, trace)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        assert run("faults", str(demo), "-o", "out") == 0
    assert "seismo3d: every other line is dead." in capsys.readouterr().err.splitlines()


@pytest.mark.parametrize("spoil", [{"start": 3276.75}, {"domain": "time", "interval": 40.0}])
def test_what_segy_cannot_hold_is_refused_before_there_is_work(
    demo: Path, spoil: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise AssertionError("work was done")

    use_tracer(monkeypatch, fail)
    monkeypatch.setattr("seismo3d.seismic.time_lapse.align_cubes", fail)
    write_zarr("odd.zarr", open_cube(demo, **spoil))
    for words in (("faults", "odd.zarr"), ("timelapse", "odd.zarr", "odd.zarr")):
        assert run(*words, "-o", "out") == 2
        assert "all that SEG-Y can hold" in capsys.readouterr().err
    assert sorted(path.name for path in demo.parent.iterdir()) == ["demo.sgy", "odd.zarr"]
