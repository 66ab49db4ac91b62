from __future__ import annotations

import numpy as np

from seismo3d.seismic.term_fits import fit_terms


def test_terms_are_fitted_by_least_squares(rng):
    terms = tuple(rng.normal(size=(3, 50)))
    values = 2.0 * terms[0] - 0.5 * terms[2]
    factors, left = fit_terms(terms, values)
    np.testing.assert_allclose(factors, [2.0, 0.0, -0.5], atol=1e-12)
    np.testing.assert_allclose(left, 0.0, atol=1e-12)


def test_weights_and_ridge_are_those_of_the_textbook(rng):
    terms, values, weights = rng.normal(size=(3, 80)), rng.normal(size=80), rng.random(80)
    ridge = np.array([0.0, 0.1, 0.3])
    factors, left = fit_terms(tuple(terms), values, weights=weights, ridge=ridge)
    normal = (terms * weights) @ terms.T + np.diag(ridge) * weights.sum()
    expected = np.linalg.solve(normal, (terms * weights) @ values)
    np.testing.assert_allclose(factors, expected, rtol=1e-10)
    np.testing.assert_allclose(left, values - expected @ terms, atol=1e-10)


def test_terms_that_tell_nothing_get_nothing():
    factors, left = fit_terms((np.ones(20), np.zeros(20)), np.full(20, 3.0))
    np.testing.assert_allclose(factors, [3.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(left, 0.0, atol=1e-12)
