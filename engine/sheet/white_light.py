"""A lens in white light: its wavelengths as the eye sees them, and its PSFs with their lateral colour."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import irfft, rfft

from ..lens.curves import WHITE_NM, lateral_colour_um
from ..lens.lens import Lens
from ..spectral.colour import REC709_LUMINANCE, XYZ_TO_REC709, encode_srgb
from ..spectral.spectra import colour_matching, linear_weights

DIMMING = 0.4  # power of the eye's sensitivity: the ends of the spectrum become darker, and so differ from one another
DARKEST, LIGHTEST = 0.1, 0.3  # as linear light and luminance: what is told apart, and read, on white paper
UNSEEN = (0.35, 0.35, 0.35)


def wavelength_colours(wavelengths_nm: ArrayLike) -> np.ndarray:
    """Colours to draw wavelengths in on white paper: sRGB array (wavelength, 3), grey outside the visible band."""
    tristimulus = colour_matching(np.asarray(wavelengths_nm, dtype=float))
    rec709 = tristimulus @ XYZ_TO_REC709.T
    rec709 -= np.minimum(rec709.min(axis=1, keepdims=True), 0)  # as much white as brings it into the gamut
    brightest = rec709.max(axis=1, keepdims=True)
    seen = tristimulus.sum(axis=1, keepdims=True) / colour_matching(WHITE_NM).sum(axis=1).max()
    full = np.divide(rec709, brightest, out=np.zeros_like(rec709), where=brightest > 0)
    luminance = (full @ REC709_LUMINANCE)[:, None]
    ink = np.minimum(np.clip(seen ** DIMMING, DARKEST, 1), LIGHTEST / np.maximum(luminance, LIGHTEST))
    return np.where(brightest > 0, encode_srgb(full * ink), UNSEEN)


def white_psfs(lens: Lens, heights: Sequence[int] | np.ndarray) -> np.ndarray:
    """PSFs in white light of equal energy, each wavelength at its own chief ray, so that lateral colour shows.

    Parameters
    ----------
    lens : Lens
    heights : sequence of int
        Which of its field heights.

    Returns
    -------
    float64 array (height, v, u, 3)
        Linear Rec. 709 in which all the light of a PSF together is (1, 1, 1). The chief ray of the reference wavelength
        is at `[n // 2, n // 2]` of its last two dimensions of space, n differing between v and u.
    """
    moved = lateral_colour_um(lens, WHITE_NM)[:, heights] / lens.psf_pitch_um
    reach = int(np.ceil(np.abs(moved).max())) + 1
    rec709 = colour_matching(WHITE_NM) @ XYZ_TO_REC709.T
    weights = linear_weights(lens.wavelengths_nm, WHITE_NM)[:, :, None] * (rec709 / rec709.sum(axis=0))[:, None]
    steps = np.arange(-reach, reach + 1)
    colours = []
    for height, own in zip(heights, moved.T, strict=True):
        shares = np.maximum(0, 1 - np.abs(steps[:, None] - own))  # of each wavelength, by how far it is moved outwards
        kernel = np.einsum("sn,nlc->lsc", shares, weights)
        psf, length = lens.psf[:, height].astype(np.float64), lens.psf.shape[2] + len(steps) - 1
        spread = np.einsum("lvu,lvc->vuc", rfft(psf, length, axis=1), rfft(kernel, length, axis=1))
        colours.append(irfft(spread, length, axis=0))
    return np.stack(colours)
