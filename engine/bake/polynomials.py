"""Chebyshev polynomials over x and y, even in x: through what rays tell, by least squares, and on grids.

Products of matrices are made of pieces so small that BLAS leaves each to the thread that asks for it. Its own threads
would wait for those of the bake, many times longer than the products take; and bits would depend on their number.
"""

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.linalg import cho_factor, cho_solve

PIECE = 1 << 17  # multiply-adds: half of what OpenBLAS begins to share out at
RIDGE = 1e-15  # of the sum of squares: terms that rays tell less of stay 0
REFINEMENTS = 2


def fitted(x: np.ndarray, y: np.ndarray, weight: np.ndarray, values: np.ndarray, degree: int
           ) -> tuple[np.ndarray, float]:
    """Coefficients (quantity, power of y, half the power of x) of values (quantity, ray) at places from -1 to 1.

    By the normal equations, refined by what they leave. The second number is the first quantity's RMS error.
    """
    up, across = chebvander(y, degree), chebvander(x, degree)[:, ::2]
    powers_y, halves_x = np.array([(power_y, half_x) for half_x in range(degree // 2 + 1)
                                   for power_y in range(degree + 1 - 2 * half_x)]).T
    basis, values = up[:, powers_y] * across[:, halves_x] * weight[:, None], (values * weight).T
    squares = _sums_of_squares(basis)
    squares[np.diag_indices_from(squares)] += RIDGE * np.trace(squares)
    factor, off = cho_factor(squares, check_finite=False), values
    found = np.zeros((basis.shape[1], values.shape[1]))
    for _ in range(1 + REFINEMENTS):
        found += cho_solve(factor, np.einsum("rt,rq->tq", basis, off), check_finite=False)
        off = values - np.einsum("rt,tq->rq", basis, found)
    coefficients = np.zeros((values.shape[1], degree + 1, degree // 2 + 1))
    coefficients[:, powers_y, halves_x] = found.T
    return coefficients, float(np.sqrt(np.sum(off[:, 0]**2) / np.sum(weight**2)))


def of_rows(coefficients: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Polynomials over x alone, of each row: array (..., y, half the power of x), of the coefficients' precision."""
    return _product(chebvander(y, coefficients.shape[-2] - 1).astype(coefficients.dtype), coefficients)


def along_rows(polynomials: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Their values: array (..., y, x)."""
    return _product(polynomials, chebvander(2 * x**2 - 1, polynomials.shape[-1] - 1).T.astype(polynomials.dtype))


def _product(left, right):
    """left @ right, of matrices or stacks of them, in pieces of some rows."""
    *stack, rows, inner = left.shape
    together = max(1, PIECE // (inner * right.shape[-1]))
    pieces = np.zeros((*stack, -(-rows // together), together, inner), left.dtype)
    pieces.reshape(*stack, -1, inner)[..., :rows, :] = left
    product = pieces @ (right[..., None, :, :] if right.ndim > 2 else right)
    return product.reshape(*product.shape[:-3], -1, right.shape[-1])[..., :rows, :]


def _sums_of_squares(basis):
    """basis.T @ basis."""
    rays, terms = basis.shape
    rows = max(1, PIECE // terms**2)
    pieces = np.zeros((-(-rays // rows), rows, terms))
    pieces.reshape(-1, terms)[:rays] = basis
    return (pieces.transpose(0, 2, 1) @ pieces).sum(axis=0)
