"""Chebyshev polynomials over x and y, fitted to values at scattered places."""

from ctypes import byref

import numpy as np

from .arrays import address
from .declarations import STRUCTURES
from .library import check, chosen

SCATTERED = STRUCTURES["scattered"]
EIGHT = 8


def fit(x: np.ndarray, y: np.ndarray, weight: np.ndarray, values: np.ndarray, degree: int, step: int = 2
        ) -> tuple[np.ndarray, float]:
    """Fit polynomials by weighted least squares.

    Parameters
    ----------
    x, y, weight : arrays (place,)
        Coordinates from -1 to 1.
    values : array (quantity, place)
    degree : int
        The largest sum of the powers of x and y.
    step : int
        Of the powers of x: 2 for polynomials that are even in x, 1 for others.

    Returns
    -------
    coefficients : array (quantity, power of y, power of x over `step`)
    error : float
        The weighted RMS residual of the first quantity.

    Raises
    ------
    ValueError
        Sizes are invalid.
    """
    loops, variant = chosen()
    x, y = np.ascontiguousarray(x, dtype=np.float64), np.ascontiguousarray(y, dtype=np.float64)
    weight, values = np.ascontiguousarray(weight, dtype=np.float64), np.ascontiguousarray(values, dtype=np.float64)
    quantities, places = values.shape
    out, residual = np.zeros((quantities, degree + 1, degree // step + 1)), np.zeros(-(-places // EIGHT) * EIGHT)
    work = np.empty(loops.lf_fit_work(places, degree, step))
    scattered = SCATTERED(*(address(each, np.float64, (places,)) for each in (x, y, weight)),
                          address(values, np.float64), places, quantities, degree, step)
    check(loops.lf_fit(variant, byref(scattered), address(out, np.float64), address(residual, np.float64),
                       address(work, np.float64)))
    return out, float(np.sqrt(np.sum(residual**2) / np.sum(weight**2)))
