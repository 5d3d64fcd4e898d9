"""Bands: the wavelengths of each Cycles pass.

Red, green and blue carry one wavelength each, red the longest: even in a single pass, colours without a spectrum stay
close to the original. Each pass spans the spectrum: Cycles applies clamps and judges noise by the mean of the three
channels, and this mean is then comparable in all passes.
"""

import numpy as np

CHANNELS = "BGR"  # by ascending wavelength
WAVELENGTHS_PER_PASS = len(CHANNELS)


def pass_count(wavelengths, per_pass=WAVELENGTHS_PER_PASS):
    """Number of Cycles passes for this number of wavelengths."""
    return -(-wavelengths // per_pass)


def passes(wavelengths_nm, per_pass=WAVELENGTHS_PER_PASS):
    """Wavelengths of each pass: three, or one in all three channels; a pass with fewer repeats its last wavelength.

    Returns
    -------
    list of arrays (3,), nm
        For red, green and blue.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    count = pass_count(wavelengths_nm.size, per_pass)
    bands = [wavelengths_nm[index::count] for index in range(count)]
    return [np.pad(band, (0, WAVELENGTHS_PER_PASS - band.size), mode="edge")[::-1] for band in bands]
