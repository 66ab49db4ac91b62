"""The page over a session: its state, what its controls do, and the long jobs beside it."""

from __future__ import annotations

import asyncio
import base64
import importlib
import io
import logging
from collections.abc import Callable
from typing import Any

from seismo3d.errors import Seismo3dError
from seismo3d.plot.map_frame import MapFrame
from seismo3d.plot.pages import in_digits
from seismo3d.plot.pictures import axis_coordinates, axis_labels
from seismo3d.viewer.colours import ATTRIBUTES
from seismo3d.viewer.layout import PANELS, STYLE, make_template
from seismo3d.viewer.panels import CMAPS
from seismo3d.viewer.scene_keeper import SceneKeeper
from seismo3d.viewer.session import Panel, Session
from seismo3d.viewer.tracing import REACHES

_LOG = logging.getLogger("seismo3d.viewer")
_FULL, _COARSE = 1024, 256
"""Rows and columns of a slice, at most: as a screen shows it, and of a lazy cube while its slider moves."""
_REST = 0.12
"""Seconds without a move after which a slider rests."""
_MODES = (
    {"name": "look", "words": "Look", "help": "Click a fault to select it, or a place to move the other slices there"},
    {"name": "seed", "words": "Seed", "help": "Click on a reflector to follow it through the cube"},
    {"name": "stick", "words": "Stick", "help": "Click points down a break, then trace the fault along them"},
    {"name": "split", "words": "Split", "help": "Select one fault, then click the two ends of a line across it"},
)


class Page:
    """Binds a session to a trame server.

    Parameters
    ----------
    server : trame server
        The server; it is not started here.
    session : Session
        What the page shows.
    title : str
        Written at the top left.
    """

    def __init__(self, server: Any, session: Session, *, title: str) -> None:
        self._server = server
        self._state = server.state
        self._session = session
        self._scene = SceneKeeper(session)
        self._inlines_up = MapFrame.from_cube(session.cube).inlines_up
        self._mapped: tuple[Any, ...] | None = None
        self._turn = [0, 0, 0]
        self._view: Any = None
        self._has_scene = False
        self._jobs: set[asyncio.Task[None]] = set()
        self._fill(title)
        self._bind()
        self._build()

    def _fill(self, title: str) -> None:
        """Set the state that the page starts with, the three slices included."""
        session, state = self._session, self._state
        state.update({"title": title, "trame__title": title, "fourth": "scene", "map_image": ""})
        state.update({"modes": list(_MODES), "attributes": list(ATTRIBUTES), "cmaps": list(CMAPS)})
        state.update({"reaches": list(REACHES), "busy": False, "message": "", "is_error": False})
        for axis, name in enumerate(PANELS):
            state[f"{name}_index"], state[f"{name}_count"] = session.index[axis], session.reader.shape[axis]
            across, down = (1, 0) if axis == 2 else (1 - axis, 2)
            rising = axis == 2 and self._inlines_up
            # an SVG's rows go downwards
            state[f"{name}_flip"] = f"translate(0 {session.reader.shape[down]}) scale(1 -1)" if rising else ""
            for ends, along in ((("left", "across", "right"), across), (("bottom", "down", "top"), down)):
                numbers = axis_coordinates(session.cube, along)
                first, last = (f"{numbers[k]:.8g}" for k in (0, -1))
                low, high = (first, last) if along == across or rising else (last, first)
                words = (low, axis_labels(session.cube)[along], high)
                state.update({f"{name}_{end}": word for end, word in zip(ends, words, strict=True)})
            self._put(axis, session.panel(axis, most=self._most))
        self._put_controls()

    def _bind(self) -> None:
        server = self._server
        for name, call in (
            ("click", self._click), ("choose", self._choose), ("trace", self._trace), ("undo", self._undo),
            ("redo", self._redo), ("save", self._save), ("delete", self._delete), ("merge", self._merge),
            ("select", self._select), ("toggle", self._toggle), ("reset", self._reset),
        ):  # fmt: skip
            server.trigger(name)(call)
        for axis, name in enumerate(PANELS):
            server.state.change(f"{name}_index")(self._mover(axis, f"{name}_index"))
        server.state.change("fourth")(lambda **_: self._show_map())
        server.controller.on_client_connected.add(self._greet)

    def _build(self) -> None:
        from trame.ui.html import DivLayout
        from trame.widgets import client, vtk

        with DivLayout(self._server) as layout:
            self._view = vtk.VtkLocalView(self._scene.window, ref="scene", trame_server=self._server)
            view = self._view.html
            layout.root.clear()  # of the view, which the template holds
            client.Style(STYLE)
            layout.root.add_child(make_template(view))
        self._layout = layout

    # what is shown

    @property
    def _most(self) -> int:
        """Rows and columns, at most, of a slice that is shown at once."""
        return _COARSE if self._session.reader.is_lazy else _FULL

    def _put(self, axis: int, panel: Panel) -> None:
        """Put one panel into the page's state."""
        name = PANELS[axis]
        self._state.update(
            {
                f"{name}_image": panel.image,
                f"{name}_rows": panel.shape[0],
                f"{name}_columns": panel.shape[1],
                f"{name}_faults": panel.faults,
                f"{name}_selected": panel.selected,
                f"{name}_horizons": panel.horizons,
                f"{name}_picked": panel.picked,
                f"{name}_lines": list(panel.lines),
                f"{name}_label": panel.label,
            }
        )

    def _put_controls(self) -> None:
        """Put lists, settings and what can be done into the page's state."""
        session, history = self._session, self._session.history
        scale = session.scale
        numbers = scale.attribute != "fault" and bool(session.state.faults)
        self._state.update(
            {
                "mode": session.mode,
                "attribute": session.attribute,
                "cmap": session.cmap,
                "reach": session.tracer.reach,
                "rows": session.rows(),
                "chosen": sorted(session.selected),
                "n_picked": len(session.picked),
                "undo_words": history.undo_words,
                "redo_words": history.redo_words,
                "saved": history.is_saved,
                "can_save": session.folder is not None and not history.is_saved,
                "scale_colours": list(scale.shades) if numbers else [],
                "scale_low": in_digits(scale.low),
                "scale_high": f"{in_digits(scale.high)} {scale.unit}".strip(),
            }
        )

    def _show_all(self) -> None:
        """Draw all panels, the scene and the lists anew, and send them."""
        with self._state:
            for axis in range(3):
                self._state[f"{PANELS[axis]}_index"] = self._session.index[axis]
                self._put(axis, self._session.panel(axis, most=self._most))
            self._put_controls()
        if self._session.reader.is_lazy:
            for axis in range(3):
                self._start(self._refine(axis))
        self._update_scene()
        self._show_map()

    def _show_map(self) -> None:
        """Draw the throw map where it is looked at."""
        if self._state.fourth != "map":
            return
        faults = tuple(fault.surface for fault in self._session.state.faults)
        if self._mapped != faults:
            self._mapped = faults
            with self._state:
                self._state.map_image = draw_map(self._session)

    def _update_scene(self) -> None:
        """Send what has changed in the 3D scene; nothing before the page is there to show it."""
        if self._has_scene and self._scene.update():
            self._view.update()

    # what the controls do

    def _mover(self, axis: int, name: str) -> Callable[..., None]:
        def moved(**_: Any) -> None:
            index = int(self._state[name])
            if index == self._session.index[axis]:
                return
            self._session.move(axis, index)
            self._turn[axis] += 1
            self._start(self._follow_slider(axis, self._turn[axis]))

        return moved

    async def _follow_slider(self, axis: int, turn: int) -> None:
        """Show a slice that was moved to, unless the slider has gone on meanwhile."""
        panel = await asyncio.to_thread(self._session.panel, axis, most=self._most)
        if turn != self._turn[axis]:
            return
        with self._state:
            self._put(axis, panel)
            for other in range(3):
                if other != axis:
                    self._state[f"{PANELS[other]}_lines"] = list(self._session.crossing(other))
            self._state.n_picked = len(self._session.picked)
        await asyncio.sleep(_REST)
        if turn != self._turn[axis]:
            return
        self._update_scene()
        if not panel.is_full:
            await self._refine(axis, turn)

    async def _refine(self, axis: int, turn: int | None = None) -> None:
        """Show a slice at full detail, unless the slider has gone on meanwhile."""
        turn = self._turn[axis] if turn is None else turn
        panel = await asyncio.to_thread(self._session.panel, axis, most=_FULL)
        if turn == self._turn[axis]:
            with self._state:
                self._put(axis, panel)

    async def _fill_scene(self) -> None:
        await asyncio.to_thread(importlib.import_module, "pyvista")
        self._has_scene = True
        self._update_scene()

    def _start(self, job: Any) -> None:
        task = asyncio.get_running_loop().create_task(job)
        self._jobs.add(task)
        task.add_done_callback(self._jobs.discard)

    def _greet(self, **_: Any) -> None:
        """Send what was not needed for the first picture: the 3D scene, and slices at full detail."""
        self._start(self._fill_scene())
        if self._session.reader.is_lazy:
            for axis in range(3):
                self._start(self._refine(axis))

    def _do(self, call: Callable[[], str | None]) -> None:
        """Do something quick, show what came of it, or why it cannot be done."""
        if self._state.busy:
            self._say("something is being traced or saved; wait until it is done", is_error=True, busy=True)
            return
        try:
            words, is_error = call() or "", False
        except Seismo3dError as error:
            words, is_error = str(error), True
        self._show_all()
        self._say(words, is_error=is_error)

    def _do_long(self, call: Callable[[], str], words: str) -> None:
        """Do something long in a thread; the page stays alive, and edits wait from now on."""
        self._say(words, busy=True)
        self._start(self._finish(call))

    async def _finish(self, call: Callable[[], str]) -> None:
        """Wait for something long, and show what came of it."""
        is_error = False
        try:
            words = await asyncio.to_thread(call)
        except (Seismo3dError, OSError, MemoryError) as error:
            words, is_error = str(error), True
        except Exception as error:  # noqa: BLE001 - said in the comment below
            # a defect must not leave the page waiting for ever: it is told there, and in full where this was started
            _LOG.exception("the viewer failed")
            words, is_error = f"this failed in a way it should not: {error!r}", True
        self._show_all()
        self._say(words, is_error=is_error)

    def _say(self, words: str, *, is_error: bool = False, busy: bool = False) -> None:
        with self._state:
            self._state.update({"message": words, "is_error": is_error, "busy": busy})

    def _report(self, words: str) -> Callable[[str, float], None]:
        """Return a progress callback that may be called in any thread."""
        loop = asyncio.get_running_loop()

        def report(stage: str, share: float) -> None:
            loop.call_soon_threadsafe(lambda: self._say(f"{words}: {stage} {100 * share:.0f} %", busy=True))

        return report

    def _click(self, axis: int, across: float, down: float, width: float, height: float) -> None:
        axis = int(axis)
        if axis == 2 and self._inlines_up:
            down = height - down
        rows, columns = (int(self._state[f"{PANELS[axis]}_{side}"]) for side in ("rows", "columns"))
        pixels = (float(width) / columns, float(height) / rows)
        self._do(lambda: self._session.click(axis, across / pixels[0], down / pixels[1], pixels=pixels))
        if self._session.mode == "seed" and self._session.picked and not self._state.busy:
            self._trace()

    def _trace(self) -> None:
        if self._state.busy:
            return
        report = self._report("tracing")
        self._do_long(lambda: self._session.trace_picked(progress=report), "tracing")

    def _save(self) -> None:
        if not self._state.busy:
            self._do_long(self._session.save, "saving")

    def _choose(self, name: str, value: str) -> None:
        self._do(lambda: self._session.choose(name, value))

    def _undo(self) -> None:
        self._do(self._session.undo)

    def _redo(self) -> None:
        self._do(self._session.redo)

    def _delete(self) -> None:
        self._do(self._session.delete_selected)

    def _merge(self) -> None:
        self._do(self._session.merge_selected)

    def _select(self, numbers: list[int]) -> None:
        self._do(lambda: self._session.select([int(number) for number in numbers]))

    def _toggle(self, number: int) -> None:
        self._do(lambda: self._session.select(sorted(self._session.selected ^ {int(number)})))

    def _reset(self) -> None:
        self._view.reset_camera()


def draw_map(session: Session) -> str:
    """Draw the throw map of a session's faults as a data URI."""
    from matplotlib.figure import Figure

    from seismo3d.plot.maps import throw_map

    figure = Figure(figsize=(7.5, 6.0), layout="constrained")
    throw_map(session.fault_set(), session.cube, ax=figure.add_subplot())
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()
