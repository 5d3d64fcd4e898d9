"""Digital numbers of a sensor's pixels, with their noise."""

from ctypes import byref

import numpy as np

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import NUMPY, check, chosen, running
from .numpy_reading import numpy_read
from .pixels import Pixels

PIXELS = STRUCTURES["pixels"]


def read(pixels: Pixels, light_e: np.ndarray, rows: slice, numbers: np.ndarray) -> None:
    """Write the digital numbers of some rows.

    Parameters
    ----------
    pixels : Pixels
    light_e : float32 array (channel, row, column)
        Mean electrons from light; negative numbers and not-a-number count as 0.
    rows : slice
    numbers : uint16 array (channel, row, column)

    Raises
    ------
    ValueError
        Sizes do not agree.
    """
    if running() == NUMPY:
        numpy_read(pixels, light_e, rows, numbers)
        return
    loops, variant = chosen()
    first, end, _ = rows.indices(light_e.shape[1])
    structure = PIXELS(pixels.pixel_key, pixels.noise_key, *pixels.place, pixels.prnu, pixels.dsnu_e, pixels.dark_e,
                       pixels.full_e, pixels.noise_e, pixels.gain_dn_per_e, pixels.black_dn, pixels.white_dn,
                       int(pixels.noisy))
    check(loops.lf_read(variant, byref(structure), byref(picture(light_e)), first, end,
                        address(numbers, np.uint16, light_e.shape)))
