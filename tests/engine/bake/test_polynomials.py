"""Polynomials fitted to rays, against numpy's own fits."""

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval2d

from lensfield.engine.bake.polynomials import along_rows, fitted, of_rows

DEGREE = 6
RANDOM = np.random.default_rng(3)


def some_coefficients(quantities, dtype=float):
    powers = np.arange(DEGREE + 1)[:, None] + 2 * np.arange(DEGREE // 2 + 1)
    return np.where(powers <= DEGREE, RANDOM.normal(size=(quantities, *powers.shape)), 0).astype(dtype)


def by_numpy(coefficients, x, y):
    full = np.zeros((DEGREE + 1, DEGREE + 1))
    full[:, ::2] = coefficients
    return chebval2d(*np.broadcast_arrays(y, x), full)


@pytest.mark.parametrize("columns, rows", [(1, 1), (7, 3), (200, 900)])
def test_on_a_grid_they_match_chebyshevs(columns, rows):
    coefficients, x, y = some_coefficients(3), RANDOM.uniform(0, 1, columns), RANDOM.uniform(-1, 1, rows)
    expected = [by_numpy(each, x, y[:, None]) for each in coefficients]
    np.testing.assert_allclose(along_rows(of_rows(coefficients, y), x), expected, atol=1e-12)
    np.testing.assert_allclose(along_rows(of_rows(coefficients[0], y), x), expected[0], atol=1e-12)
    single = along_rows(of_rows(coefficients.astype(np.float32), y), x)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, atol=1e-4)


@pytest.mark.parametrize("rays", [60, 5000])
def test_polynomial_data_are_fitted_exactly(rays):
    coefficients, (x, y) = some_coefficients(2), RANDOM.uniform(-0.7, 0.7, (2, rays))
    fit, error = fitted(x, y, RANDOM.uniform(0.5, 1, rays), [by_numpy(each, x, y) for each in coefficients], DEGREE)
    np.testing.assert_allclose(fit, coefficients, atol=1e-7)
    assert error < 1e-10


def test_the_error_is_the_least_squares_residual():
    """For a kink, against numpy's solution: the weighted root mean square of the residual."""
    x, y = RANDOM.uniform(-1, 1, (2, 400))
    weight, values = RANDOM.uniform(0.5, 1, 400), np.abs(y - 0.2)
    terms = np.eye(28).reshape(28, DEGREE + 1, DEGREE // 2 + 1)
    basis = np.array([by_numpy(term, x, y) for term in terms if np.any(term * some_coefficients(1)[0])]).T
    least = np.linalg.lstsq(basis * weight[:, None], values * weight, rcond=None)[1][0]
    _, error = fitted(x, y, weight, values[None], DEGREE)
    assert error == pytest.approx(np.sqrt(least / np.sum(weight**2)), rel=1e-9)


def test_terms_that_rays_do_not_determine_stay_small():
    """Rays on a line across the pupil: they do not determine any power of y."""
    x = np.linspace(-1, 1, 50)
    fit, error = fitted(x, np.full(50, 0.1), np.ones(50), [x**2], DEGREE)
    assert error < 1e-6 and np.abs(fit).max() < 10
