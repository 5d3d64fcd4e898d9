"""Choice of baked field heights: as many and as dense as interpolation between their PSFs needs."""

from collections.abc import Sequence

import numpy as np

from ..prescription.system import System
from ..rays.field_heights import even_heights_mm
from ..rays.rays import HalfPupil
from .diffraction import Sums, point_spread
from .spots import spot_diagram
from .wavefront import Wavefronts, trace_wavefronts
from .window import needed_width_um

LEAST = 9  # heights, at equal distances in the picture
AT_ONCE = 3  # one in three of the intervals that are too wide is halved before errors are computed again
SAMPLES = 49  # of the PSFs that determine the heights
FRINGES = 6  # in a sample: with more, these are spot diagrams
PUPIL, SUMS = HalfPupil(17, 21), Sums(degree=12, oversampling=0.9, repeat=1.1, beyond=0.02)


def adaptive_heights_mm(system: System, wavelengths_nm: Sequence[float] | np.ndarray, tolerance: float, most: int,
                       least: int = LEAST, last_mm: float | None = None) -> tuple[np.ndarray, float]:
    """Paraxial heights between which PSFs can be interpolated, by halving intervals until the error is small enough.

    Parameters
    ----------
    system : System
    wavelengths_nm : sequence of float
        At which PSFs are compared.
    tolerance : float
        Share of misplaced light allowed halfway between two heights, averaged over the picture; inf for the `most`
        heights at equal distances in it.
    most, least : int
        Numbers of heights.
    last_mm : float or None
        The last height; None for the end of the prescription's field.

    Returns
    -------
    heights_mm : array
    error : float
        The actual share; 0 if any is allowed.
    """
    if np.isinf(tolerance):
        return even_heights_mm(system, most, last_mm), 0.0
    heights_mm = even_heights_mm(system, min(least, most), last_mm)
    places_mm = np.sort(np.concatenate([heights_mm, (heights_mm[1:] + heights_mm[:-1]) / 2]))
    wavefronts = trace_wavefronts(system, places_mm, wavelengths_nm, PUPIL)
    width_um = needed_width_um(wavefronts)
    real_mm, psfs = wavefronts.chief_height_mm[0], survey_psfs(system, wavefronts, width_um)
    while True:  # places alternate between heights and their midpoints
        errors = np.abs((psfs[:-2:2] + psfs[2::2]) / 2 - psfs[1::2]).sum(axis=(2, 3)).mean(axis=1)
        error = np.average(errors, weights=np.diff(real_mm[::2]))
        room = most - errors.size - 1
        if error <= tolerance or not room:
            return places_mm[::2], error
        worst = np.argsort(-errors)[:min(room, -(-np.count_nonzero(errors > tolerance) // AT_ONCE))]
        edges = 2 * np.concatenate([worst, worst])
        halves = np.concatenate([np.zeros_like(worst), np.ones_like(worst)])
        new_mm = (places_mm[edges + halves] + places_mm[edges + halves + 1]) / 2
        wavefronts = trace_wavefronts(system, new_mm, wavelengths_nm, PUPIL)
        order = np.argsort(np.concatenate([places_mm, new_mm]))
        places_mm = np.concatenate([places_mm, new_mm])[order]
        real_mm = np.concatenate([real_mm, wavefronts.chief_height_mm[0]])[order]
        psfs = np.concatenate([psfs, survey_psfs(system, wavefronts, width_um)])[order]


def survey_psfs(system: System, wavefronts: Wavefronts, width_um: float) -> np.ndarray:
    """PSFs of unit sum in a window of this width, for comparisons: array (height, wavelength, v, u)."""
    pitch_um = width_um / SAMPLES
    by_rays = pitch_um > FRINGES * system.f_number * 1e-3 * max(wavefronts.wavelengths_nm)
    shape = wavefronts.chief_height_mm.T.shape
    psfs = np.empty((*shape, SAMPLES, SAMPLES))
    for height, wavelength in np.ndindex(shape):
        one = wavefronts.one(wavelength, height)
        psfs[height, wavelength] = (spot_diagram(one, pitch_um, SAMPLES) if by_rays else
                                    point_spread(one, pitch_um, SAMPLES, SUMS))
    return psfs / np.maximum(psfs.sum(axis=(2, 3), keepdims=True), np.finfo(float).tiny)
