"""Whether this machine can draw 3D scenes without a screen, and scenes to files."""

from __future__ import annotations

import functools
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from seismo3d._typing import AnyArray
from seismo3d.errors import RenderError
from seismo3d.io._files import check_output, written_aside

_PROBE = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(48, 48), theme=pyvista.themes.DocumentTheme())
plotter.add_mesh(pyvista.Sphere(), color="red")
raise SystemExit(not plotter.screenshot(return_img=True).std() > 0)
"""
_CHOICE = "VTK_DEFAULT_OPENGL_WINDOW"
_REMEDY = (
    "Install a software renderer (on Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri, or libosmesa6), "
    "or use plot.section and plot.throw_map, which need none."
)


def has_screen() -> bool:
    """Tell whether windows can be opened: always so outside Linux, there where a display is named."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@functools.cache
def find_windowless() -> tuple[str, str]:
    """Find a kind of VTK window that works without a screen.

    A machine without a usable OpenGL can bring the whole process down, so each kind first draws a small scene in a
    process of its own. The answer is kept for the life of this process.

    Returns
    -------
    window, problem : str
        The class of window to ask VTK for ("" for its own choice), and what went wrong; "" when one works.
    """
    kinds = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow") if sys.platform.startswith("linux") else ("",)
    problems = []
    for kind in kinds:
        problem = _try_window(kind)
        if not problem:
            return kind, ""
        problems.append(f"{kind or 'a hidden window'}: {problem}")
    return "", "; ".join(problems)


def _try_window(kind: str) -> str:
    environment = {**os.environ, _CHOICE: kind} if kind else dict(os.environ)
    command = [sys.executable, "-c", _PROBE]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=environment)  # noqa: S603
    except subprocess.TimeoutExpired:
        return "a test scene took more than two minutes"
    except OSError as error:
        return f"a test process could not be started ({error})"
    if done.returncode == 0:
        return ""
    # VTK colours its lines and puts time, process and place before the message
    lines = [re.sub(r"\x1b\[[0-9;]*m", "", line).rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines()]
    last = next((line for line in reversed(lines) if line), "no message")
    return f"a test scene ended with code {done.returncode}: {last[:120]}"


@contextmanager
def windowless() -> Iterator[None]:
    """Make VTK windows that need no screen inside this block.

    Raises
    ------
    RenderError
        If the machine has no usable OpenGL; says what to install.
    """
    kind, problem = find_windowless()
    if problem:
        raise RenderError(f"this machine cannot draw 3D scenes ({problem}). {_REMEDY}")
    before = os.environ.get(_CHOICE)
    if kind:
        os.environ[_CHOICE] = kind
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_CHOICE, None)
        else:
            os.environ[_CHOICE] = before


def save_scene(path: str | Path, cube: Any, *, size: tuple[int, int] = (1400, 950), **settings: Any) -> Path:
    """Draw the 3D scene of :func:`seismo3d.plot.cube` to a picture file, without a screen.

    Parameters
    ----------
    path : str or Path
        The PNG file; it appears complete, or not at all.
    cube : DataArray or ndarray
        A cube of 3 axes.
    size : (int, int)
        Width and height in pixels.
    **settings
        As for :func:`seismo3d.plot.cube`: ``faults``, ``tracks``, ``colour`` and so on.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ParameterError
        If the name does not end in ``.png``.
    FileAccessError
        If the file cannot be written.
    RenderError
        If the machine has no usable OpenGL.
    """
    from PIL import Image

    path = check_output(path, endings=(".png",))
    picture = render_scene(cube, size=size, **settings)
    with written_aside(path) as aside:
        Image.fromarray(picture).save(aside, format="PNG")
    return path


def render_scene(cube: Any, *, size: tuple[int, int] = (1400, 950), **settings: Any) -> AnyArray:
    """Draw the 3D scene to an array of shape (height, width, 3), uint8; the rest as for :func:`save_scene`."""
    from seismo3d.plot.scenes import cube as draw_cube

    plotter = draw_cube(cube, off_screen=True, size=size, **settings)
    try:
        picture: AnyArray = plotter.screenshot(return_img=True)
    finally:
        plotter.close()
    return picture
