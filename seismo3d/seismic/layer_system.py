"""The equations of the layer graph on its grid: in memory, or mapped from disk and worked on some rows at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numba
import numpy as np

from seismo3d._typing import AnyArray, Float32Array, Float64Array, Int64Array
from seismo3d.graph.groups import GroupCorrection
from seismo3d.graph.scalars import ScalarEdges
from seismo3d.seismic._kernels_layer_scale import UNIT, count_levels, draw_out, find_span
from seismo3d.seismic._kernels_layer_solve import (
    DIAGONAL,
    GRADIENT,
    NORMAL,
    advance,
    begin_rows,
    find_heads,
    pull_rows,
    turn,
    weigh_links,
    weigh_samples,
)
from seismo3d.seismic._kernels_layer_start import lead_traces
from seismo3d.seismic.linking import Room

# share of the first gradient, in the norm of its preconditioner, at which a solution is near enough
_TOLERANCE = 3e-3
# bins of layer time in which its scale is kept; where but this share of the traces or fewer pass it stays as it is
_BINS, _FEW = 4096, 0.005
# bytes of a vertex in the arrays of the solution: five vectors, and room for the pages of their neighbours
_VECTOR_BYTES = 40
# most rows of the normal matrix that a thread works on in one go
_ROWS = 16
# vertices below which a thread more costs more time than it saves
_LEAST_SHARE = 1 << 14
_NO_MOVES: Float64Array = np.zeros(0)


@dataclass(frozen=True, slots=True, eq=False)
class LinkFields:
    """Links from every vertex to the trace so many further along an axis.

    Attributes
    ----------
    axes, hops : ndarray of shape (field,), int64
        0 for rows, 1 for the traces of a row; and how many of them on.
    shift, variance, weight : ndarray of shape (field, row, trace, coarse sample), float32
        What a link measures; its variance, infinite where there is none; its weight in the round.
    """

    axes: Int64Array
    hops: Int64Array
    shift: Float32Array
    variance: Float32Array
    weight: Float32Array

    @classmethod
    def empty(cls, kinds: list[tuple[int, int]], shape: tuple[int, int, int], room: Room) -> LinkFields:
        """Make fields of these axes and hops, to be written to."""
        axes, hops = np.array(kinds, np.int64).reshape(-1, 2).T.copy()
        return cls(axes, hops, *(room.array((len(kinds), *shape), np.float32) for _ in range(3)))


@dataclass(frozen=True, slots=True, eq=False)
class FaultLinks:
    """Links across faults, listed, and their ends in the order of the rows that they lie in."""

    vertices: Int64Array
    shares: Float32Array
    measured: Float32Array
    variance: Float32Array
    weight: Float32Array
    ends: Int64Array
    first_of_row: Int64Array

    @classmethod
    def from_edges(cls, edges: ScalarEdges, shape: tuple[int, int, int]) -> FaultLinks:
        """Sort the ends of edges between vertices of a grid."""
        vertices = np.stack([edges.first, edges.second]).astype(np.int64)
        rows = (vertices.T // (shape[1] * shape[2])).ravel()
        ends = np.argsort(rows, kind="stable")
        first = np.searchsorted(rows[ends], np.arange(shape[0] + 1)).astype(np.int64)
        shares = np.stack([edges.first_share, edges.second_share])
        return cls(vertices, shares, edges.measured, edges.variance, np.zeros(len(edges), np.float32), ends, first)


@dataclass(frozen=True, slots=True, eq=False)
class TimeScale:
    """What layer times become where layers are as thick as they say; from :meth:`LayerSystem.measure_scale`.

    Attributes
    ----------
    low, width : float
        The first of a row of layer times, and how far they are apart.
    drawn : ndarray of shape (n,), float64
        What each of them becomes.
    step : int
        Samples from a vertex to the next.
    """

    low: float
    width: float
    drawn: Float64Array
    step: int

    def draw_out(self, values: Float32Array) -> Float32Array:
        """Bring values, layer time less sample, to scale in place, and return them."""
        draw_out(values, self.step, self.low, self.width, self.drawn)
        return values


@dataclass(frozen=True, slots=True, eq=False)
class LayerSystem:
    """A layer graph at one stride.

    Attributes
    ----------
    fields : LinkFields
        Links between traces.
    breaks : ndarray of shape (row, trace, coarse sample), uint8
        As in :class:`~seismo3d.seismic.layer_graph.LayerGraph`.
    faults : FaultLinks
        Links across faults.
    thickness, down : ndarray of the same shape, float32
        What links down a trace measure, and their weight in the round.
    room : Room
        Where the vectors of a solution are kept.
    step : int
        Samples from a vertex to the next.
    bytes_at_a_time : int
        Memory that the rows worked on between two rests may take.
    """

    fields: LinkFields
    breaks: AnyArray
    faults: FaultLinks
    thickness: Float32Array
    down: Float32Array
    room: Room
    step: int
    bytes_at_a_time: int

    @classmethod
    def of(
        cls, fields: LinkFields, breaks: AnyArray, listed: ScalarEdges, room: Room, *, step: int,
        bytes_at_a_time: int = 2**62,
    ) -> LayerSystem:  # fmt: skip
        """Put together the links of fields and listed ones."""
        shape: tuple[int, int, int] = (breaks.shape[0], breaks.shape[1], breaks.shape[2])
        thickness, down = (room.array(shape, np.float32) for _ in range(2))
        faults = FaultLinks.from_edges(listed, shape)
        return cls(fields, breaks, faults, thickness, down, room, step, bytes_at_a_time)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rows, traces of a row, and coarse samples."""
        n0, n1, m = self.breaks.shape
        return n0, n1, m

    def slabs(self) -> Iterator[tuple[int, int]]:
        """Give the first and last row of parts that fit into memory, which is given back after each."""
        n0, n1, m = self.shape
        row = n1 * m * (_VECTOR_BYTES + 8 * len(self.fields.axes) + 9)
        hops = 2 * int(self.fields.hops.max(initial=0))
        rows = max(1, self.bytes_at_a_time // row - hops)
        for start in range(0, n0, rows):
            yield start, min(start + rows, n0)
            if rows < n0:
                self.room.rest()

    def measure_scale(self, values: Float32Array) -> TimeScale:
        r"""Find how thick layers are on the mean over all traces, from one layer time to the next.

        Links between traces hold for any growing function of layer time, and the thickness of layers is that of their
        surroundings the round before. So where links are at odds with each other, in noise, all draws together: the
        less layer time grows, the less they are off. Where :math:`n` samples lie in a bin of layer time, which
        :math:`m` traces cover, it would grow by :math:`n / m` samples to be to scale.
        """
        low, high = np.inf, -np.inf
        for start, stop in self.slabs():
            least, most = find_span(values[start:stop], self.step)
            low, high = min(low, least), max(high, most)
        width = max((high - low) / _BINS, 1e-9)
        samples, covered = np.zeros((2, _BINS), np.int64)
        for start, stop in self.slabs():
            count_levels(values[start:stop], self.breaks[start:stop], self.step, low, width, samples, covered)
        few = UNIT * _FEW * values.shape[0] * values.shape[1]
        growth = (self.step * samples + few * width) / (covered + few)
        return TimeScale(low, width, low + np.append(0.0, np.cumsum(growth)), self.step)

    def bring_to_scale(self, values: Float32Array) -> None:
        """Draw layer time out, in place, until layers are as thick as it says."""
        scale = self.measure_scale(values)
        for start, stop in self.slabs():
            scale.draw_out(values[start:stop])

    def pull(
        self, kind: int, values: Float32Array, start: int, stop: int, out: Float32Array, other: Float32Array,
        sums: Float64Array,
    ) -> None:  # fmt: skip
        """Write rows of the normal matrix times values, of the gradient at them, or of the diagonal."""
        fields, faults = self.fields, self.faults
        links = (fields.shift, fields.weight, fields.axes, fields.hops)
        listed = (
            faults.vertices, faults.shares, faults.measured, faults.weight, faults.ends, faults.first_of_row,
        )  # fmt: skip
        down = (self.thickness, self.down)
        rows = max(1, min(_ROWS, (stop - start) // numba.get_num_threads()))
        pull_rows(values, links, self.breaks, self.step, down, listed, start, stop, rows, kind, out, other, sums)

    def lead(self, values: Float32Array) -> None:
        """Start the traces that a graph of every second one did not have, in place, where their links lead.

        A trace that starts with the value of one beyond a fault is so far off that all its links count as wrong.
        """
        fields = self.fields
        nearest = [int(np.flatnonzero((fields.axes == axis) & (fields.hops == 1))[0]) for axis in (0, 1)]
        rows, columns = ((fields.shift[f], fields.variance[f]) for f in nearest)
        for crossed in (False, True):
            for start, stop in self.slabs():
                lead_traces(values, rows, columns, self.breaks, self.step, start, stop, crossed)

    def weigh(self, values: Float32Array, cutoff: float, variance: float) -> float:
        """Weigh every link by how well values fit it; return the share of those beyond the cutoff."""
        with _fitting_threads(values.size):
            return self._weigh(values, cutoff, variance)

    def improve(
        self, values: Float32Array, iterations: int, *, grouped: bool = False, tolerance: float = _TOLERANCE
    ) -> None:
        """Take values, in place, to the least squares of the weighted links.

        By conjugate gradients, in each step of which every trace's own equations are solved, and, if asked for, those
        of groups of vertices. They end after so many steps, or where this share of the first gradient is left.
        """
        with _fitting_threads(values.size):
            self._improve(values, iterations, self._group() if grouped else None, tolerance)

    def _group(self) -> GroupCorrection:
        """Group the vertices that links hold together; links are taken to end at the nearest vertex."""
        number = np.arange(self.breaks.size, dtype=np.int32).reshape(self.shape)
        fields, found = self.fields, []
        for f, (axis, hop) in enumerate(zip(fields.axes, fields.hops, strict=True)):
            heads = np.empty(self.shape, np.int32)
            find_heads(fields.shift[f], fields.weight[f], self.breaks, axis, hop, self.step, heads)
            held = heads >= 0
            found.append((number[held], heads[held], fields.weight[f][held]))
        tied = self.down[:, :, :-1] > 0
        found.append((number[:, :, :-1][tied], number[:, :, 1:][tied], self.down[:, :, :-1][tied]))
        ends = self.faults.vertices + (self.faults.shares > 0.5)
        found.append((*ends, self.faults.weight))
        first, second, weight = (np.concatenate([part[n] for part in found]) for n in range(3))
        return GroupCorrection.of(first, second, weight.astype(np.float64), self.breaks.size)

    def _weigh(self, values: Float32Array, cutoff: float, variance: float) -> float:
        limit = np.float32(cutoff)
        fields = self.fields
        counts = np.zeros((len(fields.axes) + 1, self.shape[0], 2), np.int64)
        for start, stop in self.slabs():
            for f, found in enumerate(counts[:-1]):
                weigh_links(
                    values, fields.shift[f], fields.variance[f], self.breaks, fields.axes[f], fields.hops[f], self.step,
                    limit, start, stop, fields.weight[f], found,
                )  # fmt: skip
            weigh_samples(
                values, self.thickness, self.breaks, np.float32(variance), limit, start, stop, self.down, counts[-1]
            )
        n_links, n_beyond = counts.sum(axis=(0, 1))
        n_beyond += self._weigh_faults(values, limit)
        return float(n_beyond / max(1, n_links + len(self.faults.measured)))

    def _weigh_faults(self, values: Float32Array, cutoff: np.float32) -> int:
        """Weigh the links across faults; return how many lie beyond the cutoff."""
        faults, flat = self.faults, values.reshape(-1)
        n_beyond = 0
        for begin in range(0, len(faults.measured), self.room.most):
            part = slice(begin, begin + self.room.most)
            at, share = faults.vertices[:, part], faults.shares[:, part]
            value = np.where(share > 0, (1 - share) * flat[at] + share * flat[at + (share > 0)], flat[at])
            residual = faults.measured[part] - (value[1] - value[0])
            spread = faults.variance[part]
            shrink = 1 / (1 + residual**2 / spread / (cutoff * cutoff))
            faults.weight[part] = shrink * shrink / spread
            n_beyond += int((np.abs(residual) > cutoff * np.sqrt(spread)).sum())
            self.room.rest()
        return n_beyond

    def _improve(self, values: Float32Array, iterations: int, groups: GroupCorrection | None, tolerance: float) -> None:
        gradient, pivots, step, direction, product = (self.room.array(self.shape, np.float32) for _ in range(5))
        sums: Float64Array = np.zeros(self.shape[0])
        for start, stop in self.slabs():
            self.pull(DIAGONAL, values, start, stop, pivots, values, sums)
            self.pull(GRADIENT, values, start, stop, gradient, values, sums)
            begin_rows(pivots, self.down, gradient, start, stop, step, direction, sums)
        moves, pulled = groups.solve(gradient) if groups else (_NO_MOVES, 0.0)
        energy = first = float(sums.sum()) + pulled
        if groups:
            groups.add(moves, direction)
        for _ in range(iterations):
            if energy <= tolerance**2 * first or energy <= 0.0:
                break
            for start, stop in self.slabs():
                self.pull(NORMAL, direction, start, stop, product, direction, sums)
            length = np.float32(energy / max(float(sums.sum()), 1e-30))
            for start, stop in self.slabs():
                advance(length, direction, product, pivots, self.down, start, stop, step, gradient, sums)
            moves, pulled = groups.solve(gradient) if groups else (_NO_MOVES, 0.0)
            last, energy = energy, float(sums.sum()) + pulled
            factor = np.float32(energy / last)
            for start, stop in self.slabs():
                turn(factor, product, start, stop, direction)
            if groups:
                groups.add(moves, direction)
        for start, stop in self.slabs():
            values[start:stop] += step[start:stop]


@contextmanager
def _fitting_threads(n_vertices: int) -> Iterator[None]:
    """Work on no more threads than so many vertices are worth; the result does not depend on them."""
    before = numba.get_num_threads()
    numba.set_num_threads(max(1, min(before, n_vertices // _LEAST_SHARE)))
    try:
        yield
    finally:
        numba.set_num_threads(before)
