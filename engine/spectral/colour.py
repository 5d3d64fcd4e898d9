"""From spectra to colours: CIE 1931 tristimulus values, linear Rec. 709, sRGB."""

import numpy as np

from .spectra import BAND_NM, colour_matching, white_density

XYZ_TO_REC709 = np.array([[3.2404542, -1.5371385, -0.4985314],
                          [-0.9692660, 1.8760108, 0.0415560],
                          [0.0556434, -0.2040259, 1.0572252]])  # IEC 61966-2-1


def rec709_weights(wavelengths_nm):
    """Weight of each wavelength's spectral radiance in R, G and B: array (wavelength, 3).

    Between the wavelengths the *ratio* to D65 is taken to be linear, beyond them constant: few wavelengths then
    still give the whites right, and a single one a grey picture.
    """
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    white = white_density(nm)
    tristimulus = colour_matching(nm) * white[:, None]
    tristimulus /= tristimulus[:, 1].sum()
    hats = np.stack([np.interp(nm, wavelengths_nm, unit) for unit in np.eye(wavelengths_nm.size)])
    rec709 = hats @ tristimulus @ XYZ_TO_REC709.T
    white_at = white_density(wavelengths_nm)[:, None]
    total = rec709[white_at[:, 0] > 0].sum(axis=0)
    rec709 /= np.where(total == 0, 1, total)  # D65 is (1, 1, 1) to the last digit
    return np.divide(rec709, white_at, out=np.zeros_like(rec709), where=white_at > 0)  # outside the band: unseen


def encode_srgb(linear):
    """The sRGB transfer curve, of values clipped to [0, 1]."""
    clipped = np.clip(linear, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.power(clipped, 1 / 2.4) - 0.055)
