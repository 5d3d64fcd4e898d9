"""Chebyshev polynomials over x and y, often even in x: fitted to rays by least squares, and evaluated on grids."""

import numpy as np
import scipy
from numpy.polynomial.chebyshev import chebvander

from ..kernels.fitting import fit
from ..kernels.library import NUMPY, running
from ..runtime.products import PIECE, product

RIDGE = 1e-15  # relative to the sum of squares: keeps terms that the rays do not determine at 0
REFINEMENTS = 2


def fitted(x: np.ndarray, y: np.ndarray, weight: np.ndarray, values: np.ndarray, degree: int, even: bool = True
           ) -> tuple[np.ndarray, float]:
    """Coefficients (quantity, power of y, term of x) of values (quantity, ray) at places from -1 to 1.

    The terms of x have even powers or, unless `even`, all powers. Solves the normal equations, with iterative
    refinement. The second result is the first quantity's RMS error.
    """
    step = 2 if even else 1
    if running() != NUMPY:
        return fit(x, y, weight, np.asarray(values), degree, step)
    up, across = chebvander(y, degree), chebvander(x, degree)[:, ::step]
    powers_y, terms_x = np.array([(power_y, term_x) for term_x in range(degree // step + 1)
                                  for power_y in range(degree + 1 - step * term_x)]).T
    basis, values = up[:, powers_y] * across[:, terms_x] * weight[:, None], (values * weight).T
    squares = _sums_of_squares(basis)
    squares[np.diag_indices_from(squares)] += RIDGE * np.trace(squares)
    factor, residual = scipy.linalg.cho_factor(squares, check_finite=False), values
    terms = np.zeros((basis.shape[1], values.shape[1]))
    for _ in range(1 + REFINEMENTS):
        sums = np.einsum("rt,rq->qt", basis, residual)  # solved one by one: LAPACK starts threads for several
        terms += np.transpose([scipy.linalg.cho_solve(factor, each, check_finite=False) for each in sums])
        residual = values - np.einsum("rt,tq->rq", basis, terms)
    coefficients = np.zeros((values.shape[1], degree + 1, degree // step + 1))
    coefficients[:, powers_y, terms_x] = terms.T
    return coefficients, float(np.sqrt(np.sum(residual[:, 0]**2) / np.sum(weight**2)))


def of_rows(coefficients: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Polynomials over x for each row: array (..., y, term of x), in the coefficients' precision."""
    return product(chebvander(y, coefficients.shape[-2] - 1).astype(coefficients.dtype), coefficients)


def along_rows(polynomials: np.ndarray, x: np.ndarray, even: bool = True) -> np.ndarray:
    """Values of polynomials from `of_rows`: array (..., y, x)."""
    terms = chebvander(2 * x**2 - 1 if even else x, polynomials.shape[-1] - 1)
    return product(polynomials, terms.T.astype(polynomials.dtype))


def _sums_of_squares(basis):
    """basis.T @ basis."""
    rays, terms = basis.shape
    rows = max(1, PIECE // terms**2)
    pieces = np.zeros((-(-rays // rows), rows, terms))
    pieces.reshape(-1, terms)[:rays] = basis
    return (pieces.transpose(0, 2, 1) @ pieces).sum(axis=0)
