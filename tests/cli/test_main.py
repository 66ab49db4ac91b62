from __future__ import annotations

import json
import signal
import subprocess
import sys

import numpy as np
import pytest

import seismo3d as s3
from seismo3d.cli import main


@pytest.fixture
def segy(tmp_path):
    cube = s3.as_cube(np.arange(60, dtype=np.float32).reshape(3, 4, 5), interval=4.0, start=100.0)
    xy = np.meshgrid(np.arange(3), np.arange(4), indexing="ij")
    dims = ("inline", "crossline")
    cube = cube.assign_coords(inline=[10, 12, 14], cdp_x=(dims, 25.0 * xy[1]), cdp_y=(dims, 50.0 * xy[0]))
    return s3.write_segy(tmp_path / "in.sgy", cube)


@pytest.fixture
def run(capsys):
    before = signal.getsignal(signal.SIGTERM)

    def call(*words):
        with pytest.raises(SystemExit) as left:
            main([str(word) for word in words])
        out, err = capsys.readouterr()
        return left.value.code, out, err

    yield call
    signal.signal(signal.SIGTERM, before)


def test_info_says_what_there_is(run, segy):
    code, out, err = run("info", segy)
    assert (code, err) == (0, "")
    for words in (
        "cube, SEG-Y, 3 x 4 x 5, float32",
        "10 to 14, step 2, 3 of them",
        "100 to 116 ms, step 4 ms",
        "IEEE float, 4 bytes, big-endian",
        "12 traces, inline-sorted",
        "inline 189, crossline 193 (the standard ones)",
        "0 to 59, mean 29.5",
        "0 missing, 0 dead, 0 duplicate",
        "50 m from inline to inline, 25 m from crossline to crossline",
        "inlines grow towards 0.00 deg from north, crosslines towards 90.00; right-handed",
    ):
        assert words in out


def test_info_tells_line_numbers_of_seven_digits_in_full(run, tmp_path):
    cube = s3.as_cube(np.ones((2, 3, 5), np.float32), interval=4.0).assign_coords(inline=[1234001, 1234002])
    assert "1234001 to 1234002, step 1" in run("info", s3.write_segy(tmp_path / "a.sgy", cube))[1]


def test_info_says_where_traces_have_no_order(run, segy, tmp_path):
    raw = segy.read_bytes()
    size = (len(raw) - 3600) // 12
    traces = [raw[k : k + size] for k in range(3600, len(raw), size)]
    mixed = tmp_path / "mixed.sgy"
    mixed.write_bytes(raw[:3600] + b"".join(traces[5 * k % 12] for k in range(12)))
    assert "12 traces, in no order" in run("info", mixed)[1]


def test_info_as_json(run, segy):
    code, out, _ = run("info", segy, "--json", "--domain", "depth")
    got = json.loads(out)
    assert code == 0
    assert (got["shape"], got["domain"], got["segy"]["inline_byte"]) == ([3, 4, 5], "depth", 189)


def test_info_of_a_line_and_of_numpy(run, tmp_path):
    line = s3.as_cube(np.ones((3, 4)), interval=2.0).assign_coords(
        cdp_x=("trace", [0, 3, 6]), cdp_y=("trace", [0, 4, 8])
    )
    out = run("info", s3.write_segy(tmp_path / "l.sgy", line))[1]
    assert "10 m along the line" in out
    assert "3 traces, in one line" in out
    np.save(tmp_path / "a.npy", np.full((2, 3, 4), np.nan))
    code, out, _ = run("info", tmp_path / "a.npy")
    assert code == 0
    assert "no sample with a value" in out
    assert "no map coordinates" in out


def test_one_of_several_arrays_is_named(run, tmp_path):
    np.savez(tmp_path / "a.npz", first=np.zeros((2, 3, 4)), second=np.full((2, 3, 5), 7.0))
    code, _, err = run("info", tmp_path / "a.npz")
    assert code == 2
    assert "Name it by variable (--variable)." in err
    assert "2 x 3 x 5" in run("info", tmp_path / "a.npz", "--variable", "second")[1]
    assert run("convert", tmp_path / "a.npz", tmp_path / "b.npy", "--variable", "second")[0] == 0
    assert np.load(tmp_path / "b.npy")[0, 0, 0] == 7.0


@pytest.mark.parametrize("name", ["a.npy", "a.zarr"])
def test_segy_of_a_file_without_an_interval_needs_one(run, tmp_path, name):
    values = np.arange(24.0).reshape(2, 3, 4)
    np.save(tmp_path / "a.npy", values)
    if name == "a.zarr":
        assert run("convert", tmp_path / "a.npy", tmp_path / "a.zarr")[0] == 0
    code, _, err = run("convert", tmp_path / name, tmp_path / "b.sgy")
    assert code == 2
    assert f"{name} states no sample interval; expected one, which SEG-Y needs. Give interval (--interval)" in err
    assert not (tmp_path / "b.sgy").exists()
    asked = ("--interval", "5", "--start", "100", "--domain", "depth")
    assert run("convert", tmp_path / name, tmp_path / "b.sgy", *asked)[0] == 0
    back = s3.open_cube(tmp_path / "b.sgy")
    np.testing.assert_array_equal(back.values, values)
    np.testing.assert_array_equal(back.depth.values, [100.0, 105.0, 110.0, 115.0])
    assert back.attrs["sample_unit"] == "m"


def test_convert_there_and_back(run, segy, tmp_path):
    assert run("convert", segy, tmp_path / "a.zarr")[:2] == (0, f"{tmp_path / 'a.zarr'}\n")
    assert run("convert", tmp_path / "a.zarr", tmp_path / "b.sgy")[0] == 0
    np.testing.assert_array_equal(s3.open_cube(tmp_path / "b.sgy").values, s3.open_cube(segy).values)
    assert run("info", tmp_path / "a.zarr")[0] == 0


def test_convert_keeps_every_so_many_samples(run, segy, tmp_path):
    assert run("convert", segy, tmp_path / "b.sgy", "--every", "3")[0] == 0
    whole, thinned = s3.open_cube(segy), s3.open_cube(tmp_path / "b.sgy")
    np.testing.assert_array_equal(thinned.values, whole.values[..., ::3])
    np.testing.assert_array_equal(thinned[thinned.dims[2]].values, whole[whole.dims[2]].values[::3])
    code, _, err = run("convert", segy, tmp_path / "c.sgy", "--every", "0")
    assert (code, err) == (
        2,
        f"seismo3d: every is 0; expected 1 to {whole.shape[2] - 1}, for traces of {whole.shape[2]}.\n",
    )
    assert not (tmp_path / "c.sgy").exists()


def test_convert_replaces_on_request_alone(run, segy, tmp_path):
    (tmp_path / "a.npy").write_text("precious")
    code, _, err = run("convert", segy, tmp_path / "a.npy")
    assert code == 2
    assert (
        err == f"seismo3d: {tmp_path / 'a.npy'} exists already. Choose another name, or overwrite it (--overwrite).\n"
    )
    assert (tmp_path / "a.npy").read_text() == "precious"
    assert run("convert", segy, tmp_path / "a.npy", "--overwrite")[0] == 0
    assert np.load(tmp_path / "a.npy").ndim == 3


def test_convert_as_json_and_its_time(run, segy, tmp_path):
    code, out, err = run("convert", segy, tmp_path / "a.npy", "--json")
    assert code == 0
    assert json.loads(out)["file"] == str(tmp_path / "a.npy")
    assert set(json.loads(out)["timings_s"]) == {"open", "write"}
    assert err.startswith("time     0.")


def bad_files(tmp_path, segy):
    raw = segy.read_bytes()
    made = {
        "truncated.sgy": raw[:-7],
        "text.sgy": b"hello, this is a text file\n" * 400,
        "empty.sgy": b"",
        "samples.sgy": raw[:3220] + b"\x00\x00" + raw[3222:],
        "huge.sgy": raw[:3220] + b"\x7f\xff" + raw[3222:],
        "interval.sgy": raw[:3216] + b"\xf0\x60" + raw[3218:],
        "numbers.npy": b"no numpy",
    }
    for name, content in made.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "folder").mkdir()
    return [*made, "folder", "absent.sgy"]


def test_bad_input_is_one_line_and_code_2_and_nothing_is_written(run, segy, tmp_path):
    names = bad_files(tmp_path, segy)
    before = sorted(tmp_path.iterdir())
    for name in names:
        for words in (("info", tmp_path / name), ("convert", tmp_path / name, tmp_path / "out.zarr")):
            code, out, err = run(*words)
            assert (code, out) == (2, "")
            assert err.count("\n") == 1
            assert err.startswith("seismo3d: ")
            assert name in err
    assert sorted(tmp_path.iterdir()) == before


def test_no_permission(run, segy, monkeypatch):
    from pathlib import Path

    def refuse(self, *_args, **_keys):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", refuse)
    assert run("info", segy) == (
        2,
        "",
        f"seismo3d: {segy} cannot be read: permission denied. Ask its owner for access.\n",
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("info",), "Missing argument"),
        (("inf",), "No such command"),
        (("info", "x", "--wrong"), "No such option"),
        (("info", "x", "--inline-byte", "y"), "y"),
    ],
)
def test_wrong_usage_is_one_line_and_code_2(run, words, message):
    code, out, err = run(*words)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1


def test_debug_raises(segy):
    with pytest.raises(OSError, match="does not exist"):
        main(["info", f"{segy}.no", "--debug"])


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (OSError(28, "No space left on device", "out.sgy"), 2, "out.sgy: No space left on device."),
        (MemoryError("cannot allocate"), 2, "not enough memory"),
    ],
)
def test_errors_become_codes(run, segy, monkeypatch, error, code, words):
    def fail(*_args, **_keys):
        raise error

    monkeypatch.setattr("seismo3d.io.cubes.open_cube", fail)
    got, _, err = run("info", segy)
    assert got == code
    assert words in err
    assert err.count("\n") == 1


def test_unknown_errors_are_not_hidden(segy, monkeypatch):
    def fail(*_args, **_keys):
        raise ZeroDivisionError

    monkeypatch.setattr("seismo3d.io.cubes.open_cube", fail)
    with pytest.raises(ZeroDivisionError):
        main(["info", str(segy)])


def test_help_and_version(run):
    code, out, _ = run("--help")
    assert code == 0
    assert "convert" in out
    assert run()[1] == out
    assert run("--version")[1] == f"seismo3d {s3.__version__}\n"


def test_module_runs_and_help_loads_nothing_heavy():
    program = "import sys; sys.argv = ['seismo3d', '--help']\n"
    program += "import runpy\ntry: runpy.run_module('seismo3d', run_name='__main__')\n"
    program += (
        "except SystemExit as left: print(left.code, sorted({'numpy', 'xarray', 'dask', 'numba'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0 []"


def test_terminated_while_writing_leaves_nothing(segy, tmp_path):
    program = (
        "import os, signal, sys\nfrom seismo3d.cli import main\nimport seismo3d.io.zarr_store as z\n"
        # a shell's background jobs ignore Ctrl-C: the tests may run in one
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "old = z._write_slab\n"
        "def slab(*a):\n    old(*a)\n    os.kill(os.getpid(), getattr(signal, sys.argv[1]))\n"
        "z._write_slab = slab\n"
        "main(['convert', sys.argv[2], sys.argv[3]])\n"
    )
    for name, code in (("SIGTERM", 143), ("SIGINT", 130)):
        words = [sys.executable, "-c", program, name, str(segy), str(tmp_path / "out.zarr")]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        assert [p.name for p in tmp_path.iterdir()] == ["in.sgy"]


def test_a_synthetic_cube_is_not_written_under_a_name_of_another_kind(run, tmp_path):
    code, _, err = run("demo", "-o", tmp_path / "demo.zarr")
    assert code == 2
    assert "expected .sgy or .segy. Choose another name" in err
    assert not list(tmp_path.iterdir())
