"""The waves of a wavefront on an even grid of direction cosines."""

from ctypes import byref

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import check, chosen

WAVEFRONT = STRUCTURES["wavefront"]
PADDING = 16  # margin at the ends of a row of limits


def waves(path: np.ndarray, edges: np.ndarray, x: np.ndarray, y: np.ndarray, densities: tuple[float, float],
          out: np.ndarray, even: bool = True) -> tuple[float, float]:
    """Write complex amplitudes, whose sum is a PSF, from polynomials for each row.

    Parameters
    ----------
    path : array (row, term)
        Coefficients of Chebyshev polynomials over 2 x^2 - 1 or, unless `even`, over x; in waves.
    edges : array (row, 1 + limit, term)
        Coefficients of the logarithm of light per area, and of the limits, which let light pass up to 1.
    x, y : arrays (column,), (row,)
        From -1 to 1; light passes only within the circle of radius 1. At least 3 rows; a multiple of 8 columns.
    densities : (float, float)
        Lower and upper limit of the logarithm.
    out : float32 array (real and imaginary part, row, column)
        Relative to the largest light per area. Additional columns are not written.
    even : bool
        Whether light is the same at -x; then x is positive and ascending.

    Returns
    -------
    hard, soft : float
        Sums over the cells of their light, and of their light times the share of the cell that transmits it.

    Raises
    ------
    ValueError
        Sizes are invalid.
    """
    loops, variant = chosen()
    terms = chebvander(2 * x**2 - 1 if even else x, max(path.shape[-1], edges.shape[-1]) - 1).T
    across, up = np.ascontiguousarray(terms, dtype=np.float64), np.ascontiguousarray(y, dtype=np.float64)
    path, across_edges = np.ascontiguousarray(path, dtype=np.float64), np.ascontiguousarray(terms, dtype=np.float32)
    edges = np.ascontiguousarray(edges, dtype=np.float32)
    if path.shape[0] != y.size or edges.shape[0] != y.size:
        raise ValueError(f"polynomials of {path.shape[0]} and {edges.shape[0]} rows: expected {y.size}")
    light, work = np.zeros(2), np.empty(3 * (x.size + PADDING), np.float32)
    wavefront = WAVEFRONT(address(across, np.float64), address(across_edges, np.float32), address(up, np.float64),
                          address(path, np.float64), address(edges, np.float32), y.size, x.size, path.shape[1],
                          edges.shape[2], edges.shape[1] - 1, 1 if even else 2, *densities)
    check(loops.lf_waves(variant, byref(wavefront), byref(picture(out)), address(light, np.float64),
                         address(work, np.float32)))
    return float(light[0]), float(light[1])
