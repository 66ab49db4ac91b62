"""The 3D scene of a session: what changed since it was last looked at is exchanged, the rest stays."""

from __future__ import annotations

from typing import Any

import numpy as np

from seismo3d._typing import AnyArray
from seismo3d.plot.live_scene import LiveScene, paint
from seismo3d.viewer.colours import vertex_values
from seismo3d.viewer.interpretation import Fault
from seismo3d.viewer.panels import HORIZON_COLOURS, NO_DATA
from seismo3d.viewer.session import Session

_DETAIL = 512
_CHOSEN = (255, 242, 0)


class SceneKeeper:
    """Keeps a scene in step with a session.

    Parameters
    ----------
    session : Session
        What is shown.

    Attributes
    ----------
    window : vtkRenderWindow
        Holds the scene.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._scene = LiveScene(session.cube)
        self._drawn: dict[tuple[str, int], tuple[Any, ...]] = {}
        self.window = self._scene.window

    def update(self) -> bool:
        """Exchange what has changed, and tell whether anything has."""
        if not self._drawn:
            self._scene.add_box()
        # each of them, whether one before it changed or not
        return any([self._update_slices(), self._update_faults(), self._update_horizons(), self._drop_gone()])

    def _update_slices(self) -> bool:
        session, changed = self._session, False
        for axis in range(3):
            if self._is_new(("slice", axis), (session.index[axis], session.cmap)):
                self._scene.set_slice(axis, session.index[axis], self._slice_colours(axis))
                changed = True
        return changed

    def _update_faults(self) -> bool:
        session, changed = self._session, False
        limits = (session.scale.attribute, session.scale.low, session.scale.high)
        for fault in session.state.faults:
            if self._is_new(("fault", fault.number), (fault.surface, limits, fault.number in session.selected)):
                self._scene.set_fault(fault.number, fault.surface.vertices, fault.surface.cells, self._paint(fault))
                changed = True
        return changed

    def _update_horizons(self) -> bool:
        changed, samples = False, self._session.sample_axis()
        for k, horizon in enumerate(self._session.state.horizons):
            if self._is_new(("horizon", horizon.number), (horizon.track, k)):
                colour = HORIZON_COLOURS[k % len(HORIZON_COLOURS)]
                self._scene.set_horizon(horizon.number, samples.index(horizon.track.depth.astype(np.float64)), colour)
                changed = True
        return changed

    def _drop_gone(self) -> bool:
        """Take out what is no longer in the interpretation."""
        state = self._session.state
        kept = {"fault": [f.number for f in state.faults], "horizon": [h.number for h in state.horizons]}
        gone = [key for key in self._drawn if key[0] in kept and key[1] not in kept[key[0]]]
        for key in gone:
            del self._drawn[key]
        self._scene.keep(kept["fault"], kept["horizon"])
        return bool(gone)

    def _is_new(self, key: tuple[str, int], looks: tuple[Any, ...]) -> bool:
        if self._drawn.get(key) == looks:
            return False
        self._drawn[key] = looks
        return True

    def _slice_colours(self, axis: int) -> AnyArray:
        """Colours of a slice, of shape (rows, columns, 3)."""
        from matplotlib import colormaps

        session = self._session
        part = session.reader.read(axis, session.index[axis], most=_DETAIL)
        low, high = session.limits
        share = np.clip((part.values - low) / (high - low), 0.0, 1.0)
        colours = (255.0 * colormaps[session.cmap](np.nan_to_num(share, nan=0.5))[..., :3]).astype(np.uint8)
        colours[~np.isfinite(part.values)] = NO_DATA
        return colours

    def _paint(self, fault: Fault) -> AnyArray:
        scale, n = self._session.scale, len(fault.surface.vertices)
        if fault.number in self._session.selected:
            return np.tile(np.array(_CHOSEN, np.uint8), (n, 1))
        if scale.attribute == "fault":
            return paint(scale.shades, np.full(n, fault.number - 1))
        return paint(scale.shades, scale.classify(vertex_values(fault.surface, scale.attribute)))
