"""A sensor's pixels, and the keys of their random numbers."""

from dataclasses import dataclass

import numpy as np


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
