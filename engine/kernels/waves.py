"""The waves of a wavefront on an even grid of direction cosines."""

from ctypes import byref

import numpy as np

from .library import WAVEFRONT, address, check, chosen, picture

BESIDE = 16  # room at the ends of a row of limits


def waves(path: np.ndarray, edges: np.ndarray, x: np.ndarray, y: np.ndarray, densities: tuple[float, float],
          out: np.ndarray) -> tuple[float, float]:
    """Write complex amplitudes, whose sum is a PSF, of polynomials that each row has of its own.

    Parameters
    ----------
    path : array (row, term)
        In waves: coefficients of Chebyshev's polynomials over 2 x^2 - 1.
    edges : array (row, 1 + limit, term)
        Of the logarithm of light per area, and of what lets light pass up to 1.
    x, y : arrays (column,), (row,)
        From -1 to 1; nothing passes beyond the circle of radius 1. At least 3 rows; a multiple of 8 columns.
    densities : (float, float)
        Least and most that the logarithm can be.
    out : float32 array (real and imaginary part, row, column)
        In shares of the most light per area. What it has of more columns stays as it is.

    Returns
    -------
    hard, soft : float
        Sums over the cells of their light, and of it times the share of them that light passes.

    Raises
    ------
    ValueError
        Sizes that cannot be.
    """
    loops, variant = chosen()
    across, up, path = (np.ascontiguousarray(array, dtype=np.float64) for array in (2 * x**2 - 1, y, path))
    edges = np.ascontiguousarray(edges, dtype=np.float32)
    if path.shape[0] != y.size or edges.shape[0] != y.size:
        raise ValueError(f"polynomials of {path.shape[0]} and {edges.shape[0]} rows, where there are {y.size}")
    light, work = np.zeros(2), np.empty(3 * (x.size + BESIDE), np.float32)
    wavefront = WAVEFRONT(*(address(array, np.float64) for array in (across, up, path)), address(edges, np.float32),
                          y.size, x.size, path.shape[1], edges.shape[2], edges.shape[1] - 1, *densities)
    check(loops.lf_waves(variant, byref(wavefront), byref(picture(out)), address(light, np.float64),
                         address(work, np.float32)))
    return float(light[0]), float(light[1])
