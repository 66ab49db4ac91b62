"""The viewer's web server: on localhost only, and only for who has the token."""

from __future__ import annotations

import asyncio
import hmac
import logging
import secrets
import threading
from typing import Any
from uuid import uuid4

from seismo3d.errors import MissingDependencyError
from seismo3d.viewer.session import Session

HOST = "127.0.0.1"
_LOCAL = ("127.0.0.1", "localhost")
_EXTRA = "Install it: pip install 'seismo3d[view]'."


class Viewer:
    """A session served as a page.

    The server listens on 127.0.0.1 alone. Every request must carry the token, in the address or, after the first, in a
    cookie; one that names another host is refused, so that no other page can reach the server through the browser.

    Parameters
    ----------
    session : Session
        What is shown.
    title : str
        Written at the top left of the page.
    port : int
        0 for any free one.

    Raises
    ------
    MissingDependencyError
        If trame is not installed.

    Attributes
    ----------
    session : Session
        What is shown.
    token : str
        What a request must carry.
    """

    def __init__(self, session: Session, *, title: str = "seismo3d", port: int = 0) -> None:
        check_installed()
        from trame.app import get_server

        from seismo3d.viewer.page import Page

        self.session = session
        self.token = secrets.token_hex(24)
        self._wanted = port
        self._server = get_server(f"seismo3d-{uuid4().hex}", client_type="vue3")
        # trame reads the command line of whatever program runs; it is not its own here
        self._server.cli.parse_known_args = self._parse_nothing
        self._server.controller.on_server_bind.add(self._guard)
        self._page = Page(self._server, session, title=title)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._ready = threading.Event()
        self._problem: BaseException | None = None

    @property
    def port(self) -> int:
        """The port that is listened on."""
        return int(self._server.port)

    @property
    def url(self) -> str:
        """The page's address, with the token."""
        return f"http://{HOST}:{self.port}/index.html?secret={self.token}"

    def start(self) -> str:
        """Serve in a thread, and return the page's address.

        Raises
        ------
        FileAccessError
            If the port is taken.
        """
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="seismo3d-viewer", daemon=True)
            self._thread.start()
            self._ready.wait()
        if self._problem is not None:
            raise self._problem
        return self.url

    def wait(self) -> None:
        """Wait until the viewer is stopped."""
        while self._thread is not None and self._thread.is_alive():
            self._thread.join(0.5)

    def stop(self) -> None:
        """Stop serving; pages that are open lose their connection."""
        if self._thread is not None and self._thread.is_alive() and self._loop is not None:
            done = asyncio.run_coroutine_threadsafe(self._server.stop(), self._loop)
            done.result(timeout=20)
            self._thread.join(20)

    def _run(self) -> None:
        from seismo3d.errors import FileAccessError

        try:
            asyncio.run(self._serve())
        except OSError as error:
            self._problem = FileAccessError(
                f"port {self._wanted} of {HOST} cannot be listened on: {error.strerror or error}. Choose another port."
            )
        except BaseException as error:  # noqa: BLE001 - whatever ends this thread is raised by start()
            self._problem = error
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._server.controller.on_server_ready.add(lambda **_: self._ready.set())
        await self._server.start(
            port=self._wanted, host=HOST, thread=True, open_browser=False, show_connection_info=False,
            disable_logging=True, exec_mode="coroutine", timeout=0, backend="aiohttp",
        )  # fmt: skip

    def _parse_nothing(self, *_: Any, **__: Any) -> Any:
        parser = self._server.cli
        options, rest = type(parser).parse_known_args(parser, [f"--authKey={self.token}"])
        return options, rest

    def _guard(self, web: Any) -> None:
        """Put the token's check before everything that is served."""
        from aiohttp import web as http

        @http.middleware
        async def check(request: Any, handler: Any) -> Any:
            name = f"seismo3d-{self.port}"
            host = request.host.rsplit(":", 1)[0]
            given = request.query.get("secret") or request.cookies.get(name) or ""
            if host not in _LOCAL or not hmac.compare_digest(given.encode(), self.token.encode()):
                raise http.HTTPForbidden(text="This page needs the address that seismo3d printed, token included.\n")
            if request.path in ("/", "/index.html") and not request.query.get("secret"):
                # the page takes the token out of its address, and needs it there again when it is reloaded
                raise http.HTTPFound(f"/index.html?secret={self.token}")
            response = await handler(request)
            if "secret" in request.query and not response.prepared:
                response.set_cookie(name, self.token, httponly=True, samesite="Strict")
            response.headers.setdefault("Referrer-Policy", "no-referrer")
            response.headers.setdefault("X-Content-Type-Options", "nosniff")
            return response

        web.app.middlewares.append(check)


def check_installed() -> None:
    """Refuse to go on without what the viewer needs.

    Raises
    ------
    MissingDependencyError
        If it is not installed.
    """
    from importlib.util import find_spec

    missing = [name for name in ("trame", "trame_vtk", "aiohttp") if find_spec(name) is None]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise MissingDependencyError(f"the viewer needs {', '.join(missing)}, which {verb} not installed. {_EXTRA}")
    logging.getLogger("wslink").setLevel(logging.ERROR)
