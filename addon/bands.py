"""Bands: which wavelengths ride in which Cycles pass. Red, green and blue carry one wavelength each."""

import numpy as np

WAVELENGTHS_PER_PASS = 3


def pass_count(wavelengths):
    """Cycles passes that this number of wavelengths takes."""
    return -(-wavelengths // WAVELENGTHS_PER_PASS)


def passes(wavelengths_nm):
    """Wavelengths of each pass, the last one filled up by repeating the last wavelength.

    Returns
    -------
    list of arrays (3,), nm
    """
    count = pass_count(len(wavelengths_nm))
    filled = np.pad(np.asarray(wavelengths_nm, dtype=float), (0, count * WAVELENGTHS_PER_PASS - len(wavelengths_nm)),
                    mode="edge")
    return list(filled.reshape(count, WAVELENGTHS_PER_PASS))
