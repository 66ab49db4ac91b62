"""The exact solve alone: align pairs that are given, row by row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from seismo3d._settings import as_settings
from seismo3d._typing import ArrayLike, Float64Array
from seismo3d._validate import as_number, as_points, as_real_array, freeze, told
from seismo3d.errors import GeometryError, ParameterError, ShapeError
from seismo3d.registration import quadratic
from seismo3d.registration.certificate import Certificate
from seismo3d.registration.constraints import Constraints, model_number
from seismo3d.registration.observability import assess
from seismo3d.registration.quadratic import Frame
from seismo3d.registration.result import SIZE_IS_FREE, Registration
from seismo3d.registration.solvers import Limits, Prior, Solution, solve_form
from seismo3d.registration.start import as_start

# most rounds in which the shares of two terms are measured anew
_MANY_ROUNDS = 20
# of either term: one must not vanish for good
_LEAST_SHARE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class _Term:
    """One kind of residuals: form over the sum of weights, number of rows, share, measured variance."""

    form: Float64Array
    n_rows: int
    share: float
    variance: float


def align_pairs(
    target: ArrayLike,
    source: ArrayLike,
    *,
    normals: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    features: tuple[ArrayLike, ArrayLike] | None = None,
    feature_weights: ArrayLike | None = None,
    alpha: float | None = None,
    model: str = "rigid",
    prior: ArrayLike | None = None,
    constraints: Constraints | None = None,
    observability: float = 1e-6,
) -> Registration:
    r"""Find the transform that carries given source points onto their partners in the target: the exact solve alone.

    Minimises :math:`z^T Q z` (see :mod:`seismo3d.registration.quadratic`), the joint error of Eq. (16) of [1]_,
    globally for the models ``translation``, ``rigid`` and ``affine``, and from many starts for ``similarity`` and
    ``scaled``. The rigid answer comes with a certificate [2]_.

    Parameters
    ----------
    target, source : array_like of shape (n, d)
        Row ``i`` of one matches row ``i`` of the other; d is 2 or 3. Any unit of length.
    normals : array_like of shape (n, d), optional
        Unit normals of the target at its points. Where given, the pairs count along the normals alone (point-to-plane).
    weights : array_like of shape (n,), optional
        Not negative; inverse variances up to a common factor. Default 1.
    features : tuple (target, source) of array_like of shape (k, d), optional
        More pairs, always point-to-point.
    feature_weights : array_like of shape (k,), optional
        Weights of the features. Default 1.
    alpha : float, optional
        Share of the features in the joint error, 0 to 1, as in Eq. (16). None weighs pairs and features by their
        variances, which are estimated from the residuals.
    model : {"rigid", "translation", "similarity", "scaled", "affine"}
        Class of the transform; ``scaled`` is a rotation times one factor an axis of the source.
    prior : array_like of shape (d+1, d+1), optional
        Transform that is kept along directions that the pairs do not determine, and that constraints are relative to.
        Its linear part, if rounded, is replaced by the nearest one of the model. Default: the identity.
    constraints : Constraints, optional
        Degrees of freedom that are fixed or bounded; scale is free unless bounded here.
    observability : float
        Directions whose curvature is below this share of the largest one count as not determined.

    Returns
    -------
    Registration
        With certificate (rigid, without constraints), covariance and unobservable directions.

    Raises
    ------
    ShapeError
        If arrays do not match, are empty or not finite.
    GeometryError
        If there are fewer than d pairs, or all source points coincide.
    ParameterError
        If a weight is negative, the prior is far from the model, or a setting has no meaning.

    References
    ----------
    .. [1] The fused registration of features and dense depth that this package implements, Eq. (9)-(16).
    .. [2] J. Briales, J. Gonzalez-Jimenez, Convex global 3D registration with Lagrangian duality, CVPR 2017.
       :doi:`10.1109/CVPR.2017.595`

    Examples
    --------
    >>> import numpy as np
    >>> square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]])
    >>> turned = square @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + [5.0, 0.0]
    >>> align_pairs(turned, square).T_target_source.round(6) + 0.0
    array([[ 0., -1.,  5.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    model_number(model)
    given = as_settings(constraints, Constraints, "constraints")
    number = as_number(observability, "observability", low=0.0, high=1.0)
    q, p = _as_pairs(target, source, "target", "source")
    pairs = [(q, p, _as_normals(normals, q), _as_weights(weights, len(p), "weights"))]
    if features is not None:
        if not isinstance(features, (tuple, list)) or len(features) != 2:
            raise ParameterError(f"features is {told(features)}; expected two arrays of points, (target, source).")
        g, f = _as_pairs(features[0], features[1], "features[0]", "features[1]", dim=p.shape[1])
        pairs.append((g, f, None, _as_weights(feature_weights, len(f), "feature_weights")))
    elif feature_weights is not None:
        raise ParameterError("feature_weights is given without features; expected both. Drop it, or pass features.")
    if alpha is not None:
        as_number(alpha, "alpha", low=0.0, high=1.0)
        if features is None:
            raise ParameterError("alpha is given without features; expected both. Drop alpha, or pass features.")
    all_source = np.concatenate([pair[1] for pair in pairs])
    _check_enough(all_source, model)
    frame = Frame.of(np.concatenate([pair[0] for pair in pairs]), all_source, size_is_free=model in SIZE_IS_FREE)
    start = _as_prior(prior, frame, p.shape[1], model)
    limits = Limits(*given.limits(model, p.shape[1], frame.size))
    terms = [_make_term(pair, frame) for pair in pairs]
    found, terms = _solve_terms(terms, alpha, model, start, limits, number)
    return _result(found, terms, pairs, frame, model, start, limits, number)


def _make_term(pair: tuple[Float64Array, Float64Array, Float64Array | None, Float64Array], frame: Frame) -> _Term:
    q, p, n, w = pair
    w = w / w.sum()
    if n is None:
        form = quadratic.point_form(frame.target(q), frame.source(p), w)
        rows = int((w > 0).sum()) * p.shape[1]
    else:
        form = quadratic.plane_form(frame.target(q), frame.source(p), n, w)
        rows = int((w > 0).sum())
    return _Term(form, rows, 1.0, 1.0)


def _solve_terms(
    terms: list[_Term], alpha: float | None, model: str, prior: Prior, limits: Limits, ratio: float
) -> tuple[Solution, list[_Term]]:
    """Solve with fixed shares, or with shares by variance, estimated in turn with the transform."""
    n_parameters = len(limits.low)
    total = sum(term.n_rows for term in terms)
    if len(terms) == 1:
        shares = [1.0]
    elif alpha is not None:
        shares = [1.0 - alpha, alpha]
    else:
        shares = [term.n_rows / total for term in terms]
    rounds = _MANY_ROUNDS if alpha is None and len(terms) == 2 else 1
    for _ in range(rounds):
        Q = sum(share * term.form for share, term in zip(shares, terms))
        seen = ratio * min(shares) if len(terms) == 2 else ratio  # a direction that either term sees is seen
        found = solve_form(np.asarray(Q), model=model, prior=prior, limits=limits, ratio=seen)
        z = quadratic.stack(found.A, found.t)
        spent = [n_parameters * share / sum(shares) for share in shares]
        variances = [
            max(float(z @ term.form @ z), 1e-24) * term.n_rows / max(term.n_rows - used, 1.0)
            for term, used in zip(terms, spent)
        ]
        terms = [_Term(term.form, term.n_rows, share, v) for term, share, v in zip(terms, shares, variances)]
        if rounds == 1:
            break
        new = np.array([term.n_rows / v for term, v in zip(terms, variances)])
        new = np.clip(new / new.sum(), _LEAST_SHARE, 1.0 - _LEAST_SHARE)
        if np.abs(new - shares).max() < 1e-9:
            break
        shares = new.tolist()
    return found, terms


def _result(
    found: Solution,
    terms: list[_Term],
    pairs: list[tuple[Float64Array, Float64Array, Float64Array | None, Float64Array]],
    frame: Frame,
    model: str,
    prior: Prior,
    limits: Limits,
    ratio: float,
) -> Registration:
    Q = np.asarray(sum(term.share * term.form for term in terms))
    meat = np.asarray(sum(term.share**2 * term.variance / term.n_rows * term.form for term in terms))
    seen = ratio * max(min(term.share for term in terms), _LEAST_SHARE)
    sure = assess(Q, meat, found.A, found.t, model=model, frame=frame, ratio=seen, limits=limits)
    T = frame.leave(found.A, found.t)
    residuals = np.concatenate([_residuals(pair, T) for pair in pairs])
    certificate = None
    if found.gap is not None and found.norm is not None:
        relative = found.gap / found.norm
        certificate = Certificate(found.gap * frame.size**2, relative, relative <= 1e-8)
    middle = float(np.median(residuals))
    return Registration(
        T_target_source=freeze(T),
        covariance=freeze(sure.covariance),
        information=freeze(sure.information),
        rmse=float(np.sqrt(max(found.value, 0.0) / sum(term.share for term in terms)) * frame.size),
        overlap=1.0,
        state="converged",
        certificate=certificate,
        unobservable=sure.unobservable,
        model=model,
        at_bounds=limits.reached(prior, found.A, found.t, model),
        find_inliers=lambda: residuals <= max(5.2 * middle, 1e-9 * frame.size),
        scale=freeze(np.linalg.norm(T[:-1, :-1], axis=0)),
    )


def _residuals(
    pair: tuple[Float64Array, Float64Array, Float64Array | None, Float64Array], T: Float64Array
) -> Float64Array:
    q, p, n, _ = pair
    d = p.shape[1]
    r = p @ T[:d, :d].T + T[:d, d] - q
    return np.asarray(np.abs((r * n).sum(axis=1)) if n is not None else np.linalg.norm(r, axis=1))


def _as_pairs(
    target: ArrayLike, source: ArrayLike, name_q: str, name_p: str, dim: int | tuple[int, ...] = (2, 3)
) -> tuple[Float64Array, Float64Array]:
    q, p = as_points(target, name_q, dim=dim), as_points(source, name_p, dim=dim)
    if q.shape != p.shape:
        raise ShapeError(
            f"{name_q} has shape {q.shape} and {name_p} has shape {p.shape}; expected the same. "
            "Give pairs row by row; use register for scans without pairs."
        )
    if len(q) == 0:
        raise ShapeError(f"{name_q} has shape {q.shape}: it is empty. Give at least one pair.")
    return q, p


def _as_normals(normals: ArrayLike | None, q: Float64Array) -> Float64Array | None:
    if normals is None:
        return None
    n = as_points(normals, "normals", dim=q.shape[1])
    if n.shape != q.shape:
        raise ShapeError(f"normals have shape {n.shape}; expected {q.shape}, one a target point.")
    lengths = np.linalg.norm(n, axis=1, keepdims=True)
    if not (lengths > 0.0).all():
        raise GeometryError("normals hold vectors of length zero; expected unit vectors. Drop those pairs first.")
    return n / lengths


def _as_weights(weights: ArrayLike | None, n: int, name: str) -> Float64Array:
    if weights is None:
        return np.ones(n)
    w = np.asarray(as_real_array(weights, name, ndim=1), dtype=np.float64)
    if w.shape != (n,):
        raise ShapeError(f"{name} has shape {w.shape}; expected ({n},), one a pair.")
    if not (np.isfinite(w).all() and (w >= 0.0).all() and w.sum() > 0.0):
        raise ParameterError(
            f"{name} holds negative, infinite or only zero values; expected finite weights, at least one positive."
        )
    return w


def _check_enough(source: Float64Array, model: str) -> None:
    n, d = source.shape
    least = 1 if model == "translation" else d
    if n < least:
        raise GeometryError(f"there are {n} pairs; expected at least {least} for model {model!r} in {d} dimensions.")
    if model != "translation" and not np.ptp(source, axis=0).max() > 0.0:
        raise GeometryError("all source points coincide; expected points that are apart. Use model 'translation'.")


def _as_prior(prior: ArrayLike | None, frame: Frame, d: int, model: str) -> Prior:
    return Prior(*frame.enter(np.eye(d + 1) if prior is None else as_start(prior, "prior", d, model)))
