"""Pass arrays to the loops."""

import ctypes

import numpy as np
from numpy.typing import DTypeLike

from .declarations import STRUCTURES


def address(array: np.ndarray, dtype: DTypeLike, shape: tuple[int, ...] | None = None) -> int:
    """The address of a contiguous array of this type and shape. Keep the array while the address is in use.

    Raises
    ------
    ValueError
    """
    fits = array.dtype == dtype and array.flags.c_contiguous and array.flags.aligned
    if not fits or shape not in (None, array.shape):
        raise ValueError(f"{array.dtype} array of shape {array.shape} and strides {array.strides}: expected contiguous "
                         f"{np.dtype(dtype)}" + (f" of shape {shape}" if shape else ""))
    return array.ctypes.data


def picture(array: np.ndarray) -> ctypes.Structure:
    """The structure for the loops of a float32 array (plane, row, column) with contiguous rows.

    Raises
    ------
    ValueError
    """
    fits = array.ndim == 3 and array.dtype == np.float32 and array.flags.aligned
    if not fits or (array.strides[2] != 4 and array.shape[2] > 1 and array.size):
        raise ValueError(f"{array.dtype} array of shape {array.shape} and strides {array.strides}: expected float32 "
                         "(plane, row, column) with contiguous rows")
    return STRUCTURES["picture"](array.ctypes.data, *array.shape, array.strides[0] // 4, array.strides[1] // 4)
