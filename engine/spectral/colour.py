"""From spectra to colours: CIE 1931 tristimulus values, linear Rec. 709, sRGB."""

import numpy as np
from numpy.typing import ArrayLike

from .spectra import BAND_NM, colour_matching, emission_basis, linear_weights, white_density

XYZ_TO_REC709 = np.array([[3.2404542, -1.5371385, -0.4985314],
                          [-0.9692660, 1.8760108, 0.0415560],
                          [0.0556434, -0.2040259, 1.0572252]])  # IEC 61966-2-1
REC709_TO_XYZ = np.linalg.inv(XYZ_TO_REC709)
REC709_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
LARGEST_CONDITION = 20  # of the colour correction: 12 for three wavelengths over the visible range, 1.3 for nine


def rec709_weights(wavelengths_nm: np.ndarray) -> np.ndarray:
    """Weight of each wavelength's spectral radiance in R, G and B: array (wavelength, 3).

    The *ratio* to D65 is interpolated linearly between the wavelengths, and constant beyond. Whites are therefore
    correct even with few wavelengths, and a single wavelength gives a grey picture.
    """
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    white = white_density(nm)
    tristimulus = colour_matching(nm) * white[:, None]
    tristimulus /= tristimulus[:, 1].sum()
    rec709 = linear_weights(wavelengths_nm, nm).T @ tristimulus @ XYZ_TO_REC709.T
    white_at = white_density(wavelengths_nm)[:, None]
    total = rec709[white_at[:, 0] > 0].sum(axis=0)
    rec709 /= np.where(total == 0, 1, total)  # D65 is (1, 1, 1) to the last digit
    return np.divide(rec709, white_at, out=np.zeros_like(rec709), where=white_at > 0)  # outside the band: invisible


def metamer_weights(wavelengths_nm: np.ndarray, few_nm: np.ndarray) -> np.ndarray:
    """Weight of each wavelength's light in light of three wavelengths that has the same colour by `rec709_weights`.

    Parameters
    ----------
    wavelengths_nm : array (wavelength,)
    few_nm : array (3,)

    Returns
    -------
    array (wavelength, 3)
    """
    return rec709_weights(wavelengths_nm) @ np.linalg.inv(rec709_weights(np.asarray(few_nm)))


def light_basis(wavelengths_nm: np.ndarray) -> np.ndarray:
    """Spectral density per nm of each linear Rec. 709 primary: `spectra.emission_basis`, corrected for few wavelengths.

    A few samples of the smooth spectra do not sum to the colours of the primaries: at nine wavelengths, red is 13 % too
    dark. The primaries are therefore mixed so that `rec709_weights` reproduce each of them. White is D65 in both cases.
    Without correction if the wavelengths are too few or too close together to separate three colours.

    Returns
    -------
    array (wavelength, 3)
    """
    basis = emission_basis(wavelengths_nm)
    response = rec709_weights(wavelengths_nm).T @ basis
    return basis @ np.linalg.inv(response) if np.linalg.cond(response) < LARGEST_CONDITION else basis


def encode_srgb(linear: ArrayLike) -> np.ndarray:
    """The sRGB transfer curve of values clipped to [0, 1]."""
    clipped = np.clip(linear, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.power(clipped, 1 / 2.4) - 0.055)


def decode_srgb(encoded: ArrayLike) -> np.ndarray:
    """Linear values from 0 to 1 of the sRGB standard's encoded ones."""
    encoded = np.asarray(encoded)
    return np.where(encoded <= 0.04045, encoded / 12.92, np.power((encoded + 0.055) / 1.055, 2.4))
