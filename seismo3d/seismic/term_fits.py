"""Least-squares combinations of terms, summed in one order, so that their last bits do not depend on threads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from seismo3d._typing import Float64Array


def fit_terms(
    terms: Sequence[Float64Array],
    values: Float64Array,
    *,
    weights: Float64Array | None = None,
    ridge: Sequence[float] | None = None,
) -> tuple[Float64Array, Float64Array]:
    """Return the factors of the best combination of terms for values, and what it leaves of them.

    Parameters
    ----------
    terms : sequence of ndarray of shape (n,), float64
        What is combined.
    values : ndarray of shape (n,), float64
        What the combination is to give.
    weights : ndarray of shape (n,), float64, optional
        What each value counts; alike by default.
    ridge : sequence of float, optional
        What the square of each factor counts, for all weights together; nothing by default.

    Returns
    -------
    factors : ndarray of shape (term,), float64
    left : ndarray of shape (n,), float64

    Examples
    --------
    >>> import numpy as np
    >>> x = np.arange(4.0)
    >>> factors, left = fit_terms((np.ones(4), x), 2.0 + 3.0 * x)
    >>> factors.round(6), bool(np.abs(left).max() < 1e-9)
    (array([2., 3.]), True)
    """
    weighed = terms if weights is None else [weights * term for term in terms]
    matrix = np.array([[float((one * other).sum()) for one in terms] for other in weighed])
    right = np.array([float((one * values).sum()) for one in weighed])
    if ridge is not None:
        matrix += np.diag(ridge) * (float(len(values)) if weights is None else float(weights.sum()))
    factors = np.linalg.lstsq(matrix, right, rcond=None)[0]
    left = values.copy()
    for factor, term in zip(factors, terms, strict=True):
        left -= factor * term
    return np.asarray(factors), left
