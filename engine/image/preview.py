"""From spectral images to pictures: CIE 1931 tristimulus values, linear Rec. 709, sRGB PNG."""

import numpy as np

from .atomic import atomic_path
from .ideal import irradiance_per_radiance
from .spectra import BAND_NM, colour_matching, white_density
from .spectral_image import IRRADIANCE

XYZ_TO_REC709 = np.array([[3.2404542, -1.5371385, -0.4985314],
                          [-0.9692660, 1.8760108, 0.0415560],
                          [0.0556434, -0.2040259, 1.0572252]])  # IEC 61966-2-1
EXPOSED_PERCENTILE = 99.0  # of the picture's luminance; a few bright points may burn out
EXPOSED_LEVEL = 0.9


def to_rec709(image):
    """Linear Rec. 709 in the scale of Blender's own renders.

    A light of Blender colour (1, 1, 1) and strength 1 (D65 of 1 W m^-2 sr^-1 within `spectra.BAND_NM`) gives
    (1, 1, 1). Irradiance is divided by pi / (4 N_eff^2), so that a lens image is as bright on the axis as the render
    that it came from.

    Parameters
    ----------
    image : SpectralImage

    Returns
    -------
    float32 array (row, column, 3); colours outside the gamut have negative parts
    """
    weights = _rec709_weights(image.wavelengths_nm)
    if image.quantity == IRRADIANCE and image.f_number_effective:
        weights = weights / irradiance_per_radiance(1.0, image.f_number_effective)
    return np.einsum("lyx,lc->yxc", image.cube, weights.astype(np.float32))


def _rec709_weights(wavelengths_nm):
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


def auto_exposure(rec709):
    """Factor that brings the bright parts of a linear picture just below white."""
    luminance = rec709 @ np.array([0.2126, 0.7152, 0.0722], dtype=rec709.dtype)
    bright = np.percentile(luminance, EXPOSED_PERCENTILE) or luminance.max()
    return EXPOSED_LEVEL / bright if bright > 0 else 1.0


def encode_srgb(linear):
    """The sRGB transfer curve, of values clipped to [0, 1]."""
    clipped = np.clip(linear, 0, 1)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.power(clipped, 1 / 2.4) - 0.055)


def write_png(rec709, path, exposure):
    """Write a linear Rec. 709 picture as an sRGB PNG of 8 bits, whole or not at all."""
    from PIL import Image  # only pictures need it, and they are few

    pixels = np.round(encode_srgb(rec709 * exposure) * 255).astype(np.uint8)
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG")
