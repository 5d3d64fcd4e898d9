"""Repeated colours: glass and volumes, which multiply light many times along its path.

A spectral renderer takes powers of a spectrum, an RGB renderer powers of red, green and blue. Each channel of RGB is a
mean over wavelengths, and the mean of a power exceeds the power of a mean: for a reflectance s(λ) = Σ_c b_c(λ) c with
b_c >= 0 and Σ_c b_c = 1, s(λ)^n <= Σ_c b_c(λ) c^n by Jensen's inequality, for all n >= 1. Saturated glass and volumes
are therefore darker in a spectral render than in an RGB render at every wavelength, and their hue differs. Neither
renderer is in error: RGB lacks light between its primaries.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from .colour import REC709_TO_XYZ, rec709_weights
from .colour_difference import ciede2000, lab_from_xyz
from .spectra import BAND_NM, white_density

FINE_NM = np.arange(BAND_NM[0], BAND_NM[1] + 1)
Curve = Callable[[np.ndarray], np.ndarray]  # values at wavelengths in nm


@dataclass(frozen=True, eq=False)
class RepeatedColour:
    """A colour that multiplies light several times.

    Attributes
    ----------
    curve : callable (wavelengths_nm) -> values
        Transmittance of one crossing of a surface, or of an optical depth of 1.
    rgb : float array (3,)
        The same in linear Rec. 709, as used by an RGB renderer.
    powers : ascending float array (power,)
        Numbers of crossings, or optical depths, to consider.
    """

    curve: Curve
    rgb: np.ndarray
    powers: np.ndarray

    def transports(self, wavelengths_nm: np.ndarray) -> np.ndarray:
        """Transmittance after each of the powers: array (power, wavelength)."""
        return np.asarray(self.curve(wavelengths_nm))[None]**self.powers[:, None]

    def rgb_difference(self) -> tuple[float, float]:
        """Difference between a spectral and an RGB renderer, for white light (D65).

        Returns
        -------
        float, float
            The largest CIEDE2000 over the powers, and its power.
        """
        of_rgb = np.asarray(self.rgb)[None]**self.powers[:, None]
        differences = ciede2000(_lab(rec709_of(self.transports)), _lab(of_rgb))
        worst = int(np.argmax(differences))
        return float(differences[worst]), float(self.powers[worst])


def rec709_of(curve: Curve) -> np.ndarray:
    """Linear Rec. 709 of white light (D65) times a curve: array (..., 3) for a curve with values (..., wavelength)."""
    return np.asarray(curve(FINE_NM)) @ _rec709_of_white()


@cache
def _rec709_of_white():
    """Share of each wavelength of FINE_NM in the R, G and B of white: array (wavelength, 3)."""
    return white_density(FINE_NM)[:, None] * rec709_weights(FINE_NM)


def _lab(rec709):
    """L*, a*, b* relative to white: array (..., 3)."""
    return lab_from_xyz(rec709 @ REC709_TO_XYZ.T, REC709_TO_XYZ.sum(axis=1))
