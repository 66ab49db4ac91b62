r"""Poses from relative poses: the sparse, robust solve of a pose graph.

Each edge says where one pose is seen from another, :math:`Z_{ij} \approx T_i^{-1} T_j`, with an information matrix. The
sum over the edges of :math:`\rho(e^T \Omega e)`, :math:`e = \log(Z_{ij}^{-1} T_i^{-1} T_j)`, is minimised over all
poses by Levenberg and Marquardt's method on SE(3) with a sparse factorisation. Edges that may be wrong (loop closures)
go through the Geman-McClure kernel, whose closed form is that of dynamically scaled covariances [1]_; the scale starts
wide and shrinks (graduated non-convexity), so that a closure that agrees with the others isn't lost to a bad start.

Tangent vectors are (rotation, translation). Perturbations of the poses are on the right here, in each pose's own frame,
where relative poses are simple.

References
----------
.. [1] P. Agarwal et al., "Robust map optimization using dynamic covariance scaling", ICRA 2013.
   :doi:`10.1109/ICRA.2013.6630557`
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seismo3d._typing import BoolArray, Float64Array, Int64Array
from seismo3d._validate import as_number, as_whole_number, freeze
from seismo3d.errors import FormatError, GeometryError, ParameterError, ShapeError
from seismo3d.geometry.rotations import (
    adjoint,
    exp_rotation,
    left_jacobian,
    log_rotation,
    make_transform,
    quaternion_from_rotation,
    rotation_from_quaternion,
    skew,
)
from seismo3d.io._files import as_readable_file, written_aside


@dataclass(frozen=True, slots=True, eq=False)
class PoseGraph:
    """Poses and the edges between them.

    Attributes
    ----------
    poses : ndarray of shape (n, 4, 4), float64
        ``T_world_pose``.
    edges : ndarray of shape (m, 2), int64
        Rows (i, j) of poses.
    measured : ndarray of shape (m, 4, 4), float64
        ``T_i_j`` of each edge.
    information : ndarray of shape (m, 6, 6), float64
        Inverse covariance of a perturbation on the right of ``measured``, (rotation, translation).
    doubtful : ndarray of shape (m,), bool
        Edges that may be wrong.
    """

    poses: Float64Array
    edges: Int64Array
    measured: Float64Array
    information: Float64Array
    doubtful: BoolArray

    @classmethod
    def of(
        cls, poses: Sequence[Float64Array], edges: Sequence[tuple[int, int, Float64Array, Float64Array, bool]]
    ) -> PoseGraph:
        """Return the graph of poses (4, 4) and edges (i, j, T_i_j, information, doubtful).

        Raises
        ------
        ShapeError
            If an edge names a pose that isn't there, or a matrix has the wrong shape.
        """
        n = len(poses)
        for k, (i, j, T, W, _) in enumerate(edges):
            if not (0 <= i < n and 0 <= j < n and i != j):
                raise ShapeError(f"edge {k} joins {i} and {j}; expected two different poses of 0 to {n - 1}.")
            if np.shape(T) != (4, 4) or np.shape(W) != (6, 6):
                raise ShapeError(f"edge {k} has shapes {np.shape(T)}, {np.shape(W)}; expected (4, 4) and (6, 6).")
        return cls(
            freeze(np.array(poses, dtype=np.float64).reshape(-1, 4, 4)),
            freeze(np.array([(i, j) for i, j, *_ in edges], dtype=np.int64).reshape(-1, 2)),
            freeze(np.array([T for _, _, T, _, _ in edges], dtype=np.float64).reshape(-1, 4, 4)),
            freeze(np.array([W for *_, W, _ in edges], dtype=np.float64).reshape(-1, 6, 6)),
            freeze(np.array([d for *_, d in edges], dtype=bool)),
        )


@dataclass(frozen=True, slots=True, eq=False)
class SolvedPoses:
    """The answer.

    Attributes
    ----------
    poses : ndarray of shape (n, 4, 4), float64
    weights : ndarray of shape (m,), float64
        What the kernel left of each edge, 0 to 1.
    chi2 : float
        Sum of the weighted squared errors.
    converged : bool
    n_steps : int
    """

    poses: Float64Array
    weights: Float64Array
    chi2: float
    converged: bool
    n_steps: int


def solve_poses(
    graph: PoseGraph, *, fixed: Sequence[int] = (0,), kernel_width: float = 5.0, max_steps: int = 100
) -> SolvedPoses:
    """Find the poses that fit all edges best.

    Parameters
    ----------
    graph : PoseGraph
        Its poses are the start.
    fixed : sequence of int
        Poses that stay. Parts of the graph that hang on none of them stay at their start where nothing moves them.
    kernel_width : float
        A doubtful edge of so many standard deviations' error keeps a quarter of its weight.
    max_steps : int

    Returns
    -------
    SolvedPoses

    Raises
    ------
    GeometryError
        If no pose is fixed.
    ParameterError
        If one is that the graph has not.
    """
    as_number(kernel_width, "kernel_width", low=0.0, strict=True)
    if len(fixed) == 0:
        raise GeometryError("fixed names no pose; expected at least one: relative poses leave the whole free.")
    T = graph.poses.copy()
    if len(graph.edges) == 0:
        return SolvedPoses(freeze(T), np.ones(0), 0.0, True, 0)
    for pose in fixed:
        as_whole_number(pose, "fixed", low=0, high=len(T) - 1)
    free = np.setdiff1d(np.arange(len(T)), np.asarray(fixed))
    errors = edge_errors(graph, T)
    squared = _squares(graph, errors)
    worst = np.sqrt(squared[graph.doubtful].max(initial=0.0))
    width, damping, steps, small = max(kernel_width, worst), 1e-6, 0, False
    while steps < max_steps:
        steps += 1
        weights = _kernel_weights(graph, squared, width)
        H, g = _normal_equations(graph, T, errors, weights, free)
        for _ in range(12):
            move = _solve_damped(H, g, damping)
            trial = _moved(T, free, move)
            new_errors = edge_errors(graph, trial)
            new_squared = _squares(graph, new_errors)
            if _cost(graph, new_squared, width) <= _cost(graph, squared, width) * (1.0 + 1e-12) + 1e-30:
                damping = max(damping * 0.2, 1e-12)
                break
            damping = max(damping * 10.0, 1e-9)
        else:
            move = np.zeros_like(g)
            trial, new_errors, new_squared = T, errors, squared
        T, errors, squared = trial, new_errors, new_squared
        small = bool(np.abs(move).max(initial=0.0) < 1e-9)
        if small and width <= kernel_width:
            break
        if small or steps % 3 == 0:
            width = max(kernel_width, 0.5 * width)
    weights = _kernel_weights(graph, squared, width)
    return SolvedPoses(freeze(T), freeze(weights), float((weights * squared).sum()), small, steps)


def edge_errors(graph: PoseGraph, poses: Float64Array) -> Float64Array:
    """Errors (m, 6) of the edges at some poses: the motion that is left, (rotation, translation)."""
    i, j = graph.edges.T
    left = _inverse(graph.measured) @ _inverse(poses[i]) @ poses[j]
    out = np.empty((len(left), 6))
    for k, T in enumerate(left):
        out[k, :3] = log_rotation(T[:3, :3])
        out[k, 3:] = np.linalg.solve(left_jacobian(out[k, :3]), T[:3, 3])
    return out


def write_g2o(path: str | Path, graph: PoseGraph, *, fixed: Sequence[int] = (0,)) -> Path:
    """Write a graph in g2o's text format: VERTEX_SE3:QUAT, EDGE_SE3:QUAT, FIX.

    g2o's information is ordered (translation, rotation), its rotation in halves of the rotation vector (the vector part
    of the quaternion); both are turned round here and in :func:`read_g2o`.

    Parameters
    ----------
    path : str or Path
    graph : PoseGraph
    fixed : sequence of int

    Returns
    -------
    Path
        The file.
    """
    lines = [f"VERTEX_SE3:QUAT {i} {_words(T)}" for i, T in enumerate(graph.poses)]
    lines += [f"FIX {i}" for i in fixed]
    upper = np.triu_indices(6)
    for (i, j), T, W in zip(graph.edges, graph.measured, graph.information):
        numbers = " ".join(f"{v:.9g}" for v in _to_g2o(W)[upper])
        lines.append(f"EDGE_SE3:QUAT {i} {j} {_words(T)} {numbers}")
    with written_aside(path) as aside:
        aside.write_text("\n".join(lines) + "\n", encoding="ascii")
    return Path(path)


def read_g2o(path: str | Path) -> PoseGraph:
    """Read a graph in g2o's text format; edges between poses that don't follow each other count as doubtful.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    PoseGraph
        Poses in the order of their numbers.

    Raises
    ------
    FileAccessError, FormatError
        If the file cannot be read, or holds a line that is not of the format.
    """
    file = as_readable_file(path)
    vertices: dict[int, Float64Array] = {}
    edges: list[tuple[int, int, Float64Array, Float64Array]] = []
    upper = np.triu_indices(6)
    for number, line in enumerate(file.read_text(encoding="utf-8", errors="replace").splitlines(), start=1):
        words = line.split()
        if not words or words[0] in ("FIX", "#"):
            continue
        if (words[0], len(words)) not in (("VERTEX_SE3:QUAT", 9), ("EDGE_SE3:QUAT", 31)):
            raise FormatError(
                f"{file.name}, line {number}: {line[:60]!r}; expected VERTEX_SE3:QUAT, EDGE_SE3:QUAT or FIX."
            )
        try:
            if words[0] == "VERTEX_SE3:QUAT":
                vertices[int(words[1])] = _from_words(words[2:])
            else:
                W = np.zeros((6, 6))
                W[upper] = [float(w) for w in words[10:]]
                W = W + np.triu(W, 1).T
                edges.append((int(words[1]), int(words[2]), _from_words(words[3:10]), _from_g2o(W)))
        except ValueError as error:
            raise FormatError(f"{file.name}, line {number}: {error}; expected numbers. Write it again.") from error
    order = {name: k for k, name in enumerate(sorted(vertices))}
    missing = next((k for i, j, *_ in edges for k in (i, j) if k not in order), None)
    if missing is not None:
        raise FormatError(
            f"{file.name} has an edge to vertex {missing}, which it does not list. Write the whole graph again."
        )
    placed = [(order[i], order[j], T, W, abs(order[i] - order[j]) != 1) for i, j, T, W in edges]
    try:
        return PoseGraph.of([vertices[name] for name in sorted(vertices)], placed)
    except (ShapeError, ParameterError) as error:
        raise FormatError(f"{file.name} is no graph of poses: {error} Write it again.") from error


def _inverse(T: Float64Array) -> Float64Array:
    out = np.zeros_like(T)
    turned = np.swapaxes(T[:, :3, :3], 1, 2)
    out[:, :3, :3] = turned
    out[:, :3, 3] = -np.einsum("nij,nj->ni", turned, T[:, :3, 3])
    out[:, 3, 3] = 1.0
    return out


def _squares(graph: PoseGraph, errors: Float64Array) -> Float64Array:
    return np.asarray(np.einsum("ni,nij,nj->n", errors, graph.information, errors))


def _kernel_weights(graph: PoseGraph, squared: Float64Array, width: float) -> Float64Array:
    weights = (1.0 + squared / width**2) ** -2.0
    return np.where(graph.doubtful, weights, 1.0)


def _cost(graph: PoseGraph, squared: Float64Array, width: float) -> float:
    robust = squared / (1.0 + squared / width**2)
    return float(np.where(graph.doubtful, robust, squared).sum())


def _normal_equations(
    graph: PoseGraph, T: Float64Array, errors: Float64Array, weights: Float64Array, free: Int64Array
) -> tuple[Any, Float64Array]:
    """Sparse H and g of the free poses, for perturbations on the right of the poses."""
    from scipy.sparse import coo_array

    place = np.full(len(T), -1)
    place[free] = np.arange(len(free))
    rows, columns, values = [], [], []
    g = np.zeros((len(free), 6))
    block_rows, block_columns = (a.ravel() for a in np.meshgrid(np.arange(6), np.arange(6), indexing="ij"))
    between = _inverse(T[graph.edges[:, 1]]) @ T[graph.edges[:, 0]]
    for (i, j), error, W, weight, T_j_i in zip(graph.edges, errors, graph.information, weights, between):
        J_j = _right_jacobian_inverse(error)
        J = {int(place[i]): -J_j @ adjoint(T_j_i), int(place[j]): J_j}
        for a, J_a in J.items():
            if a < 0:
                continue
            WJ = weight * W @ J_a
            g[a] += WJ.T @ error
            for b, J_b in J.items():
                if b >= 0:
                    rows.append(6 * a + block_rows)
                    columns.append(6 * b + block_columns)
                    values.append((WJ.T @ J_b).ravel())
    size = 6 * len(free)
    if not values:
        return coo_array((size, size)).tocsc(), g.ravel()
    triplets = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return coo_array(triplets, shape=(size, size)).tocsc(), g.ravel()


def _solve_damped(H: Any, g: Float64Array, damping: float) -> Float64Array:
    from scipy.sparse import diags_array
    from scipy.sparse.linalg import splu

    diagonal = H.diagonal()
    floor = 1e-9 * max(float(diagonal.max(initial=0.0)), 1e-12)
    return np.asarray(splu((H + diags_array(damping * diagonal + floor)).tocsc()).solve(-g))


def _moved(T: Float64Array, free: Int64Array, move: Float64Array) -> Float64Array:
    out = T.copy()
    for k, step in zip(free, move.reshape(-1, 6)):
        motion = make_transform(exp_rotation(step[:3]), left_jacobian(step[:3]) @ step[3:])
        out[k] = out[k] @ motion
    return out


def _right_jacobian_inverse(error: Float64Array) -> Float64Array:
    """Inverse of the right Jacobian of SE(3), to second order in the error."""
    small = np.zeros((6, 6))
    small[:3, :3] = small[3:, 3:] = skew(error[:3])
    small[3:, :3] = skew(error[3:])
    return np.asarray(np.eye(6) + 0.5 * small + small @ small / 12.0)


def _to_g2o(W: Float64Array) -> Float64Array:
    """Information in g2o's order and scale: its rotation is half of ours, so that its information is four times."""
    S = np.zeros((6, 6))
    S[:3, 3:] = 2.0 * np.eye(3)
    S[3:, :3] = np.eye(3)
    return np.asarray(S.T @ W @ S)


def _from_g2o(W: Float64Array) -> Float64Array:
    S = np.zeros((6, 6))
    S[3:, :3] = 0.5 * np.eye(3)
    S[:3, 3:] = np.eye(3)
    return np.asarray(S.T @ W @ S)


def _words(T: Float64Array) -> str:
    w, x, y, z = quaternion_from_rotation(T[:3, :3])
    return " ".join(f"{v:.12g}" for v in (*T[:3, 3], x, y, z, w))


def _from_words(words: list[str]) -> Float64Array:
    x, y, z, qx, qy, qz, qw = (float(word) for word in words)
    return make_transform(rotation_from_quaternion([qw, qx, qy, qz]), [x, y, z])
