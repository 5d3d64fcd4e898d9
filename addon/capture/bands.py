"""Bands: the wavelengths of each Cycles pass.

Red, green and blue carry one wavelength each, red the longest: even in a single pass, colours without a spectrum stay
close to the original. Each pass spans the spectrum: Cycles applies clamps, judges noise and samples a world by the mean
of the three channels, and this mean is then similar in all passes.
"""

import numpy as np

CHANNELS = "BGR"  # by ascending wavelength
WAVELENGTHS_PER_PASS = len(CHANNELS)


def pass_count(wavelengths, per_pass=WAVELENGTHS_PER_PASS):
    """Number of Cycles passes for this number of wavelengths."""
    return -(-wavelengths // per_pass)


def nodes_of_passes(wavelengths, per_pass=WAVELENGTHS_PER_PASS):
    """Indices of the wavelengths of each pass, ascending: list of arrays.

    Each third of the spectrum has one wavelength of each pass, in an order that alternates. So passes have nearly the
    same mean wavelength.
    """
    count = pass_count(wavelengths, per_pass)
    indices = np.arange(wavelengths)
    rows = [indices[first:first + count][::1 if first // count % 2 == 0 else -1]
            for first in range(0, wavelengths, count)]
    return [np.array([row[index] for row in rows if index < row.size]) for index in range(count)]


def passes(wavelengths_nm, per_pass=WAVELENGTHS_PER_PASS):
    """Wavelengths of each pass: three, or one in all three channels; a pass with fewer repeats its last wavelength.

    Returns
    -------
    list of arrays (3,), nm
        For red, green and blue.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    bands = [wavelengths_nm[nodes] for nodes in nodes_of_passes(wavelengths_nm.size, per_pass)]
    return [np.pad(band, (0, WAVELENGTHS_PER_PASS - band.size), mode="edge")[::-1] for band in bands]
