"""Random problems of the exact solvers: is the answer global, does the certificate say so, how long does it take."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from seismo3d._typing import Float64Array
from seismo3d.geometry.rotations import random_rotation
from seismo3d.registration import _kernels_newton, _kernels_rigid, quadratic
from seismo3d.registration.solvers import Limits, Prior, solve_form, walk

RESTARTS = 30
ORIGIN = Prior(np.eye(3), np.zeros(3))


@dataclass(frozen=True, slots=True)
class SolveFigures:
    """Figures of one class of problems.

    Attributes
    ----------
    name, model : str
    n_problems : int
    global_share : float
        Share of problems where no random restart found a lower value, to 1e-9 of the form's norm.
    worst_excess : float
        Largest value above the best restart's, relative to the form's norm.
    certified_share : float
        Share where the certificate holds; NaN for models without one.
    observable_share : float
        Share of problems whose directions are all observable.
    median_us, newton_us : float
        Median time of a solve with certificate, and of its Newton part, in microseconds; NaN for other models.
    """

    name: str
    model: str
    n_problems: int
    global_share: float
    worst_excess: float
    certified_share: float
    observable_share: float
    median_us: float
    newton_us: float


def _pairs(rng: np.random.Generator, n: int, noise: float) -> tuple[Float64Array, Float64Array, Float64Array]:
    p = rng.normal(size=(n, 3))
    R, t = random_rotation(rng), rng.normal(size=3)
    q = p @ R.T + t + noise * rng.normal(size=(n, 3))
    normals = rng.normal(size=(n, 3))
    return p, q, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def generic(rng: np.random.Generator) -> Float64Array:
    """Return a hundred plane pairs with little noise."""
    p, q, n = _pairs(rng, 100, 0.01)
    return quadratic.plane_form(q, p, n, np.full(100, 0.01))


def few_pairs(rng: np.random.Generator) -> Float64Array:
    """Return seven plane pairs: one more than there are degrees of freedom."""
    p, q, n = _pairs(rng, 7, 0.01)
    return quadratic.plane_form(q, p, n, np.full(7, 1 / 7))


def much_noise(rng: np.random.Generator) -> Float64Array:
    """Return a hundred plane pairs with noise of half their size."""
    p, q, n = _pairs(rng, 100, 0.5)
    return quadratic.plane_form(q, p, n, np.full(100, 0.01))


def outliers(rng: np.random.Generator) -> Float64Array:
    """Return plane and point pairs, 40 % of them thrown at random."""
    p, q, n = _pairs(rng, 100, 0.01)
    q[:40] = 2.0 * rng.normal(size=(40, 3))
    points = quadratic.point_form(q[::4], p[::4], np.full(25, 0.04))
    return quadratic.plane_form(q, p, n, np.full(100, 0.01)) + points


def plane_only(rng: np.random.Generator) -> Float64Array:
    """Return one plane with normals that waver a little."""
    p, q, n = _pairs(rng, 100, 0.0)
    p[:, 2] *= 0.01
    R = random_rotation(rng)
    n = np.array([0.0, 0.0, 1.0]) + 0.02 * rng.normal(size=(100, 3))
    q = p @ R.T + 0.01 * rng.normal(size=(100, 3))
    return quadratic.plane_form(q, p, n @ R.T, np.full(100, 0.01))


def corridor(rng: np.random.Generator) -> Float64Array:
    """Return floor and walls of a corridor: nothing holds along it."""
    p = rng.uniform(-1, 1, size=(100, 3)) * [10.0, 1.0, 1.0]
    n = np.eye(3)[1 + np.arange(100) % 2] + 0.01 * rng.normal(size=(100, 3))
    R = random_rotation(rng)
    q = p @ R.T + 0.01 * rng.normal(size=(100, 3))
    return quadratic.plane_form(q, p / 6.0, n @ R.T, np.full(100, 0.01))


def terrain(rng: np.random.Generator) -> Float64Array:
    """Return rolling ground: normals within some degrees of the vertical."""
    p = rng.uniform(-1, 1, size=(100, 3)) * [1.0, 1.0, 0.1]
    n = np.array([0.0, 0.0, 1.0]) + 0.15 * rng.normal(size=(100, 3))
    R = random_rotation(rng)
    q = p @ R.T + 0.01 * rng.normal(size=(100, 3)) + rng.normal(size=3)
    return quadratic.plane_form(q, p, n @ R.T, np.full(100, 0.01))


def random_form(rng: np.random.Generator) -> Float64Array:
    """Return a random positive form that stems from no scene."""
    root = rng.normal(size=(13, 13))
    return root @ root.T / 13


PROBLEMS: dict[str, Callable[[np.random.Generator], Float64Array]] = {
    "generic": generic,
    "few pairs": few_pairs,
    "much noise": much_noise,
    "40 % outliers": outliers,
    "plane only": plane_only,
    "corridor": corridor,
    "terrain": terrain,
    "random forms": random_form,
}


def measure(name: str, model: str, *, n_problems: int, seed: int = 0) -> SolveFigures:
    """Solve random problems of one class and compare each with many random restarts.

    Parameters
    ----------
    name : str
        One of ``PROBLEMS``.
    model : str
        "rigid", "similarity", "scaled" or "affine".
    n_problems : int
    seed : int
    """
    rng = np.random.default_rng(seed)
    number = ("translation", "rigid", "similarity", "scaled", "affine").index(model)
    m = _kernels_newton.n_parameters(number, 3)
    limits = Limits(np.full(m, -np.inf), np.full(m, np.inf))
    if model in ("similarity", "scaled"):
        limits.low[6:], limits.high[6:] = -np.log(10.0), np.log(10.0)
    excess, certified, seen, times, newton = [], [], [], [], []
    solve_form(generic(rng), model=model, prior=ORIGIN, limits=limits)
    for _ in range(n_problems):
        Q = PROBLEMS[name](rng)
        start = time.perf_counter()
        found = solve_form(Q, model=model, prior=ORIGIN, limits=limits, ratio=0.0)
        times.append(time.perf_counter() - start)
        F, _ = _kernels_rigid.reduce_translation(Q, np.zeros(3))
        norm = float(np.linalg.norm(F))
        excess.append((found.value - _best_restart(Q, F, model, limits, rng)) / norm)
        if found.gap is not None and found.norm is not None:
            certified.append(found.gap <= 1e-8 * found.norm)
            start = time.perf_counter()
            _kernels_rigid.newton_rotation(F, _kernels_rigid.affine_start(F, ORIGIN.A))
            newton.append(time.perf_counter() - start)
        H = _kernels_newton.derivatives(Q, found.A, found.t, number)[2]
        values = np.abs(np.linalg.eigvalsh(H))
        seen.append(values.min() > 1e-6 * values.max())
    observable = np.array(seen)
    gaps = np.array(excess)
    counted = gaps if model == "rigid" else gaps[observable]
    return SolveFigures(
        name,
        model,
        n_problems,
        float((counted <= 1e-9).mean()) if counted.size else float("nan"),
        float(counted.max()) if counted.size else float("nan"),
        float(np.mean(certified)) if certified else float("nan"),
        float(observable.mean()),
        float(np.median(times)) * 1e6,
        float(np.median(newton)) * 1e6 if newton else float("nan"),
    )


def _best_restart(Q: Float64Array, F: Float64Array, model: str, limits: Limits, rng: np.random.Generator) -> float:
    if model == "rigid":
        return min(_kernels_rigid.newton_rotation(F, random_rotation(rng)) for _ in range(RESTARTS))
    best = np.inf
    for _ in range(RESTARTS):
        A = random_rotation(rng) * np.exp(rng.uniform(-1, 1, size=3 if model == "scaled" else 1))
        trial = walk(Q, A, rng.normal(size=3), model=model, prior=ORIGIN, limits=limits, ratio=1e-12)
        best = min(best, trial.value)
    return best


def report(*, n_problems: int, n_scale_problems: int) -> list[SolveFigures]:
    """Print and return the figures of all classes; ``n_scale_problems`` for the models with scale."""
    figures = []
    heads = ("problem", "model", "n", "global", "excess", "certified", "observ.", "us", "newton")
    print("{:14} {:10} {:>6} {:>8} {:>9} {:>9} {:>8} {:>7} {:>7}".format(*heads))
    for model in ("rigid", "similarity", "scaled", "affine"):
        for name in PROBLEMS:
            f = measure(name, model, n_problems=n_problems if model == "rigid" else n_scale_problems)
            figures.append(f)
            print(
                f"{f.name:14} {f.model:10} {f.n_problems:6d} {f.global_share:8.4f} {f.worst_excess:9.1e} "
                f"{f.certified_share:9.4f} {f.observable_share:8.3f} {f.median_us:7.0f} {f.newton_us:7.1f}"
            )
    return figures
