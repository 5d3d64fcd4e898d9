"""A lens in white light: its wavelengths as visible colours, and its PSFs with their lateral colour."""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..lens import Lens, RadialLens
from ..spectral.colour import REC709_LUMINANCE, XYZ_TO_REC709, encode_srgb
from ..spectral.spectra import colour_matching, linear_weights
from .curves import WHITE_NM, radial_colour_um

DIMMING = 0.4  # power of the eye's sensitivity, which darkens the ends of the spectrum to make them distinguishable
DARKEST, LIGHTEST = 0.1, 0.3  # linear light and luminance that remain distinguishable and legible on white paper
INVISIBLE = (0.35, 0.35, 0.35)


def wavelength_colours(wavelengths_nm: ArrayLike) -> np.ndarray:
    """Colours for wavelengths on white paper: sRGB array (wavelength, 3), grey outside the visible band."""
    tristimulus = colour_matching(np.asarray(wavelengths_nm, dtype=float))
    rec709 = tristimulus @ XYZ_TO_REC709.T
    rec709 -= np.minimum(rec709.min(axis=1, keepdims=True), 0)  # adds enough white to bring it into the gamut
    brightest = rec709.max(axis=1, keepdims=True)
    sensitivity = tristimulus.sum(axis=1, keepdims=True) / colour_matching(WHITE_NM).sum(axis=1).max()
    full = np.divide(rec709, brightest, out=np.zeros_like(rec709), where=brightest > 0)
    luminance = (full @ REC709_LUMINANCE)[:, None]
    ink = np.minimum(np.clip(sensitivity ** DIMMING, DARKEST, 1), LIGHTEST / np.maximum(luminance, LIGHTEST))
    return np.where(brightest > 0, encode_srgb(full * ink), INVISIBLE)


def white_psfs(lens: RadialLens, heights: Sequence[int] | np.ndarray) -> np.ndarray:
    """PSFs at field heights, by their indices, in white light: array (height, v, u, 3), as by `in_white_light`."""
    return in_white_light(lens, lens.psf[:, heights], radial_colour_um(lens)[:, heights])


def in_white_light(lens: Lens, psf: np.ndarray, moved_um: np.ndarray) -> np.ndarray:
    """PSFs in equal-energy white light, with lateral colour: each wavelength is at its chief ray.

    Parameters
    ----------
    lens : Lens
    psf : array (wavelength, place, v, u)
    moved_um : array (wavelength of WHITE_NM, place, 2)
        Lateral colour along v and u.

    Returns
    -------
    float64 array (place, v, u, 3)
        Linear Rec. 709, with (1, 1, 1) as the total light of a PSF. The chief ray of the reference wavelength is at
        `[n // 2, n // 2]` along v and u, with a different n for each.
    """
    moved = moved_um / lens.psf_pitch_um
    steps = [np.arange(-reach, reach + 1) for reach in np.ceil(np.abs(moved).max(axis=(0, 1))).astype(int)]
    rec709 = colour_matching(WHITE_NM) @ XYZ_TO_REC709.T
    weights = linear_weights(lens.wavelengths_nm, WHITE_NM)[:, :, None] * (rec709 / rec709.sum(axis=0))[:, None]
    lengths = [n + step.size - 1 for n, step in zip(psf.shape[-2:], steps, strict=True)]
    colours = []
    for place, shifts in enumerate(np.moveaxis(moved, 1, 0)):
        shares = [np.maximum(0, 1 - np.abs(step[:, None] - along))  # of each wavelength, by its shift
                  for step, along in zip(steps, shifts.T, strict=True)]
        kernel = np.einsum("vn,un,nlc->lvuc", *shares, weights, optimize=True)
        spread = np.einsum("lvu,lvuc->vuc", scipy.fft.rfft2(psf[:, place].astype(np.float64), lengths),
                           scipy.fft.rfft2(kernel, lengths, axes=(1, 2)))
        colours.append(scipy.fft.irfft2(spread, lengths, axes=(0, 1)))
    return np.stack(colours)
