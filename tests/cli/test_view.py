from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.error
import urllib.request

import numpy as np
import pytest

pytest.importorskip("trame_vtk")


@pytest.fixture
def cube(tmp_path, rng):
    np.save(tmp_path / "cube.npy", rng.normal(size=(12, 14, 20)).astype(np.float32))
    return tmp_path / "cube.npy"


def start(*words, cwd):
    command = [sys.executable, "-m", "seismo3d", "view", *map(str, words)]
    # a shell's background jobs ignore interrupts, and so would what they start
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        env=_env(),
        preexec_fn=_may_stop,  # noqa: PLW1509 - nothing else of this process runs in between
    )


def _may_stop():
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _env():
    root = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))  # noqa: PTH100, PTH120
    return {**os.environ, "PYTHONPATH": root}


def test_view_serves_the_printed_address_until_it_is_interrupted(cube, tmp_path):
    with start(cube, "--no-browser", cwd=tmp_path) as running:
        try:
            url = running.stdout.readline().strip()
            assert url.startswith("http://127.0.0.1:")
            with urllib.request.urlopen(url, timeout=20) as page:  # noqa: S310 - an address of this machine
                assert page.status == 200
            with pytest.raises(urllib.error.HTTPError, match="403"):
                urllib.request.urlopen(url.split("?")[0], timeout=20)  # noqa: S310
            running.send_signal(signal.SIGINT)
            out, err = running.communicate(timeout=60)
        finally:
            running.kill()
    assert (running.returncode, out) == (130, "")
    assert err == "seismo3d: interrupted; nothing half-written was left\n"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["nothing.sgy", "--no-browser"], "does not exist"),
        (["cube.npy", "--no-browser", "--cube", "cube.npy"], "holds no faultset.npz"),
        (["cube.npy", "--no-browser", "-o", "cube.npy"], "is a file; expected a folder to save to"),
    ],
)
def test_view_says_what_is_wrong_in_one_line(cube, words, line):
    with start(*words, cwd=cube.parent) as running:
        out, err = running.communicate(timeout=60)
    assert out == ""
    assert line in err
    assert err.count("\n") == 1
