"""Digital numbers of a sensor's pixels, with their noise."""

from ctypes import byref
from dataclasses import dataclass

import numpy as np

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import NUMPY, check, chosen, running
from .numpy_reading import numpy_read

PIXELS = STRUCTURES["pixels"]


@dataclass(frozen=True)
class Pixels:
    """A sensor's pixels, as they are read in an exposure.

    Attributes
    ----------
    pixel_key, noise_key : int
        64 bits: keys of the random numbers for the pixels' differences, and for this exposure.
    place : (int, int)
        Row and column of the picture's first pixel on the sensor.
    prnu : float
        Standard deviation of the pixels' response over its mean.
    dsnu_e : float
        Standard deviation of their dark signal.
    dark_e : float
        Mean dark signal.
    full_e : float
        Full well.
    noise_e : float
        Noise of the reading.
    gain_dn_per_e, black_dn : float
    white_dn : int
        The highest digital number.
    noisy : bool
        False leaves out everything random.
    """

    pixel_key: int
    noise_key: int
    place: tuple[int, int]
    prnu: float
    dsnu_e: float
    dark_e: float
    full_e: float
    noise_e: float
    gain_dn_per_e: float
    black_dn: float
    white_dn: int
    noisy: bool


def key(*numbers: int) -> int:
    """A key for random numbers, from whole numbers of 0 or more, up to 64 bits each."""
    words = [word for number in numbers for word in divmod(number, 2**32)]  # two each: otherwise, some keys are equal
    return int(np.random.SeedSequence(words).generate_state(1, np.uint64).view(np.int64)[0])


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
