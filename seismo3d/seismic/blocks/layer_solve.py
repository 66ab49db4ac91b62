"""The layer graph of a large cube solved coarse to fine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from seismo3d._typing import AnyArray, Float32Array
from seismo3d.graph.scalars import ScalarEdges
from seismo3d.seismic._kernels_layer_solve import keep_free
from seismo3d.seismic.blocks.layers import by_box, coarse_shape, read_field, read_grid
from seismo3d.seismic.blocks.medians import BlockMedians
from seismo3d.seismic.blocks.plan import BASE_BYTES, Box, Tiling
from seismo3d.seismic.blocks.room import OnDisk
from seismo3d.seismic.blocks.run import BlockRun
from seismo3d.seismic.fault_links import doubt_matches, link_grid
from seismo3d.seismic.layer_graph import (
    LayerTimeSettings,
    doubt_shifts,
    improve_values,
    list_rounds,
    near_faults,
    nearest_misfit,
    smooth_thickness,
    thickness_variance,
)
from seismo3d.seismic.layer_system import LayerSystem, LinkFields
from seismo3d.seismic.linking import InMemory, Room
from seismo3d.seismic.loop_closure import loop_errors


def link_reach(settings: LayerTimeSettings) -> int:
    """Return how many traces off the links of a trace depend on, rounded up to a stored brick's edge."""
    return -(-(max(settings.lengths) + settings.clear + 1) // 8) * 8


class BrickPoints:
    """A stored array of which single samples are asked for, by arrays of their indices."""

    def __init__(self, run: BlockRun, name: str, shape: tuple[int, int, int]) -> None:
        self._run, self._name, self.shape = run, name, shape

    def __getitem__(self, at: tuple[AnyArray, AnyArray, AnyArray]) -> AnyArray:
        i, j, k = (np.asarray(index) for index in np.broadcast_arrays(*at))
        found: AnyArray | None = None
        for box, chosen in by_box(self._run.plan.tiling("fill"), np.stack([i, j], axis=1), np.ones(len(i), bool)):
            part = self._run.store.read(self._name, box)
            if found is None:
                found = np.zeros(len(i), part.dtype)
            found[chosen] = part[i[chosen] - box.i0, j[chosen] - box.j0, k[chosen]]
        return np.zeros(0, np.float32) if found is None else found


def last_stride(settings: LayerTimeSettings) -> int:
    """Return the stride of the finest graph."""
    return settings.strides[-1]


def values_name(stride: int, number: int) -> str:
    """Return the array that keeps the values after a round."""
    return f"values_{stride}_{number}"


def count_rounds(settings: LayerTimeSettings, stride: int) -> int:
    """Return how many robust rounds there are at a stride."""
    return len(settings.first_cutoffs if stride == settings.strides[0] else settings.cutoffs)


def solve(run: BlockRun, stride: int) -> None:
    """Solve the graph of every stride-th trace, going on after the last round that was finished."""
    settings, usual = run.settings, run.fact("usual")["misfits"]
    rounds = list_rounds(settings, stride, usual)
    n_done = next((n for n in range(len(rounds), 0, -1) if run.knows(_round_name(stride, n - 1))), 0)
    room, at_a_time = _choose_room(run, stride)
    values = room.array(_grid_shape(run, stride), np.float32)
    _begin(run, stride, n_done, values, room)
    system: LayerSystem | None = None
    rejected, loaded = 0.0, 0.0
    spread = thickness_variance(usual, settings)
    for number in range(n_done, len(rounds)):
        doubt, cutoff = rounds[number]
        system = system or _make_system(run, stride, room, at_a_time)
        if loaded != doubt:
            _load(run, stride, doubt, system)
            loaded = doubt
        if number == 0 and stride != settings.strides[0]:
            system.lead(values)
        _expect(run, system, values, stride)
        system.weigh(values, cutoff, spread)
        improve_values(system, values, stride, settings)
        if number == len(rounds) - 1:
            rejected = system.weigh(values, cutoff, spread)
            if stride == last_stride(settings):
                system.bring_to_scale(values)
        _keep(run, stride, number, values, room)
        run.write_fact(_round_name(stride, number), rejected=rejected)
        if number > 0:
            run.store.remove(values_name(stride, number - 1))
    if isinstance(room, OnDisk):
        room.remove()
    run.write_fact(f"solve_{stride}", rejected=run.fact(_round_name(stride, len(rounds) - 1))["rejected"])


def forget_rounds(run: BlockRun, stride: int) -> None:
    """Take a stride for not solved."""
    for number in range(count_rounds(run.settings, stride)):
        run.forget_fact(_round_name(stride, number))
    run.forget_fact(f"solve_{stride}")


def _round_name(stride: int, number: int) -> str:
    return f"round_{stride}_{number}"


def _grid_shape(run: BlockRun, stride: int) -> tuple[int, int, int]:
    n0, n1, m = coarse_shape(run)
    return -(-n0 // stride), -(-n1 // stride), m


def _choose_room(run: BlockRun, stride: int) -> tuple[Room, int]:
    """Return where the solution's arrays are kept: in memory where they fit into a half, else on disk."""
    n_fields = len(_numbers(run.settings, stride))
    size = int(np.prod(_grid_shape(run, stride), dtype=np.int64)) * (12 * n_fields + 40)
    free = run.plan.memory - BASE_BYTES
    return (InMemory(), 2 * size) if 2 * size <= free else (OnDisk(run.work / "solve"), free // 4)


def _tiles(run: BlockRun, stride: int) -> Tiling:
    """Return the parts in which a grid is loaded, kept and looked at: of whole bricks."""
    n0, n1, _ = _grid_shape(run, stride)
    edge = run.plan.edges["links"][0]
    brick = run.plan.brick
    return Tiling((n0, n1), (max(edge // stride // brick * brick, brick),) * 2)


def _begin(run: BlockRun, stride: int, n_done: int, values: Float32Array, room: Room) -> None:
    """Fill in the values of the last round, of the coarser graph, or zero where there is neither."""
    strides, settings = run.settings.strides, run.settings
    place = strides.index(stride)
    for box in _tiles(run, stride):
        part = values[box.i0 : box.i1, box.j0 : box.j1]
        if n_done:
            part[...] = run.store.read(values_name(stride, n_done - 1), box)
        elif place == 0:
            part[...] = 0.0
        else:
            coarse = strides[place - 1]
            name = values_name(coarse, count_rounds(settings, coarse) - 1)
            n0, n1, _ = _grid_shape(run, coarse)
            i, j = (
                np.minimum(np.arange(low, high) // 2, n - 1)
                for low, high, n in ((box.i0, box.i1, n0), (box.j0, box.j1, n1))
            )
            found = run.store.read(name, Box(int(i[0]), int(i[-1]) + 1, int(j[0]), int(j[-1]) + 1))
            part[...] = found[i - i[0]][:, j - j[0]]
        room.rest()


def _keep(run: BlockRun, stride: int, number: int, values: Float32Array, room: Room) -> None:
    """Store the values after a round."""
    name = values_name(stride, number)
    run.store.remove(name)
    run.store.make(name, _grid_shape(run, stride), np.float32)
    for box in _tiles(run, stride):
        run.store.write(name, box, values[box.i0 : box.i1, box.j0 : box.j1])
        room.rest()


def _make_system(run: BlockRun, stride: int, room: Room, at_a_time: int) -> LayerSystem:
    """Return the links of a stride: those across faults, and room for those between traces."""
    shape, settings = _grid_shape(run, stride), run.settings
    kinds = [(n % 2, settings.lengths[n // 2] // stride) for n in _numbers(settings, stride)]
    fields = LinkFields.empty(kinds, shape, room)
    breaks, listed = room.array(shape, np.uint8), _fault_edges(run, stride)
    return LayerSystem.of(fields, breaks, listed, room, step=settings.shifts.step, bytes_at_a_time=at_a_time)


def _numbers(settings: LayerTimeSettings, stride: int) -> list[int]:
    """Return which fields of shifts join traces of a stride."""
    return [n for n in range(2 * len(settings.lengths)) if settings.lengths[n // 2] % stride == 0]


def _load(run: BlockRun, stride: int, doubt: float, system: LayerSystem) -> None:
    """Read the links between the traces of a stride."""
    edge = run.plan.edges["links"][0]
    for box in Tiling(run.plan.shape[:2], (edge, edge)):
        _load_box(run, box, stride, doubt, system)
        system.room.rest()


def _load_box(run: BlockRun, box: Box, stride: int, doubt: float, system: LayerSystem) -> None:
    """Read the links that begin in a box."""
    settings, fields, breaks = run.settings, system.fields, system.breaks
    wide = box.grown((link_reach(settings),) * 2, run.plan.shape)
    cuts = run.store.read("cuts", wide)
    at = tuple(slice(low // stride, -(-high // stride)) for low, high in ((box.i0, box.i1), (box.j0, box.j1)))
    here = (slice(box.i0 - wide.i0, box.i1 - wide.i0, stride), slice(box.j0 - wide.j0, box.j1 - wide.j0, stride))
    breaks[at] = run.store.read("breaks", wide)[here]
    near = near_faults(cuts, (*wide.shape, breaks.shape[2]), doubt, settings)
    for f, number in enumerate(_numbers(settings, stride)):
        found, nearest = read_field(run, wide, number), run.store.read(f"shift{number % 2}_1", wide)
        variance = doubt_shifts(found, near, doubt, settings)
        fields.shift[f][at] = found.shift[here]
        keep_free(
            nearest, cuts, variance, found.axis, found.length, stride, system.step, here[0].start, here[1].start,
            fields.variance[f][at],
        )  # fmt: skip


def _fault_edges(run: BlockRun, stride: int) -> ScalarEdges:
    """Return the edges across all faults, between the vertices of a stride."""
    shape = coarse_shape(run)
    nearest: Any = [BrickPoints(run, f"shift{axis}_1", shape) for axis in range(2)]
    breaks: Any = BrickPoints(run, "breaks", shape)
    parts = [ScalarEdges.none()]
    usual = nearest_misfit(run.fact("usual")["misfits"])
    for number in range(run.fact("faults")["n_surfaces"]):
        found, _ = run.read_part("match", number)
        variance = doubt_matches(found["variance"], usual, run.settings.links)
        parts.append(
            link_grid(
                read_grid(run, number), found["throw"], variance, nearest, breaks,
                stride=stride, step=run.settings.shifts.step,
            )
        )  # fmt: skip
    return ScalarEdges.join(*parts)


def _expect(run: BlockRun, system: LayerSystem, values: Float32Array, stride: int) -> None:
    """Write what links down the traces measure: the thickness of their surroundings in the round before."""
    n0, n1, _ = values.shape
    scale = system.measure_scale(values)
    halo = int(4.0 * run.settings.wide[0] / stride + 0.5) + 1
    for box in _tiles(run, stride):
        wide = box.grown((halo, halo), (n0, n1))
        cut = (slice(wide.i0, wide.i1), slice(wide.j0, wide.j1))
        drawn = scale.draw_out(np.array(values[cut]))
        found = smooth_thickness(drawn, np.array(system.breaks[cut]), run.settings, stride)
        system.thickness[box.i0 : box.i1, box.j0 : box.j1] = found[box.within(wide)]
        system.room.rest()


# ----- how well shifts agree round closed loops


def _read_errors(run: BlockRun, box: Box) -> list[Iterator[Float32Array]]:
    return [_finite(_errors(run, box))]


LOOPS = BlockMedians("loops", "loop_medians", "shifts", _read_errors)
"""The median error of closed loops."""


def loops(run: BlockRun, number: int) -> None:
    """Close the loops that begin in a block."""
    box = run.plan.tiling("shifts").box(number)
    errors = _errors(run, box)
    known = np.isfinite(errors)
    by_trace = np.full(box.shape, np.nan, np.float32)
    closed = known.any(axis=2)
    part = by_trace[: errors.shape[0], : errors.shape[1]]
    if closed.any():
        part[closed] = np.nanmedian(errors[closed], axis=1)
    run.write_part(
        "loops", number,
        {**LOOPS.count([_finite(errors)]), "by_trace": by_trace, "over": np.array((errors > 1.0).sum())},
    )  # fmt: skip


def loops_facts(run: BlockRun) -> None:
    """Find where the median error lies, roughly."""
    run.write_fact("loops", over=int(run.add_up("loops", "over", "shifts")), **LOOPS.locate(run))


def loop_medians_facts(run: BlockRun) -> None:
    """Find the median error."""
    run.write_fact("loop_medians", median=LOOPS.find(run)[0])


def _finite(errors: Float32Array) -> Iterator[Float32Array]:
    return (line[np.isfinite(line)] for line in errors)


def _errors(run: BlockRun, box: Box) -> Float32Array:
    """Return the absolute errors of the loops that begin in a box, as far as the cube has them."""
    settings = run.settings
    wide = box.grown((max(settings.lengths),) * 2, run.plan.shape)
    n = 2 * len(settings.lengths)
    fields = [read_field(run, wide, number) for number in dict.fromkeys((0, 1, n - 2, n - 1))]
    if n == 2:
        fields = fields * 2
    errors = loop_errors(fields, run.store.read("cuts", wide), settings)
    return np.ascontiguousarray(errors[box.within(wide)])
