"""The light of each pixel through its own filter."""

from ctypes import byref

import numpy as np

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import NUMPY, check, chosen, running

FILTERS = STRUCTURES["filters"]
WIDE = 64  # columns that are summed together, at least


def collect(light: np.ndarray, weights: np.ndarray, rows: slice, out: np.ndarray) -> None:
    """Write some rows of a picture: sums over the planes, with the factors of each pixel's filter.

    Parameters
    ----------
    light : float32 array (plane, row, column)
    weights : float32 array (cell row, plane, cell column)
        Of a cell of filters that is repeated from the first pixel on.
    rows : slice
    out : float32 array (row, column)

    Raises
    ------
    ValueError
        Sizes do not agree.
    """
    if weights.shape[1] != len(light):
        raise ValueError(f"weights of {weights.shape[1]} planes: expected {len(light)}")
    weights = np.ascontiguousarray(np.tile(weights, -(-WIDE // weights.shape[2])))
    if running() == NUMPY:
        out[rows] = _collected(light[:, rows], np.roll(weights, -rows.start, axis=0))
        return
    loops, variant = chosen()
    first, end, _ = rows.indices(out.shape[0])
    filters = FILTERS(address(weights, np.float32), weights.shape[0], weights.shape[2])
    check(loops.lf_collect(variant, byref(picture(light)), byref(filters), first, end, byref(picture(out[None]))))


def _collected(light, weights):
    row, column = (np.arange(n) % cell for n, cell in zip(light.shape[1:], weights[:, 0].shape, strict=True))
    sums = np.zeros(light.shape[1:], np.float32)
    for plane, factors in zip(light, np.moveaxis(weights, 1, 0), strict=True):
        sums += plane * factors[row][:, column]
    return sums
