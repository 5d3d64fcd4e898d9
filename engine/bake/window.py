"""The window of the PSFs: how wide it has to be to hold the light, and so how fine its samples can lie."""

from dataclasses import replace

import numpy as np

from .diffraction import Sums, point_spread
from .wavefront import Wavefront, Wavefronts

ENERGY = 0.995
PLACES = 6  # heights of the widest estimates, where PSFs then tell the width
SAMPLES = 101  # of these PSFs
GENEROUS = 1.5  # of the estimate
REPEAT = 4.0  # of their sums: so far from its next copy a PSF has the light that it should have
FRINGES = 5.5  # in a sample: as few only where diffraction spreads a seventh of the light that a window may lack
SQUARE = 0.9  # of the light beyond a circle's edge, that beyond a square's of the same width
MARGIN = 1.05  # for heights and wavelengths between those of the survey
ATTEMPTS = 12
SETTLED = 1e-3  # of the light: twice as wide a window that holds no more has all that the sums have


def pitch_for_um(width_um: float, samples: int) -> float:
    """Pitch at which a window of so many samples is a little wider than this: of two digits."""
    pitch_um = MARGIN * width_um / samples
    unit = 10.0 ** (np.floor(np.log10(pitch_um)) - 1)
    return float(np.round(np.ceil(pitch_um / unit) * unit, 9))


def needed_width_um(wavefronts: Wavefronts, sums: Sums) -> float:
    """Side of the window that holds 99.5 % of the light of all of these."""
    estimates_um = _estimated_widths_um(wavefronts)
    wavelengths = estimates_um.argmax(axis=0)
    widest = np.argsort(estimates_um.max(axis=0))[::-1][:PLACES]
    return max(width_um(wavefronts.one(wavelengths[height], height), estimates_um[wavelengths[height], height], sums)
               for height in widest)


def width_um(wavefront: Wavefront, about_um: float, sums: Sums) -> float:
    """Side of the window that holds 99.5 % of the light of one, which is about as wide as this: by its PSF's rings.

    Where apertures cut the pupil coarse sums may lack a little of the light: then it is 99.5 % of what they have.
    """
    sums, window_um, held = replace(sums, repeat=REPEAT, fringes=FRINGES), GENEROUS * about_um, 0.0
    for _ in range(ATTEMPTS):
        psf = point_spread(wavefront, window_um / SAMPLES, SAMPLES, sums)
        before, held = held, psf.sum()
        if held > ENERGY or held - before < SETTLED:
            break
        window_um *= 2
    share = ENERGY if held > ENERGY else ENERGY * held
    offset = np.abs(np.arange(SAMPLES) - SAMPLES // 2)
    inside = np.cumsum(np.bincount(np.maximum(offset[:, None], offset).ravel(), psf.ravel()))
    return (2 * np.interp(share, inside, np.arange(inside.size)) + 1) * window_um / SAMPLES


def _estimated_widths_um(wavefronts):
    """By rays, and by how much diffraction at the edges of the pupil spreads: array (wavelength, height).

    What lies beyond a distance falls with its reciprocal, as outside of Airy's pattern.
    """
    widths_um = np.zeros(wavefronts.chief_height_mm.shape)
    for place in np.ndindex(widths_um.shape):
        one = wavefronts.one(*place)
        if not one.passing.any():
            continue
        off_um = 1e3 * np.abs(wavefronts.spot_mm[(..., *place, slice(None), slice(None))]).max(axis=0)[one.passing]
        light = np.broadcast_to(one.pupil.radii[:, None], one.passing.shape)[one.passing]  # rings hold it by radius
        order = np.argsort(off_um)
        beyond = 1 - np.cumsum(light[order]) / light.sum()
        x, y = one.cosine[:, one.passing]
        edges = 1 / max(np.abs(x).max(), 1e-6) + 2 / max(np.ptp(y), 1e-6)
        half_um = np.geomspace(0.1, 1e4, 400)
        diffracted = SQUARE * one.wavelength_nm * 1e-3 * edges / (2 * np.pi**2 * half_um)
        outside = np.interp(half_um, off_um[order], beyond) + diffracted
        widths_um[place] = 2 * half_um[np.argmax(outside < 1 - ENERGY)]
    return widths_um
