"""Bands: which wavelengths ride in which Cycles pass. Red, green and blue carry one each, red the longest: so even in
a single pass, colours that no spectrum stands for come out much like themselves. Each pass has wavelengths from end to
end of the spectrum: so what Cycles judges by the mean of its three, clamps and noise, it judges alike in all passes."""

import numpy as np

CHANNELS = "BGR"  # in the order of their wavelengths
WAVELENGTHS_PER_PASS = len(CHANNELS)


def pass_count(wavelengths, per_pass=WAVELENGTHS_PER_PASS):
    """Cycles passes that this number of wavelengths takes."""
    return -(-wavelengths // per_pass)


def passes(wavelengths_nm, per_pass=WAVELENGTHS_PER_PASS):
    """Wavelengths of each pass: three, or one in all three channels; a pass of less repeats its last wavelength.

    Returns
    -------
    list of arrays (3,), nm
        For red, green and blue.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    count = pass_count(wavelengths_nm.size, per_pass)
    bands = [wavelengths_nm[index::count] for index in range(count)]
    return [np.pad(band, (0, WAVELENGTHS_PER_PASS - band.size), mode="edge")[::-1] for band in bands]
