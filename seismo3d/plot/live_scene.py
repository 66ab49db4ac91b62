"""A 3D scene whose slices, faults and horizons are exchanged one by one, for a page that draws it itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.plot.scene_frame import SceneFrame
from seismo3d.plot.scenes import grid_cells

_DETAIL = 512
"""Largest number of rows or columns of a slice in the scene."""


class LiveScene:
    """A scene of one cube; nothing is rendered here, the window only holds what a page is sent.

    Parameters
    ----------
    cube : DataArray or ndarray
        A cube of 3 axes; its samples are not read.
    height : float
        Height of the scene over its longer horizontal side.

    Attributes
    ----------
    window : vtkRenderWindow
        Holds the scene.
    """

    def __init__(self, cube: Any, *, height: float = 0.6) -> None:
        import vtkmodules.vtkInteractionStyle  # noqa: F401 - registers itself
        from vtkmodules.vtkRenderingCore import vtkRenderer
        from vtkmodules.vtkRenderingOpenGL2 import vtkGenericOpenGLRenderWindow

        self._frame = SceneFrame.from_cube(cube, height=height)
        # a kind of window that needs neither a screen nor OpenGL as long as nothing is rendered
        self.window = vtkGenericOpenGLRenderWindow()
        self._renderer = vtkRenderer()
        self._renderer.SetBackground(1.0, 1.0, 1.0)
        self.window.AddRenderer(self._renderer)
        self._actors: dict[tuple[str, int], Any] = {}
        self._aim()

    def set_slice(self, axis: int, index: int, picture: AnyArray) -> None:
        """Put a slice into the scene.

        Parameters
        ----------
        axis, index : int
            The axis that is held, and where.
        picture : ndarray of shape (rows, columns, 3), uint8
            Its colours; rows are samples (inlines on a horizontal slice), columns traces (crosslines).
        """
        import pyvista as pv

        far = np.array(self._frame.shape) - 1.0
        down, across = (0, 1) if axis == 2 else (2, 1 - axis)
        corners = np.zeros((4, 3))
        corners[:, axis] = index
        corners[[1, 2], across] = far[across]
        corners[[2, 3], down] = far[down]
        quad = pv.PolyData(self._frame.place(corners), faces=np.array([4, 0, 1, 2, 3]))
        quad.active_texture_coordinates = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float64)
        steps = [-(-n // _DETAIL) for n in picture.shape[:2]]
        texture = pv.Texture(np.ascontiguousarray(picture[:: steps[0], :: steps[1]]))
        actor = _make_actor(quad)
        actor.SetTexture(texture)
        actor.prop.lighting = False
        self._put("slice", axis, actor)

    def set_fault(self, number: int, vertices: AnyArray, cells: AnyArray, colours: AnyArray) -> None:
        """Put a fault into the scene, or exchange it.

        Parameters
        ----------
        number : int
            Its number.
        vertices : ndarray of shape (n, 3)
            In index coordinates.
        cells : ndarray of shape (m, 3)
            Triangles.
        colours : ndarray of shape (n, 3), uint8
            Colours of the vertices.
        """
        import pyvista as pv

        mesh = pv.PolyData.from_regular_faces(self._frame.place(vertices), np.asarray(cells))
        mesh["colour"] = colours
        self._put("fault", number, _make_actor(mesh, colours="colour"))

    def set_horizon(self, number: int, depth: AnyArray, colour: str) -> None:
        """Put a horizon into the scene: a map of fractional samples, NaN where there is none."""
        import pyvista as pv

        points, cells = grid_cells(np.asarray(depth, np.float64))
        if not len(cells):
            return
        mesh = pv.PolyData.from_regular_faces(self._frame.place(points), cells)
        actor = _make_actor(mesh)
        actor.prop.color = colour
        self._put("horizon", number, actor)

    def keep(self, faults: Sequence[int], horizons: Sequence[int]) -> None:
        """Take out all faults and horizons but these."""
        kept = {"fault": set(faults), "horizon": set(horizons)}
        for kind, number in [key for key in self._actors if key[0] in kept and key[1] not in kept[key[0]]]:
            self._renderer.RemoveActor(self._actors.pop((kind, number)))

    def _put(self, kind: str, number: int, actor: Any) -> None:
        """Put an actor into the scene in place of the one of its name."""
        old = self._actors.get((kind, number))
        if old is not None:
            self._renderer.RemoveActor(old)
        self._actors[kind, number] = actor
        self._renderer.AddActor(actor)

    def add_box(self) -> None:
        """Draw the cube's edges; the flat panels have their numbers."""
        import pyvista as pv

        actor = _make_actor(pv.Box(self._frame.bounds).extract_all_edges())
        actor.prop.color = "#5a6673"
        actor.prop.lighting = False
        self._put("box", 0, actor)

    def _aim(self) -> None:
        """Look from the front left and above, with the whole box in view."""
        bounds = np.array(self._frame.bounds).reshape(3, 2)
        middle = bounds.mean(axis=1)
        towards = np.array([-0.62, -0.66, 0.43])
        camera = self._renderer.GetActiveCamera()
        camera.SetViewAngle(22.0)
        camera.SetFocalPoint(*middle)
        camera.SetPosition(*(middle + towards / np.linalg.norm(towards) * 2.0 * np.linalg.norm(np.ptp(bounds, axis=1))))
        camera.SetViewUp(0.0, 0.0, 1.0)
        self._renderer.ResetCameraClippingRange(*self._frame.bounds)


def _make_actor(mesh: Any, *, colours: str = "") -> Any:
    import pyvista as pv

    mapper = pv.DataSetMapper(dataset=mesh)
    mapper.scalar_visibility = bool(colours)
    if colours:
        mapper.set_scalars(mesh[colours], colours, rgb=True)
    actor = pv.Actor(mapper=mapper)
    actor.prop.color = "white"  # other colours would tint textures
    actor.prop.ambient, actor.prop.diffuse, actor.prop.specular = 0.4, 0.65, 0.0
    return actor


def paint(shades: Sequence[str], classes: AnyArray) -> AnyArray:
    """Turn colour classes into colours: -1 is white."""
    table = np.array([[int(shade[k : k + 2], 16) for k in (1, 3, 5)] for shade in shades], np.uint8)
    colours = table[np.asarray(classes) % len(table)]
    colours[np.asarray(classes) < 0] = 255
    return colours
