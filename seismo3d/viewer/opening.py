"""Doors to the viewer: a page in the browser, and the same page in a notebook's cell."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from seismo3d._validate import as_kind, as_whole_number
from seismo3d.seismic.faultset import FaultSet
from seismo3d.seismic.tracks import Track
from seismo3d.viewer.server import Viewer, check_installed
from seismo3d.viewer.session import Session


def show(
    cube: Any,
    faults: FaultSet | None = None,
    *,
    tracks: Sequence[Track] = (),
    folder: str | Path | None = None,
    title: str = "seismo3d",
    port: int = 0,
    open_browser: bool = True,
) -> Viewer:
    """Open the viewer as a page of the browser; it is served by a thread of this process.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube (inline, crossline, sample), in memory or lazy; of a lazy one only what is looked at is read.
    faults : FaultSet, optional
        Faults of this cube.
    tracks : sequence of Track
        Horizons of this cube.
    folder : str or Path, optional
        Where "Save" writes, a new folder, an empty one, or an earlier session's, which is replaced; without one nothing
        can be saved.
    title : str
        Written at the top left.
    port : int
        Port to listen on, on 127.0.0.1 alone; 0 for any free one.
    open_browser : bool
        Whether to open the page.

    Returns
    -------
    Viewer
        With ``url``, ``session`` and ``stop()``.

    Raises
    ------
    MissingDependencyError
        If the extra ``view`` is not installed.
    FileAccessError
        If the folder holds something that no session saved.
    ShapeError
        If the cube has not three axes, or faults or tracks are of another cube.
    """
    check_installed()
    port = as_whole_number(port, "port", low=0, high=65535)
    as_kind(title, str, "title", remedy="Give text, or leave it out.")
    viewer = Viewer(Session(cube, faults, tracks=tracks, folder=folder), title=title, port=port)
    url = viewer.start()
    if open_browser:
        import webbrowser

        webbrowser.open(url)
    return viewer


class Widget:
    """A viewer in a notebook's cell.

    Parameters
    ----------
    viewer : Viewer
        A viewer that is served.
    height : int
        Height of the cell's frame in pixels.

    Attributes
    ----------
    viewer : Viewer
        The viewer; its ``session`` has what was traced and edited.
    """

    def __init__(self, viewer: Viewer, *, height: int = 720) -> None:
        self.viewer = viewer
        self._height = height

    def _repr_html_(self) -> str:
        url = html.escape(self.viewer.url, quote=True)
        return f'<iframe src="{url}" style="width:100%; height:{self._height}px; border:1px solid #d5dce4"></iframe>'


def widget(
    cube: Any,
    faults: FaultSet | None = None,
    *,
    tracks: Sequence[Track] = (),
    folder: str | Path | None = None,
    height: int = 720,
) -> Widget:
    """Show the viewer in a notebook's cell; parameters and errors as for :func:`show`.

    The notebook's browser must run on the machine of its kernel: the page is served on localhost alone.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube (inline, crossline, sample).
    faults : FaultSet, optional
        Faults of this cube.
    tracks : sequence of Track
        Horizons of this cube.
    folder : str or Path, optional
        Where "Save" writes.
    height : int
        Height of the frame in pixels.

    Returns
    -------
    Widget
        Shown by the notebook; ``widget.viewer.session.state`` has the edited faults.
    """
    frame = as_whole_number(height, "height", low=100, high=10_000)
    return Widget(show(cube, faults, tracks=tracks, folder=folder, open_browser=False), height=frame)
