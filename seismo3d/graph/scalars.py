"""A graph of scalars: relative measurements between vertices, solved robustly by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._typing import AnyArray, ArrayLike, BoolArray, Float32Array, Int32Array
from seismo3d._validate import freeze
from seismo3d.errors import ShapeError
from seismo3d.graph._kernels_scalars import (
    apply_normal,
    edge_residuals,
    gather_gradient,
    normal_diagonal,
    robust_weights,
)


@dataclass(frozen=True, slots=True, eq=False)
class ScalarEdges:
    """Relative measurements: value at the second end minus value at the first.

    An end may lie between two vertices: its value is then ``(1 - share) * x[v] + share * x[v + 1]``.

    Attributes
    ----------
    first, second : ndarray of shape (n,), int32
        Vertices at the ends.
    measured, variance : ndarray of shape (n,), float32
        The difference, and its variance, positive.
    first_share, second_share : ndarray of shape (n,), float32
        Share of the next vertex in an end's value, 0 to 1.
    """

    first: Int32Array
    second: Int32Array
    measured: Float32Array
    variance: Float32Array
    first_share: Float32Array
    second_share: Float32Array

    @classmethod
    def from_arrays(
        cls,
        first: ArrayLike,
        second: ArrayLike,
        *,
        measured: ArrayLike,
        variance: ArrayLike = 1.0,
        first_share: ArrayLike = 0.0,
        second_share: ArrayLike = 0.0,
    ) -> ScalarEdges:
        """Gather edges from arrays or scalars that broadcast to one length.

        Raises
        ------
        ShapeError
            If lengths differ, a variance is not positive, or a measurement is not finite.

        Examples
        --------
        >>> edges = ScalarEdges.from_arrays([0, 1], [1, 2], measured=[1.0, 2.0])
        >>> solve_scalars(3, edges).values.round(3).tolist()
        [0.0, 1.0, 3.0]
        """
        numbers = [np.asarray(v, dtype=np.float32) for v in (measured, variance, first_share, second_share)]
        ends = [np.asarray(v, dtype=np.int32) for v in (first, second)]
        try:
            arrays = np.broadcast_arrays(*ends, *numbers)
        except ValueError as error:
            shapes = ", ".join(str(v.shape) for v in (*ends, *numbers))
            raise ShapeError(
                f"edges have arrays of shapes {shapes}; expected one length. Give one row an edge."
            ) from error
        if arrays[0].ndim != 1:
            raise ShapeError(f"edges have arrays of shape {arrays[0].shape}; expected (n,). Give one row an edge.")
        if not (np.isfinite(arrays[2]).all() and (arrays[3] > 0).all()):
            raise ShapeError(
                "edges have measurements that are not finite or variances that are not positive. Drop them."
            )
        return cls(*(np.ascontiguousarray(array) for array in arrays))

    @classmethod
    def none(cls) -> ScalarEdges:
        """Return no edges."""
        return cls.from_arrays([], [], measured=[])

    def __len__(self) -> int:
        return len(self.first)

    @classmethod
    def join(cls, *parts: ScalarEdges) -> ScalarEdges:
        """Return the edges of all parts, one after the other."""
        names = ("first", "second", "measured", "variance", "first_share", "second_share")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True, slots=True)
class SolveSettings:
    """How a graph is solved.

    Attributes
    ----------
    cutoffs : tuple of float
        One robust round each: residuals of this many standard deviations have a quarter of their weight; infinity is
        plain least squares.
    iterations : int
        Most steps of conjugate gradients a round.
    tolerance : float
        Size of the gradient, relative to that at the start of the round, at which a round ends.
    """

    cutoffs: tuple[float, ...] = (np.inf, 4.0, 3.0)
    iterations: int = 200
    tolerance: float = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class ScalarSolution:
    """Values at the vertices, and how the edges agree with them.

    Attributes
    ----------
    values : ndarray of shape (n_vertices,), float32
        One value a vertex. Each connected part keeps the weighted mean of its start.
    residuals : ndarray of shape (n_edges,), float32
        What is measured minus what is found, in standard deviations.
    rejected : ndarray of shape (n_edges,), bool
        Edges beyond the last cutoff.
    converged : bool
        Every round reached its tolerance.
    """

    values: Float32Array
    residuals: Float32Array
    rejected: BoolArray
    converged: bool


def solve_scalars(
    n_vertices: int, edges: ScalarEdges, *, start: ArrayLike | None = None, settings: SolveSettings | None = None
) -> ScalarSolution:
    r"""Find the values at the vertices that agree best with all relative measurements.

    Minimises :math:`\sum_e \rho((m_e - x_{b(e)} + x_{a(e)}) / \sigma_e)` by iteratively reweighted least squares
    with the kernel of Geman and McClure; each round by conjugate gradients scaled by the diagonal [1]_, which need no
    more memory than a few vectors beside the edges. What the measurements leave open stays as in the start.

    Parameters
    ----------
    n_vertices : int
        Number of vertices.
    edges : ScalarEdges
        The measurements.
    start : array_like of shape (n_vertices,), optional
        Values to start from. Default: zero, then shifted so that vertex 0 is zero.
    settings : SolveSettings, optional
        Rounds and tolerances.

    Returns
    -------
    ScalarSolution

    Raises
    ------
    ShapeError
        If an edge ends at no vertex, or the start has another length.

    References
    ----------
    .. [1] J. R. Shewchuk, An introduction to the conjugate gradient method without the agonizing pain, CMU, 1994.
    """
    settings = settings or SolveSettings()
    _check(n_vertices, edges, start)
    values = np.zeros(n_vertices, np.float32) if start is None else np.array(start, dtype=np.float32)
    ends = (edges.first, edges.second, edges.first_share, edges.second_share)
    residuals, weight = np.empty(len(edges), np.float32), np.empty(len(edges), np.float32)
    converged = True
    for cutoff in settings.cutoffs:
        edge_residuals(values, *ends, edges.measured, residuals)
        robust_weights(residuals, edges.variance, np.float32(cutoff), weight)
        step, reached = _conjugate_gradients(n_vertices, ends, weight, residuals, settings)
        values += step
        converged &= reached
    if start is None:
        values -= values[0]
    edge_residuals(values, *ends, edges.measured, residuals)
    residuals /= np.sqrt(edges.variance)
    rejected = np.abs(residuals) > settings.cutoffs[-1]
    return ScalarSolution(freeze(values), freeze(residuals), freeze(rejected), converged)


def _check(n_vertices: int, edges: ScalarEdges, start: ArrayLike | None) -> None:
    if start is not None and np.shape(start) != (n_vertices,):
        raise ShapeError(f"start has shape {np.shape(start)}; expected ({n_vertices},), one value a vertex.")
    for end, share in ((edges.first, edges.first_share), (edges.second, edges.second_share)):
        if len(edges) and (end.min() < 0 or int((end + (share > 0)).max()) >= n_vertices):
            raise ShapeError(
                f"edges end at vertex {int(end.min())} to {int(end.max())}; expected 0 to {n_vertices - 1}."
            )


def _conjugate_gradients(
    n: int, ends: tuple[AnyArray, ...], weight: Float32Array, residuals: Float32Array, settings: SolveSettings
) -> tuple[Float32Array, bool]:
    """Return the step that solves one weighted round, and whether the tolerance was reached."""
    first, second, first_share, second_share = ends
    scale = np.empty(n, np.float32)
    normal_diagonal(first, second, first_share, second_share, weight, scale)
    np.divide(np.float32(1.0), scale, out=scale, where=scale > 0)
    gradient, product = np.empty(n, np.float32), np.empty(n, np.float32)
    gather_gradient(first, second, first_share, second_share, weight * residuals, gradient)
    step = np.zeros(n, np.float32)
    direction = scale * gradient
    energy = start = float(np.dot(gradient.astype(np.float64), direction))
    for _ in range(settings.iterations):
        if energy <= settings.tolerance**2 * start or energy <= 0.0:
            return step, True
        apply_normal(direction, first, second, first_share, second_share, weight, product)
        length = np.float32(energy / max(float(np.vdot(direction, product)), 1e-30))
        step += length * direction
        gradient -= length * product
        np.multiply(scale, gradient, out=product)
        last, energy = energy, float(np.vdot(gradient, product))
        direction *= np.float32(energy / last)
        direction += product
    return step, energy <= settings.tolerance**2 * start
