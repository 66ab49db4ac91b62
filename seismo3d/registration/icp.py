"""The fused loop, from coarse to fine: match surfaces, weigh, solve, extrapolate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from seismo3d._typing import Float32Array, Float64Array, Int32Array
from seismo3d.geometry.voxels import VoxelMap
from seismo3d.registration._kernels_newton import weakest_share
from seismo3d.registration.acceleration import Accelerator
from seismo3d.registration.agreement import agreed_form, agreement, holding_form
from seismo3d.registration.constraints import model_number
from seismo3d.registration.matching import NONE_GIVEN, Pass, match_surface
from seismo3d.registration.projective import PixelTable
from seismo3d.registration.quadratic import stack
from seismo3d.registration.robust import TUKEY
from seismo3d.registration.solvers import Limits, Prior, Solution, moved_from, offsets_from, walk
from seismo3d.registration.terms import FeaturePass, FeatureTerm, weigh_features

NEAR_SHARE = 0.5
"""Share of elements with a partner within half a voxel from which the start counts as near."""


DAMPING = (1e-4, 1e-3, 1e-2, 1e-1)
"""Shares of the pairs' weight with which a step is held back, in turn, until it stays within the pairs' reach."""
WEAK = 0.05
"""Share of the largest curvature below which it is asked how much of a direction's curvature is real."""
FAR_RATIO = 1e-3
"""Share of the largest curvature up to which directions are held where pairs are still wrong and cannot be asked."""


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Settings of the fused loop; the defaults are right.

    Attributes
    ----------
    max_iterations : int
        Most passes a level.
    tolerance : float
        The finest level ends where a step moves no parameter by more than this share of a voxel, in radians and in
        shares of the scan's size; coarser levels end at five times that.
    max_elements : int
        Most source elements that a pass looks at, drawn evenly.
    observability : float
        Directions whose curvature is below this share of the largest are left as they are.
    symmetric : bool
        Measure along the mean of both surfaces' normals.
    acceleration : int
        Steps that are remembered to extrapolate from; 0 for none.
    alpha : float or None
        Fixed share of the features as in Eq. (16), or None to weigh by measured variance.
    n_threads : int
        Threads to match on; the result does not depend on them.
    wide_search : bool
        Search the coarsest level without a limit of distance first.
    """

    max_iterations: int = 30
    tolerance: float = 0.004
    max_elements: int = 5000
    observability: float = 1e-6
    symmetric: bool = False
    acceleration: int = 4
    alpha: float | None = None
    n_threads: int = 1
    wide_search: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """The fused form at one transform, the factors of both terms in it, and the robust cost of the pairs.

    Directions whose curvature is below ``ratio`` times the largest are not seen; ``held`` is added for the walk, to
    hold the ``unseen`` (columns, orthonormal).
    """

    form: Float64Array
    shares: tuple[float, float]
    cost: float
    surface: Pass | None
    features: FeaturePass | None
    ratio: float = 0.0
    held: Float64Array | None = None
    unseen: Float64Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LoopResult:
    """Where the loop ended, in the frame.

    Attributes
    ----------
    A, t : ndarray
    joint : Joint
        The last pass.
    cutoff : float
        Residual along the normal at which weights reached zero.
    settled : bool
        The last step was below the tolerance.
    energies : tuple of float
        Mean square residual of the matched points at each pass, in the frame.
    path : tuple of (A, t)
        Where each of those passes was made.
    """

    A: Float64Array
    t: Float64Array
    joint: Joint
    cutoff: float
    settled: bool
    energies: tuple[float, ...]
    path: tuple[tuple[Float64Array, Float64Array], ...] = ()


def run_levels(
    target: list[VoxelMap],
    source: list[VoxelMap],
    features: FeatureTerm | None,
    *,
    start: Prior,
    prior: Prior,
    limits: Limits,
    model: str,
    settings: LoopSettings,
    tables: list[PixelTable] | None = None,
) -> LoopResult:
    """Run the loop from the coarsest level to the finest.

    Parameters
    ----------
    target, source : list of VoxelMap
        Levels in the frame, finest first; empty for features alone.
    features : FeatureTerm or None
    start : Prior
        Transform to start from.
    prior : Prior
        Transform that limits are relative to.
    limits : Limits
    model : str
    settings : LoopSettings
    tables : list of PixelTable, optional
        By level: partners come from the target's pixels; None searches the nearest.
    """
    A, t = start.A, start.t
    trail: list[tuple[float, Float64Array, Float64Array]] = []
    result = None
    for level in range(len(target) - 1, -1, -1):
        coarsest = level == len(target) - 1
        if level == 0 and not coarsest and features is None and settings.alpha is None:
            A, t = _led_back(target[0], source[0], A, t, start, model, settings)
        result = _run_level(
            target[level], source[level], features, A, t, prior, limits, model, settings, trail,
            wide=coarsest and settings.wide_search, finest=level == 0, table=None if tables is None else tables[level],
        )  # fmt: skip
        A, t = result.A, result.t
    if result is None:
        if features is None:
            raise ValueError("the loop needs surfaces or features")
        result = _run_features(features, A, t, prior, limits, model, settings)
    return result


def _run_level(
    target: VoxelMap,
    source: VoxelMap,
    features: FeatureTerm | None,
    A: Float64Array,
    t: Float64Array,
    prior: Prior,
    limits: Limits,
    model: str,
    settings: LoopSettings,
    trail: list[tuple[float, Float64Array, Float64Array]],
    *,
    wide: bool,
    finest: bool,
    table: PixelTable | None,
) -> LoopResult:
    base = Prior(A, t)
    memory = Accelerator(settings.acceleration)
    tolerance = (1.0 if finest else 5.0) * settings.tolerance * target.size
    drawn = draw(source.surface, settings.max_elements)
    stall = _Stall()
    search = _WideSearch(target, drawn) if wide and _is_far(target, drawn, A, t) else None
    cutoff = target.size
    joint = None
    plain: tuple[Float64Array, Float64Array] | None = None
    settled = False
    for iteration in range(settings.max_iterations):
        if iteration == 12 and search is not None:
            search = joint = plain = None
        widened = search is not None
        given, radius = search.partners(A, t, iteration) if search else (None, 1.5 * target.size)
        if table is not None and search is None:
            given = table.partners(drawn, target.surface, A, t, radius)
        new = _evaluate(target, drawn, features, A, t, radius, cutoff, given, settings, model, finest)
        if plain is not None and joint is not None and new.cost > 1.0005 * joint.cost + 1e-9:
            A, t = plain  # the extrapolation went uphill: take the plain step instead
            plain = None
            memory.forget()
            continue
        joint = new
        surface = joint.surface
        if surface is not None:
            trail.append((surface.mean_square, A, t))
            fresh = max(TUKEY * surface.spread, 0.05 * target.size, 1e-7)
            if not 0.8 < fresh / cutoff < 1.25:
                cutoff = min(fresh, 2.0 * target.size)
                memory.forget()
        step, move = _trusted_step(joint, A, t, prior, limits, model, radius)
        if np.abs(move).max() < (tolerance if not widened else 4 * tolerance) or stall.reached(joint.cost, cutoff):
            A, t = step.A, step.t
            if search is None:
                settled = True
                break
            search = None
            memory.forget()
            joint = plain = None
            continue
        before = offsets_from(base, A, t, model)
        after = offsets_from(base, step.A, step.t, model)
        mixed = memory.extrapolate(before, after)
        plain = None
        A, t = step.A, step.t
        if mixed is not None and not limits.bind_motion:
            plain = (A, t)
            A, t = moved_from(base, mixed, model)
    if joint is None:
        raise ValueError("max_iterations must be positive")
    return LoopResult(A, t, joint, cutoff, settled, tuple(e for e, _, _ in trail), tuple((B, u) for _, B, u in trail))


def _led_back(
    target: VoxelMap,
    source: VoxelMap,
    A: Float64Array,
    t: Float64Array,
    start: Prior,
    model: str,
    settings: LoopSettings,
) -> tuple[Float64Array, Float64Array]:
    """Return (A, t) with what coarse levels strayed along directions that are not seen taken back to the start."""
    drawn = draw(source.surface, settings.max_elements)
    joint = _evaluate(target, drawn, None, A, t, 1.5 * target.size, target.size, None, settings, model, True)
    if joint.unseen is None:
        return A, t
    back = joint.unseen @ (joint.unseen.T @ offsets_from(start, A, t, model))
    return moved_from(Prior(A, t), -back, model)


def draw(surface: Float32Array, most: int) -> Float32Array:
    """Return at most so many elements, every k-th of them."""
    stride = -(-len(surface) // most)
    return surface if stride == 1 else np.ascontiguousarray(surface[::stride])


class _Stall:
    """Notices that the cost has stopped falling: nearest pairs swap to and fro for ever near a solution."""

    def __init__(self) -> None:
        self._best = np.inf
        self._cutoff = 0.0
        self._waited = 0

    def reached(self, cost: float, cutoff: float) -> bool:
        """Return whether four passes have not lowered the cost by a thousandth."""
        if cutoff != self._cutoff or cost < 0.999 * self._best:
            self._best, self._cutoff, self._waited = cost, cutoff, 0
        else:
            self._waited += 1
        return self._waited >= 4


def _is_far(target: VoxelMap, source: Float32Array, A: Float64Array, t: Float64Array) -> bool:
    """Return whether most source elements have no partner within half a voxel."""
    seen = match_surface(source, target, A, t, radius=0.5 * target.size, cutoff=target.size, least_cosine=0.7)
    return seen.matched < NEAR_SHARE


class _WideSearch:
    """Nearest elements on the coarsest level at any distance, within a radius that shrinks by schedule."""

    def __init__(self, target: VoxelMap, source: Float32Array) -> None:
        from scipy.spatial import cKDTree

        self._source = source[:, : target.dim].astype(np.float64)
        self._tree: Any = cKDTree(target.surface[:, : target.dim].astype(np.float64))
        self._size = target.size

    def partners(self, A: Float64Array, t: Float64Array, iteration: int) -> tuple[Int32Array, float]:
        """Return each source element's partner, -1 beyond the radius, and the radius."""
        distances, rows = self._tree.query(self._source @ A.T + t)
        radius = max(3.0 * float(np.median(distances)), 1.5 * self._size) * 0.95**iteration
        rows = rows.astype(np.int32)
        rows[distances > radius] = -1
        return rows, radius


def _evaluate(
    target: VoxelMap,
    source: Float32Array,
    features: FeatureTerm | None,
    A: Float64Array,
    t: Float64Array,
    radius: float,
    cutoff: float,
    given: Int32Array | None,
    settings: LoopSettings,
    model: str,
    finest: bool,
) -> Joint:
    surface = match_surface(
        source,
        target,
        A,
        t,
        radius=radius,
        cutoff=cutoff,
        symmetric=settings.symmetric,
        n_threads=settings.n_threads,
        given=NONE_GIVEN if given is None else given,
    )
    seen = None if features is None else weigh_features(features, A, t)
    ratio, held, unseen = settings.observability, None, None
    if settings.alpha is None and weakest_share(surface.form, A, model_number(model)) < WEAK:
        if not _lies_near(surface, target.size):
            ratio = max(ratio, FAR_RATIO)
        else:
            agreed = agreement(surface, source, target, A, cutoff, model, final=finest)
            if agreed is not None and not agreed.real.all():
                surface = replace(surface, form=agreed_form(surface.form, A, t, model, agreed))
                unseen = np.linalg.qr(agreed.directions[:, ~agreed.real])[0]
                held = holding_form(surface.form, A, t, model, unseen) if seen is None else None
    joint = fuse(surface, seen, settings.alpha, target.size, cutoff)
    return replace(joint, ratio=ratio, held=None if held is None else joint.shares[0] * held, unseen=unseen)


def _trusted_step(
    joint: Joint, A: Float64Array, t: Float64Array, prior: Prior, limits: Limits, model: str, reach: float
) -> tuple[Solution, Float64Array]:
    """Walk to the form's minimum, or less far where that is beyond the pairs' reach: there they say nothing."""
    here = Prior(A, t)
    base = form = joint.form if joint.held is None else joint.form + joint.held
    n = form.shape[0] - 1
    weight = float(np.trace(form[n - t.size : n, n - t.size : n]))
    for damping in (0.0, *DAMPING):
        if damping:
            form = base + damping * weight * _closeness(A, t)
        step = walk(form, A, t, model=model, prior=prior, limits=limits, ratio=joint.ratio)
        move = offsets_from(here, step.A, step.t, model)
        if np.abs(move).max() <= reach:
            break
    return step, move


def _closeness(A: Float64Array, t: Float64Array) -> Float64Array:
    """Return the form of the mean square motion of the source's points away from (A, t), for points all around."""
    d = t.size
    z = stack(A, t)
    weights = np.append(np.full(d * d, 1.0 / d), np.ones(d))
    out = np.zeros((z.size, z.size))
    out[:-1, :-1] = np.diag(weights)
    out[:-1, -1] = out[-1, :-1] = -weights * z[:-1]
    out[-1, -1] = weights @ z[:-1] ** 2
    return out


def _lies_near(surface: Pass, voxel_size: float) -> bool:
    """Return whether most elements lie on a partner: farther off normals differ because pairs are wrong."""
    if not surface.weight > 0.0 or surface.matched < 0.3:
        return False
    return bool(np.nanmedian(surface.distances2) < (0.7 * voxel_size) ** 2)


def fuse(
    surface: Pass | None,
    features: FeaturePass | None,
    alpha: float | None,
    voxel_size: float = 0.0,
    cutoff: float = 1.0,
) -> Joint:
    """Join both terms: by their measured variances, or with the fixed share alpha of Eq. (16)."""
    if surface is None:
        if features is None:
            raise ValueError("nothing to fuse")
        form = features.form / features.variance
        return Joint(form, (0.0, 1.0 / features.variance), 0.0, None, features)
    if features is None:
        factor = 1.0 / max(surface.spread, 1e-4 * voxel_size) ** 2
        return Joint(surface.form * factor, (factor, 0.0), surface.cost, surface, None)
    dense_variance = surface_variance(surface, voxel_size, cutoff)
    if alpha is None:
        shares = (1.0 / dense_variance, 1.0 / features.variance)
    else:
        shares = ((1.0 - alpha) / max(surface.weight, 1e-12), alpha / max(features.weight, 1e-12))
    form = surface.form * shares[0] + features.form * shares[1]
    n_features = len(features.weights)
    outside = 1.0 - features.weight / n_features
    cost = surface.cost + outside
    return Joint(form, shares, cost, surface, features)


def surface_variance(surface: Pass, voxel_size: float, cutoff: float) -> float:
    """Return the variance along the normal of a residual of weight 1, as far as the surfaces are from lying together.

    Weights are inverse variances up to a factor: this is the factor. Residuals of nearest pairs are small even far from
    the solution, where pairs are wrong; the distance between partners in excess of what voxels of this size have anyway
    tells, and counts along with the residuals' own spread.
    """
    if surface.weight == 0.0:
        return voxel_size**2
    robust = np.maximum(0.0, 1.0 - (surface.residuals / cutoff) ** 2) ** 2
    unit = surface.squares / max(float(np.nansum(robust)), 1e-12)
    excess = max(0.0, float(np.nanmedian(surface.distances2)) - 0.3 * voxel_size**2)
    least = (1e-4 * voxel_size) ** 2
    return max(unit * (1.0 + 0.1 * excess / max(surface.spread**2, least)), least * surface.weight / len(robust))


def _run_features(
    features: FeatureTerm,
    A: Float64Array,
    t: Float64Array,
    prior: Prior,
    limits: Limits,
    model: str,
    settings: LoopSettings,
) -> LoopResult:
    settled = False
    joint = fuse(None, weigh_features(features, A, t), settings.alpha)
    for _ in range(settings.max_iterations):
        step = walk(joint.form, A, t, model=model, prior=prior, limits=limits, ratio=settings.observability)
        move = offsets_from(Prior(A, t), step.A, step.t, model)
        A, t = step.A, step.t
        joint = fuse(None, weigh_features(features, A, t), settings.alpha)
        if np.abs(move).max() < settings.tolerance:
            settled = True
            break
    return LoopResult(A, t, joint, 1.0, settled, ())
