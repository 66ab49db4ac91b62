"""Settings and results of the mapper."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from seismo3d._settings import Positive, check_fields
from seismo3d._typing import Float64Array
from seismo3d._validate import is_among, told
from seismo3d.errors import ParameterError
from seismo3d.robot.frames import MeasureSettings
from seismo3d.robot.tracking import TERMS, Located

STATES = ("started", "tracked", "sliding", "relocated", "joined", "lost", "empty")
"""States of a frame: the first one of a local map; located where it was expected; located but for motions of which
nothing in view tells, those along bare walls, corridors and tunnels, along which it goes on as predicted; located at a
place that a map remembers, after a loss; located, and its local map joined with another one; not located; without depth
to locate it by."""


@dataclass(frozen=True, slots=True)
class MapperSettings:
    """How a map is made.

    Attributes
    ----------
    voxel_size : float in [0.0001, 1]
        Edge of the map's voxels, metres.
    band_voxels : float in [2, 20]
        Signed distances are kept up to so many voxels from the surface.
    measure : MeasureSettings
    terms : str
        What frames are located by, one of ``tracking.TERMS``.
    filtered : bool
        Whether a frame's pose is predicted by the filter's velocity; else it starts where the last one was.
    enough_landmarks : int in [1, inf)
        The nearest views are searched for landmarks until so many are found in a frame.
    landmarks_in_state : bool
        Whether the filter holds landmarks that were seen often.
    calibrate_frames : int in [0, inf)
        After so many frames, the timing that cameras leave open is found from them, and they are mapped anew with it;
        0 leaves it at zero.
    view_distance : float in (0, inf)
        A keyframe is made where it is farther from all others: radians plus half the metres.
    new_map_after : int in [0, inf)
        After so many frames with depth that cannot be located, in a row, a new local map is begun; 0: never.
    keep_every : int in [1, inf)
        Every so many frames one is kept, packed, to make the map anew after a loop was closed.
    n_threads : int in [0, 1024]
        Threads; 0 for one a core. The result doesn't depend on it.
    """

    voxel_size: Annotated[float, "[0.0001, 1]"] = 0.01
    band_voxels: Annotated[float, "[2, 20]"] = 4.0
    measure: MeasureSettings = field(default_factory=MeasureSettings)
    terms: str = "fused"
    filtered: bool = True
    enough_landmarks: Annotated[int, "[1, inf)"] = 100
    landmarks_in_state: bool = True
    calibrate_frames: Annotated[int, "[0, inf)"] = 90
    view_distance: Positive = 0.14
    new_map_after: Annotated[int, "[0, inf)"] = 30
    keep_every: Annotated[int, "[1, inf)"] = 5
    n_threads: Annotated[int, "[0, 1024]"] = 0

    def __post_init__(self) -> None:
        check_fields(self)
        if not is_among(self.terms, TERMS):
            raise ParameterError(f"terms is {told(self.terms)}; expected one of {', '.join(TERMS)}.")


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """What became of a frame.

    Attributes
    ----------
    state : str
        One of ``STATES``.
    T_world_camera : ndarray of shape (4, 4), float64
        Pose at the colour's stamp in the local map; the world is the first frame's camera. The prediction where the
        frame is not located.
    covariance : ndarray of shape (6, 6), float64
        Of a perturbation on the left, (rotation, translation), against the first frame of the local map: how far the
        pose may be off in the map, and the map where it was located. It grows along the way, along bare walls and while
        frames are lost, and shrinks where a place is seen again.
    located : Located or None
        Details of the registration; None for the first frame and where there was none.
    local_map : int
        Number of the local map.
    """

    state: str
    T_world_camera: Float64Array
    covariance: Float64Array
    located: Located | None = None
    local_map: int = 0

    @property
    def is_located(self) -> bool:
        """Whether the pose comes from the frame itself."""
        return self.state in ("started", "tracked", "sliding", "relocated", "joined")


@dataclass(frozen=True, slots=True)
class Closed:
    """What closing loops did.

    Attributes
    ----------
    n_found : int
        Verified pairs of keyframes that show the same place.
    n_agreeing : int
        Those that keep more than a quarter of their weight in the solution.
    largest_turn, largest_shift : float
        Largest change of a keyframe, radians and metres.
    n_joined : int
        Local maps that were found to be one with the current map.
    """

    n_found: int
    n_agreeing: int
    largest_turn: float
    largest_shift: float
    n_joined: int = 0
