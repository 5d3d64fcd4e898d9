"""The window of the PSFs: how wide it has to be to hold the light, and so how fine its samples can lie."""

import numpy as np

from .diffraction import point_spread

ENERGY = 0.995
SURVEY_SAMPLES = 101
MARGIN = 1.03  # for wavelengths between those of the survey
SEARCH_STEPS = 12  # windows of twice the size each


def pitch_for_um(width_um, samples):
    """Pitch at which a window of so many samples is a little wider than this: of two digits."""
    pitch_um = MARGIN * width_um / samples
    unit = 10.0 ** (np.floor(np.log10(pitch_um)) - 1)
    return float(np.round(np.ceil(pitch_um / unit) * unit, 9))


def needed_width_um(wavefront):
    """Side of the square about the chief ray that holds 99.5 % of the light of a `Wavefront`."""
    pitch_um = wavefront.wavelength_nm * 1e-3 / 2
    for _ in range(SEARCH_STEPS):
        psf, _ = point_spread(wavefront, pitch_um, SURVEY_SAMPLES)
        if psf.sum() > ENERGY or not psf.any():
            break
        pitch_um *= 2
    offset = np.abs(np.arange(SURVEY_SAMPLES) - SURVEY_SAMPLES // 2)
    inside = np.cumsum(np.bincount(np.maximum(offset[:, None], offset).ravel(), psf.ravel()))
    return (2 * np.interp(ENERGY, inside, np.arange(inside.size)) + 1) * pitch_um
