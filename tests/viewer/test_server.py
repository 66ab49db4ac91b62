from __future__ import annotations

import asyncio
import http.client
import importlib.util
import json
import socket
from pathlib import Path

import numpy as np
import pytest

from seismo3d.errors import FileAccessError, MissingDependencyError, ParameterError
from seismo3d.viewer import show, widget

pytest.importorskip("trame_vtk")
# trame and wslink, not this package, use what newer Pythons and aiohttp warn of
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


@pytest.fixture
def viewer(cube, faults, tmp_path):
    made = show(cube, faults, folder=tmp_path / "kept", open_browser=False)
    yield made
    made.stop()


def get(viewer, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=20)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    answer.read()
    connection.close()
    return answer


def test_only_the_token_opens_the_page(viewer):
    page = get(viewer, f"/index.html?secret={viewer.token}")
    assert page.status == 200
    cookie = page.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    known = {"Cookie": cookie.split(";")[0]}
    assert get(viewer, "/vue.global.js", **known).status == 200
    # without the token in its address the page would not connect
    for path in ("/", "/index.html", "/index.html?secret="):
        again = get(viewer, path, **known)
        assert (again.status, again.headers["Location"]) == (302, f"/index.html?secret={viewer.token}")
    for path in ("/", "/index.html", "/index.html?secret=", "/index.html?secret=guess", "/ws", "/vue.global.js"):
        assert get(viewer, path).status == 403


def test_other_host_names_are_refused(viewer):
    path = f"/index.html?secret={viewer.token}"
    assert get(viewer, path, Host=f"evil.example:{viewer.port}").status == 403
    assert get(viewer, path, Host=f"localhost:{viewer.port}").status == 200


def test_it_listens_on_this_machine_only(viewer):
    addresses = {entry[4][0] for entry in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in addresses - {"127.0.0.1", "127.0.1.1"}:
        with pytest.raises(OSError, match="refused"):
            socket.create_connection((address, viewer.port), timeout=5)


def test_the_websocket_wants_the_token_too(viewer):
    import aiohttp

    async def stranger():
        async with aiohttp.ClientSession() as client:
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                await client.ws_connect(f"http://127.0.0.1:{viewer.port}/ws")
            return refused.value.status

    assert asyncio.run(stranger()) == 403


def test_a_taken_port_is_one_clear_error(cube, viewer):
    with pytest.raises(FileAccessError, match=f"port {viewer.port} of 127.0.0.1 cannot be listened on"):
        show(cube, port=viewer.port, open_browser=False)


def test_ports_are_checked(cube):
    with pytest.raises(ParameterError, match="port is 70000"):
        show(cube, port=70000, open_browser=False)


def test_the_widget_is_the_page_in_a_frame(cube, faults):
    made = widget(cube, faults, height=500)
    try:
        shown = made._repr_html_()
        assert made.viewer.url.split("?")[1] in shown
        assert "height:500px" in shown
        assert get(made.viewer, "/" + made.viewer.url.split("/", 3)[3]).status == 200
    finally:
        made.viewer.stop()


def test_the_first_state_holds_the_three_slices(viewer):
    state = viewer._server.state
    for name, shape in (("inline", (50, 40)), ("crossline", (50, 30)), ("sample", (30, 40))):
        assert state[f"{name}_image"].startswith("data:image/png")
        assert (state[f"{name}_rows"], state[f"{name}_columns"]) == shape
    assert json.dumps(state["rows"])
    assert np.isfinite(state["inline_lines"]).all()


def test_without_its_packages_the_viewer_says_what_to_install(cube, monkeypatch):
    known = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "trame_vtk" else known(name))
    with pytest.raises(MissingDependencyError, match=r"needs trame_vtk, .* pip install 'seismo3d\[view\]'"):
        show(cube, open_browser=False)


def test_the_widget_works_in_a_notebook():
    nbformat, client = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    cells = [
        (
            "import urllib.request, numpy as np, seismo3d as s3\n"
            "shown = s3.viewer.widget(np.random.default_rng(0).normal(size=(9, 10, 20)).astype('float32'))\nshown"
        ),
        "with urllib.request.urlopen(shown.viewer.url) as page:\n    print(page.status)\nshown.viewer.stop()",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in cells])
    root = str(Path(__file__).resolve().parents[2])
    client.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": root}}).execute()
    assert "<iframe src=" in notebook.cells[0].outputs[-1]["data"]["text/html"]
    assert "200" in str(notebook.cells[1].outputs)


def test_defects_are_told_and_do_not_leave_the_page_waiting(viewer, caplog):
    page, state = viewer._page, viewer._server.state

    def fail():
        raise ZeroDivisionError("by nought")

    async def try_it():
        page._do_long(fail, "tracing")
        # what comes before the job has begun waits too
        assert state.busy
        await asyncio.gather(*page._jobs)

    asyncio.run_coroutine_threadsafe(try_it(), viewer._loop).result(timeout=60)
    assert (state.busy, state.is_error) == (False, True)
    assert "this failed in a way it should not: ZeroDivisionError" in state.message
    assert "the viewer failed" in caplog.text


def test_edits_wait_while_something_is_traced(viewer):
    page, state = viewer._page, viewer._server.state

    async def try_it():
        page._say("tracing", busy=True)
        viewer.session.select([1])
        page._delete()
        return state.busy, state.message, len(viewer.session.state.faults)

    busy, message, n_faults = asyncio.run_coroutine_threadsafe(try_it(), viewer._loop).result(timeout=60)
    assert (busy, n_faults) == (True, 2)
    assert "wait until it is done" in message
