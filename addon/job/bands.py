"""Bands: which wavelengths ride in which Cycles pass. Red, green and blue carry one wavelength each."""

import numpy as np

WAVELENGTHS_PER_PASS = 3


def pass_count(wavelengths, per_pass=WAVELENGTHS_PER_PASS):
    """Cycles passes that this number of wavelengths takes."""
    return -(-wavelengths // per_pass)


def passes(wavelengths_nm, per_pass=WAVELENGTHS_PER_PASS):
    """Wavelengths of each pass: three, or one in all three channels; the last pass repeats its last wavelength.

    Returns
    -------
    list of arrays (3,), nm
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    bands = np.split(wavelengths_nm, range(per_pass, wavelengths_nm.size, per_pass))
    return [np.pad(band, (0, WAVELENGTHS_PER_PASS - band.size), mode="edge") for band in bands]
