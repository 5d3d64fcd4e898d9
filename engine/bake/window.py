"""The PSF window: the width that contains the light, and so the finest pitch of its samples."""

import numpy as np

from .spots import spot_diagram
from .wavefront import Wavefront, Wavefronts

ENERGY = 0.995
PLACES = 12  # heights with the widest estimates, measured by their spot diagrams
SAMPLES = 101  # of these diagrams
GENEROUS = 1.5  # first window relative to the estimate
SQUARE = 0.9  # light outside a square relative to light outside a circle of the same width
MARGIN = 1.05  # for heights and wavelengths between the surveyed ones
ATTEMPTS = 12


def pitch_for_um(width_um: float, samples: int) -> float:
    """Pitch, rounded up to two digits, at which `samples` samples are a little wider than the window."""
    pitch_um = MARGIN * width_um / samples
    unit = 10.0 ** (np.floor(np.log10(pitch_um)) - 1)
    return float(np.round(np.ceil(pitch_um / unit) * unit, 9))


def needed_width_um(wavefronts: Wavefronts) -> float:
    """Side of the window that contains 99.5 % of the light of every wavefront."""
    estimates_um = _estimated_widths_um(wavefronts)
    wavelengths = estimates_um.argmax(axis=0)
    widest = np.argsort(estimates_um.max(axis=0))[::-1][:PLACES]
    return max(width_um(wavefronts.one(wavelengths[height], height), estimates_um[wavelengths[height], height])
               for height in widest)


def width_um(wavefront: Wavefront, about_um: float) -> float:
    """Side of the window that contains 99.5 % of a wavefront's light, by its spot diagram.

    `about_um` is an estimate.
    """
    window_um = GENEROUS * about_um
    for _ in range(ATTEMPTS):
        psf = spot_diagram(wavefront, window_um / SAMPLES, SAMPLES)
        if psf.sum() > ENERGY:
            break
        window_um *= 2
    offset = np.abs(np.arange(SAMPLES) - SAMPLES // 2)
    inside = np.cumsum(np.bincount(np.maximum(offset[:, None], offset).ravel(), psf.ravel()))
    return (2 * np.interp(ENERGY, inside, np.arange(inside.size)) + 1) * window_um / SAMPLES


def _estimated_widths_um(wavefronts):
    """Estimates by rays, plus diffraction at the edges of the pupil: array (wavelength, height).

    Diffracted light beyond a distance is proportional to its reciprocal, as in the Airy pattern.
    """
    widths_um = np.zeros(wavefronts.chief_height_mm.shape)
    for place in np.ndindex(widths_um.shape):
        one = wavefronts.one(*place)
        if not one.passing.any():
            continue
        off_um = 1e3 * np.abs(wavefronts.spot_mm[(..., *place, slice(None), slice(None))]).max(axis=0)[one.passing]
        light = np.broadcast_to(one.pupil.radii[:, None], one.passing.shape)[one.passing]  # of a ring
        order = np.argsort(off_um)
        beyond = 1 - np.cumsum(light[order]) / light.sum()
        x, y = one.cosine[:, one.passing]
        half_x = np.abs(x).max() if one.pupil.mirrored else np.ptp(x) / 2
        edges = 1 / max(half_x, 1e-6) + 2 / max(np.ptp(y), 1e-6)
        half_um = np.geomspace(0.1, 1e4, 400)
        diffracted = SQUARE * one.wavelength_nm * 1e-3 * edges / (2 * np.pi**2 * half_um)
        outside = np.interp(half_um, off_um[order], beyond) + diffracted
        widths_um[place] = 2 * half_um[np.argmax(outside < 1 - ENERGY)]
    return widths_um
