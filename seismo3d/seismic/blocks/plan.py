"""How a cube is cut into blocks of whole traces, and how large they may be."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from seismo3d._validate import told
from seismo3d.errors import ParameterError
from seismo3d.seismic.dip import DipSettings, dip_reach, tensor_reach
from seismo3d.seismic.levelling import BRIDGE_WIDTH, level_reach
from seismo3d.seismic.misfit_settings import MisfitSettings, energy_reach, misfit_reach
from seismo3d.seismic.placing import profile_reach
from seismo3d.seismic.scan import plan_scan
from seismo3d.seismic.side_shifts import SLAB, carry_reach, fit_reach, match_reach
from seismo3d.seismic.throw import side_reach

BASE_BYTES = 420 * 2**20
"""What Python, the libraries and the compiled code take before there is any data."""
_BRICKS = (32, 16, 8)
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}
RAW_REACH = 8
"""Crosslines to either side that tell whether a trace repeats its neighbours."""


@dataclass(frozen=True, slots=True)
class Box:
    """Inlines ``i0`` to ``i1`` and crosslines ``j0`` to ``j1`` of a cube, the last ones left out."""

    i0: int
    i1: int
    j0: int
    j1: int

    @property
    def shape(self) -> tuple[int, int]:
        """How many inlines and crosslines."""
        return self.i1 - self.i0, self.j1 - self.j0

    def grown(self, reach: tuple[int, int], shape: tuple[int, ...]) -> Box:
        """Return the box with so many inlines and crosslines more on every side, as far as the cube has them."""
        return Box(
            max(0, self.i0 - reach[0]), min(shape[0], self.i1 + reach[0]),
            max(0, self.j0 - reach[1]), min(shape[1], self.j1 + reach[1]),
        )  # fmt: skip

    def within(self, other: Box) -> tuple[slice, slice]:
        """Return where this box lies in an array of another one."""
        return (
            slice(self.i0 - other.i0, self.i1 - other.i0),
            slice(self.j0 - other.j0, self.j1 - other.j0),
        )

    def ends(self, shape: tuple[int, ...]) -> tuple[tuple[bool, bool], tuple[bool, bool]]:
        """Tell which of its sides are the cube's."""
        return (self.i0 == 0, self.i1 == shape[0]), (self.j0 == 0, self.j1 == shape[1])


@dataclass(frozen=True, slots=True)
class Tiling:
    """A cube's traces cut into boxes of equal edges; those at its far ends may be smaller."""

    shape: tuple[int, int]
    edges: tuple[int, int]

    @property
    def counts(self) -> tuple[int, int]:
        """Boxes along inlines and along crosslines."""
        return -(-self.shape[0] // self.edges[0]), -(-self.shape[1] // self.edges[1])

    def __len__(self) -> int:
        return self.counts[0] * self.counts[1]

    def __iter__(self) -> Iterator[Box]:
        return (self.box(number) for number in range(len(self)))

    def box(self, number: int) -> Box:
        """Return a box by its number."""
        row, column = divmod(number, self.counts[1])
        i, j = row * self.edges[0], column * self.edges[1]
        return Box(i, min(i + self.edges[0], self.shape[0]), j, min(j + self.edges[1], self.shape[1]))

    def holding(self, i: int, j: int) -> int:
        """Return the number of the box that holds a trace."""
        return (i // self.edges[0]) * self.counts[1] + j // self.edges[1]


@dataclass(frozen=True, slots=True)
class BlockPlan:
    """Sizes of the blocks of every stage, all multiples of the brick that is stored.

    Attributes
    ----------
    shape : tuple of (int, int, int)
        The cube's.
    brick : int
        Inlines and crosslines of a stored brick, which holds whole traces.
    memory : int
        Bytes that a process may take.
    edges : dict of str to (int, int)
        Inlines and crosslines of a block, by stage: ``raw``, ``dip``, ``misfit``, ``register``, ``carry``,
        ``moments``, ``evidence``, ``scan`` and ``draw`` of faults; ``raw``, ``dip``, ``shifts``, ``links`` and ``fill``
        of layer time.
    """

    shape: tuple[int, int, int]
    brick: int
    memory: int
    edges: dict[str, tuple[int, int]]

    def tiling(self, stage: str) -> Tiling:
        """Return the blocks of a stage."""
        return Tiling((self.shape[0], self.shape[1]), self.edges[stage])

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        found = asdict(self)
        return found | {"shape": list(self.shape), "edges": {name: list(edge) for name, edge in self.edges.items()}}

    @classmethod
    def from_dict(cls, found: dict[str, Any]) -> BlockPlan:
        """Return the plan that :meth:`to_dict` described."""
        n0, n1, n2 = found["shape"]
        edges = {name: (int(edge[0]), int(edge[1])) for name, edge in found["edges"].items()}
        return cls((n0, n1, n2), found["brick"], found["memory"], edges)


def parse_memory(memory: int | str) -> int:
    """Return a number of bytes from one, or from text such as "2GB", "1.5 GiB" or "800MB".

    Examples
    --------
    >>> parse_memory("2GB"), parse_memory("512 MiB"), parse_memory(10**9)
    (2000000000, 536870912, 1000000000)
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([kmgt]i?)?b?\s*", str(memory).lower())
    if found is None:
        raise ParameterError(f"memory is {told(memory)}; expected a size such as 2GB or 1.5GiB.")
    return int(float(found.group(1)) * _UNITS[found.group(2) or ""])


def whole_cube_bytes(shape: tuple[int, ...]) -> int:
    """Return the memory that a cube of this shape takes when its faults are traced in one piece."""
    size = 1
    for n in shape:
        size *= n
    return 44 * size + BASE_BYTES


def plan_blocks(
    shape: tuple[int, int, int],
    memory: int,
    settings: Any,
    *,
    edge: int | None = None,
    least_blocks: int = 1,
    needs: Callable[[tuple[int, int, int], Any], dict[str, Callable[[int], float]]] | None = None,
) -> BlockPlan:
    """Choose the largest blocks with which every stage stays within the memory.

    Parameters
    ----------
    shape : tuple of int
        The cube's.
    memory : int
        Bytes that a process may take.
    settings : FaultSettings or LayerTimeSettings
        Say how far each stage looks.
    edge : int, optional
        Largest edge of a block.
    least_blocks : int
        How many blocks there should be at least, for as many workers to have some.
    needs : callable, optional
        Gives, for a shape and settings, by stage the bytes that a block of an edge takes; those of faults without it.

    Raises
    ------
    ParameterError
        If the memory is too little for the smallest blocks.
    """
    room = memory - BASE_BYTES
    widest = max(shape[:2]) if edge is None else edge
    if least_blocks > 1:
        widest = min(widest, max(_BRICKS[-1], int((shape[0] * shape[1] / least_blocks) ** 0.5)))
    wanted = (needs or fault_needs)(shape, settings)
    for brick in _BRICKS:
        if edge is not None and brick > edge:
            continue
        largest = max(brick, widest // brick * brick)
        found = {stage: _largest_edge(brick, largest, room, need) for stage, need in wanted.items()}
        raw = _raw_edges(shape, brick, largest if edge or least_blocks > 1 else None, room)
        if all(found.values()) and raw is not None:
            return BlockPlan(shape, brick, memory, {stage: (n, n) for stage, n in found.items()} | {"raw": raw})
    least = max(need(_BRICKS[-1]) for need in wanted.values()) + BASE_BYTES
    raise ParameterError(
        f"memory is {memory / 1e9:.2f} GB; traces of {shape[2]} samples need at least {least / 1e9:.2f} GB. Give more."
    )


def _largest_edge(brick: int, widest: int, room: int, need: Callable[[int], float]) -> int:
    """Return the largest multiple of the brick whose block fits; 0 where none does."""
    edge = 0
    while edge + brick <= max(widest, brick) + brick - 1 and need(edge + brick) <= room:
        edge += brick
    return edge


def _raw_edges(shape: tuple[int, int, int], brick: int, widest: int | None, room: int) -> tuple[int, int] | None:
    """Return the blocks in which the input is read: of a few inlines, and all crosslines where there is room."""
    across = brick if widest is None else widest
    row = 24 * across * shape[2]
    columns = min(shape[1] if widest is None else widest, int(room / row) - 2 * RAW_REACH)
    if columns >= shape[1]:
        return across, -(-shape[1] // brick) * brick
    columns = columns // brick * brick
    return (across, columns) if columns > 0 else None


def _n_traces(shape: tuple[int, int, int], edge: int, reach: int) -> int:
    """Return how many traces a block of an edge has together with those within a reach around it, in the cube."""
    return min(edge + 2 * reach, shape[0]) * min(edge + 2 * reach, shape[1])


def fault_needs(shape: tuple[int, int, int], settings: Any) -> dict[str, Callable[[int], float]]:
    """Return the bytes that a block of an edge takes, by stage of fault tracing."""
    step = settings.misfit.step
    n2, thinned = shape[2], -(-shape[2] // step)
    scan = plan_scan((max(shape[0], 2), max(shape[1], 2), thinned), 1.0, step, settings=settings.scan)
    across, along = scan.reach
    pad = len(scan.dip_taps) // 2
    square = partial(_n_traces, shape)

    def wide(edge: int) -> int:
        return max(
            min(edge + 2 * across, shape[0]) * min(edge + 2 * along, shape[1]),
            min(edge + 2 * along, shape[0]) * min(edge + 2 * across, shape[1]),
        )

    def scan_bytes(edge: int) -> float:
        lines = min(edge + 2 * scan.dip_reach, max(shape[:2])) * min(edge, max(shape[:2])) * (thinned + 2 * pad)
        return max(13 * wide(edge) * thinned, 12 * wide(edge) * thinned + 8 * lines) + 14 * square(edge, 0) * thinned

    def misfit_bytes(edge: int) -> float:
        lines = min(settings.misfit.slab, edge) + 2 * energy_reach(settings.misfit)
        slab = lines * min(edge + 2 * energy_reach(settings.misfit), shape[1])
        reach = misfit_reach(settings.misfit.reach[1], settings.misfit)
        return (13 * square(edge, reach) + 36 * slab + 8 * square(edge, 0)) * n2

    def register_bytes(edge: int) -> float:
        reach, around = match_reach(settings.registration), fit_reach(settings.registration)
        slab = (min(SLAB, edge) + 2 * reach) * min(edge + 2 * reach, shape[1])
        search = 18 * slab + 2 * square(edge, around)
        return (5 * square(edge, reach) + max(search, 18 * square(edge, around))) * n2

    def evidence_bytes(edge: int) -> float:
        return (14 * square(edge, evidence_reach(settings.misfit)) + 8 * square(edge, 0)) * thinned

    return {
        "dip": lambda edge: slope_bytes(shape, edge, settings.dip),
        "misfit": misfit_bytes,
        "register": register_bytes,
        "carry": lambda edge: 16 * square(edge, carry_reach(settings.registration)) * n2,
        "moments": lambda edge: 44 * square(edge, bridge_reach()) * thinned,
        "evidence": evidence_bytes,
        "scan": scan_bytes,
        "draw": lambda edge: 22 * square(edge, read_reach(settings)) * n2,
    }


def read_reach(settings: Any) -> int:
    """Return how many traces off a sheet the cube is read, for the sheet's throw and for its place."""
    return max(side_reach(settings.throw), profile_reach(settings.throw, settings.place))


def slope_bytes(shape: tuple[int, int, int], edge: int, settings: DipSettings) -> float:
    """Return the bytes that slopes of a block of an edge take."""
    square = partial(_n_traces, shape, edge)
    return (5 * square(dip_reach(settings)) + 24 * square(tensor_reach(settings)) + 28 * square(0)) * shape[2]


def layer_needs(shape: tuple[int, int, int], settings: Any) -> dict[str, Callable[[int], float]]:
    """Return the bytes that a block of an edge takes, by stage of layer time."""
    from seismo3d.seismic.shifts import shift_reach

    n2, links = shape[2], -(-(max(settings.lengths) + settings.clear + 1) // 8) * 8
    wide = int(4.0 * settings.wide[0]) + 2
    square = partial(_n_traces, shape)

    return {
        "dip": lambda edge: slope_bytes(shape, edge, settings.dip),
        "shifts": lambda edge: 48 * square(edge, shift_reach(settings.lengths, settings.shifts)) * n2,
        # half of the memory is the solution's
        "links": lambda edge: 2 * (14 * square(edge, links) + 10 * square(edge, wide)) * n2,
        "fill": lambda edge: 30 * square(edge, 2 * settings.links.far) * n2,
    }


def bridge_reach() -> int:
    """Return how many traces off bridged evidence depends on."""
    from seismo3d.seismic._kernels_filters import gaussian_taps

    return len(gaussian_taps(BRIDGE_WIDTH)) // 2


def evidence_reach(settings: MisfitSettings) -> int:
    """Return how many traces off the finished evidence depends on, besides the bridged evidence there."""
    from seismo3d.seismic._kernels_filters import gaussian_taps

    return level_reach(settings) + len(gaussian_taps(settings.lateral)) // 2
