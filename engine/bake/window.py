"""The window of the PSFs: how wide it has to be to hold the light, and so how fine its samples can lie."""

import numpy as np

from .diffraction import point_spread
from .wavefront import Wavefront

ENERGY = 0.995
SURVEY_SAMPLES = 101
MARGIN = 1.05  # for heights and wavelengths between those of the survey
SEARCH_STEPS = 12
WIDENING = 1.04


def pitch_for_um(width_um: float, samples: int) -> float:
    """Pitch at which a window of so many samples is a little wider than this: of two digits."""
    pitch_um = MARGIN * width_um / samples
    unit = 10.0 ** (np.floor(np.log10(pitch_um)) - 1)
    return float(np.round(np.ceil(pitch_um / unit) * unit, 9))


def needed_width_um(wavefront: Wavefront, samples: int) -> float:
    """Side of a window of so many samples that holds 99.5 % of the light."""
    width_um = _first_width_um(wavefront)
    for _ in range(SEARCH_STEPS):
        psf, _ = point_spread(wavefront, width_um / samples, samples)
        if psf.sum() >= ENERGY or not psf.any():
            break
        width_um *= WIDENING
    return width_um


def _first_width_um(wavefront):
    """What the rings of a wider, coarser PSF say, whose pupil has finer edges."""
    pitch_um = wavefront.wavelength_nm * 1e-3 / 2
    for _ in range(SEARCH_STEPS):
        psf, _ = point_spread(wavefront, pitch_um, SURVEY_SAMPLES)
        if psf.sum() > ENERGY or not psf.any():
            break
        pitch_um *= 2
    offset = np.abs(np.arange(SURVEY_SAMPLES) - SURVEY_SAMPLES // 2)
    inside = np.cumsum(np.bincount(np.maximum(offset[:, None], offset).ravel(), psf.ravel()))
    return (2 * np.interp(ENERGY, inside, np.arange(inside.size)) + 1) * pitch_um
