"""Conversion of spectral images to linear Rec. 709 in the scale of Blender's renders, and to sRGB PNG."""

import os

import numpy as np

from ..image.irradiance import irradiance_per_radiance
from ..image.spectral_image import IRRADIANCE, SpectralImage
from ..runtime.build_identity import software
from ..runtime.files import atomic_path
from ..spectral.colour import REC709_LUMINANCE, encode_srgb, rec709_weights

EXPOSED_PERCENTILE = 99.0  # of the picture's luminance; a few bright points may be clipped
EXPOSED_LEVEL = 0.9
ROWS_AT_ONCE = 64  # limits the intermediate arrays, which are larger than the picture
PNG_LEVEL = 1  # of 9: a half to a third of the time of the default 6, for at most a fifth more bytes


def to_rec709(image: SpectralImage) -> np.ndarray:
    """Linear Rec. 709 in the scale of Blender's renders.

    A light of Blender colour (1, 1, 1) and strength 1 (D65 of 1 W m^-2 sr^-1 within `spectra.BAND_NM`) gives
    (1, 1, 1), times the image's exposure. Irradiance is divided by pi / (4 N_eff^2), so a lens image is as bright on
    the axis as the render that it is computed from.

    Parameters
    ----------
    image : SpectralImage

    Returns
    -------
    float32 array (row, column, 3)
        Colours outside the gamut have negative components, and colours on its edge may: the red component of a pure
        blue is -0.2 % at 21 wavelengths. They are preserved here; `write_png` clips them for display.
    """
    weights = rec709_weights(image.wavelengths_nm) * image.exposure
    if image.quantity == IRRADIANCE and image.f_number_effective:
        weights = weights / irradiance_per_radiance(1.0, image.f_number_effective)
    return np.einsum("lyx,lc->yxc", image.cube, weights.astype(np.float32))


def auto_exposure(rec709: np.ndarray) -> float:
    """Factor that brings the bright parts of a linear picture just below white."""
    luminance = rec709 @ REC709_LUMINANCE.astype(rec709.dtype)
    bright = np.percentile(luminance, EXPOSED_PERCENTILE) or luminance.max()
    return EXPOSED_LEVEL / bright if bright > 0 else 1.0


def write_png(rec709: np.ndarray, path: str | os.PathLike, exposure: float) -> None:
    """Write a linear Rec. 709 picture as an 8-bit sRGB PNG, which appears complete or not at all.

    Parameters
    ----------
    rec709 : array (row, column, 3)
    path : path
    exposure : float
        Factor before the conversion; the result is clipped to 0 to 1.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import write_png
    >>> write_png(np.full((4, 6, 3), 0.18), "grey.png", exposure=1)
    """
    save_png(srgb_pixels(rec709, exposure), path)


def srgb_pixels(rec709: np.ndarray, exposure: float) -> np.ndarray:
    """A linear Rec. 709 picture in 8-bit sRGB: uint8 array (row, column, 3)."""
    pixels = np.empty(rec709.shape, np.uint8)
    for row in range(0, len(pixels), ROWS_AT_ONCE):
        rows = slice(row, row + ROWS_AT_ONCE)
        pixels[rows] = np.round(encode_srgb(rec709[rows] * exposure) * 255)
    return pixels


def save_png(pixels: np.ndarray, path: str | os.PathLike) -> None:
    """Write 8-bit pixels as a PNG, which appears complete or not at all."""
    from PIL import Image, PngImagePlugin  # only needed here, and rarely

    texts = PngImagePlugin.PngInfo()
    texts.add_text("Software", software())
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", compress_level=PNG_LEVEL, pnginfo=texts)
