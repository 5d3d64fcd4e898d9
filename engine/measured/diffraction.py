"""The PSF of a perfect lens: the Airy pattern of its f-number, integrated over the samples."""

from typing import NamedTuple

import numpy as np
import scipy

SAMPLES = 33  # along each side: a grid of lens data has up to 1400 PSFs at each wavelength
ENERGY = 0.985  # of the light in the window, at the longest wavelength
PARTS = 13  # of a sample along each side


class PerfectPsfs(NamedTuple):
    """PSFs of a lens that diffraction alone blurs.

    Attributes
    ----------
    psf : array (wavelength, v, u)
        Of unit sum.
    pitch_um : float
    enclosed : array (wavelength,)
        Fraction of the light within the window.
    """

    psf: np.ndarray
    pitch_um: float
    enclosed: np.ndarray


def perfect_psfs(f_number: float, wavelengths_nm: np.ndarray) -> PerfectPsfs:
    """The PSFs of a round pupil in focus, at the f-number in image space, with their window of SAMPLES.

    The share of light beyond the radius r is 2 wavelength N / (pi^2 r), far from the middle.
    """
    blur_um = np.asarray(wavelengths_nm) * 1e-3 * f_number
    radius_um = 2 * blur_um.max() / (np.pi**2 * (1 - ENERGY))
    pitch_um = 2 * radius_um / SAMPLES
    offsets_um = pitch_um / PARTS * (np.arange(SAMPLES * PARTS) - (SAMPLES * PARTS - 1) / 2)
    distance_um = np.hypot(offsets_um[:, None], offsets_um)
    light = np.stack([_samples(_airy(distance_um, each) * (pitch_um / PARTS)**2) for each in blur_um])
    enclosed = light.sum(axis=(1, 2))
    return PerfectPsfs(light / enclosed[:, None, None], float(pitch_um), enclosed)


def _airy(distance_um, blur_um):
    """Light per square um, of unit sum; `blur_um` is the wavelength times the f-number."""
    phase = np.pi * distance_um / blur_um
    amplitude = np.where(phase > 0, 2 * scipy.special.j1(phase) / np.where(phase > 0, phase, 1), 1)
    return np.pi / (4 * blur_um**2) * amplitude**2


def _samples(parts):
    return parts.reshape(SAMPLES, PARTS, SAMPLES, PARTS).sum(axis=(1, 3))
