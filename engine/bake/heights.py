"""Which field heights are baked: so many, and so close together, that PSFs between them can be interpolated."""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..errors import LensError
from ..threads import thread_pool
from .diffraction import Sums, point_spread
from .rays import HalfPupil, trace_pupil
from .system import System
from .wavefront import trace_wavefronts
from .window import needed_width_um

CHIEF_RAYS = 49
LEAST = 9  # heights, evenly over the picture
AT_ONCE = 3  # of the intervals that are too wide, one in so many is halved before they are looked at again
SAMPLES = 49  # of the PSFs that tell where more are needed, at the reference wavelength
PUPIL, SUMS = HalfPupil(21, 25), Sums(degree=14, oversampling=1.0, repeat=1.1, fringes=7.5)


def even_heights_mm(system: System, number: int) -> np.ndarray:
    """Paraxial heights whose chief rays meet the image plane at even distances, at the reference wavelength.

    Raises
    ------
    LensError
        The picture folds back on itself.
    """
    last_field, = system.fields_of([system.last_height_mm])
    paraxial_mm = system.heights_of(np.linspace(0, 1, CHIEF_RAYS) * last_field)  # at even angles, for wide lenses
    rays = trace_pupil(system, paraxial_mm, [system.prescription.reference_wavelength_nm], HalfPupil(1, 1))
    real_mm = rays.chief_height_mm[0]
    if np.any(np.diff(real_mm) <= 0):
        raise LensError(system.prescription.name, "field",
                        f"folding back at an image height of {real_mm[np.argmin(np.diff(real_mm) > 0)]:.4g} mm",
                        "end the field earlier")
    heights_mm = PchipInterpolator(real_mm, paraxial_mm)(np.linspace(0, real_mm[-1], number))
    return np.concatenate([[0.0], heights_mm[1:-1], [system.last_height_mm]])


def telling_heights_mm(system: System, wavelengths_nm: Sequence[float] | np.ndarray, tolerance: float, most: int,
                       least: int = LEAST) -> tuple[np.ndarray, float]:
    """Paraxial heights between which PSFs can be interpolated: intervals are halved until that is true enough.

    Parameters
    ----------
    system : System
    wavelengths_nm : sequence of float
        At which PSFs are looked at.
    tolerance : float
        Share of the light that may lie in the wrong place half way between two heights, in the picture's mean.
    most, least : int
        Heights.

    Returns
    -------
    heights_mm : array
    error : float
        That share, as it is.
    """
    heights_mm = even_heights_mm(system, min(least, most))
    places_mm = np.sort(np.concatenate([heights_mm, (heights_mm[1:] + heights_mm[:-1]) / 2]))
    wavefronts = trace_wavefronts(system, places_mm, wavelengths_nm, PUPIL)
    pitch_um = needed_width_um(wavefronts, SUMS) / SAMPLES
    psfs = _psfs(wavefronts, pitch_um)
    while True:  # heights and places half way between them take turns
        errors = np.abs((psfs[:-2:2] + psfs[2::2]) / 2 - psfs[1::2]).sum(axis=(2, 3)).mean(axis=1)
        error = np.average(errors, weights=np.diff(places_mm[::2]))
        room = most - errors.size - 1
        if error <= tolerance or not room:
            return places_mm[::2], error
        worst = np.argsort(-errors)[:min(room, -(-np.count_nonzero(errors > tolerance) // AT_ONCE))]
        edges = 2 * np.concatenate([worst, worst])
        halves = np.concatenate([np.zeros_like(worst), np.ones_like(worst)])
        new_mm = (places_mm[edges + halves] + places_mm[edges + halves + 1]) / 2
        order = np.argsort(np.concatenate([places_mm, new_mm]))
        places_mm = np.concatenate([places_mm, new_mm])[order]
        psfs = np.concatenate([psfs, _psfs(trace_wavefronts(system, new_mm, wavelengths_nm, PUPIL), pitch_um)])[order]


def _psfs(wavefronts, pitch_um):
    """Of unit sum: array (height, wavelength, v, u)."""
    shape = wavefronts.chief_height_mm.T.shape

    def psf(place):
        return point_spread(wavefronts.one(place[1], place[0]), pitch_um, SAMPLES, SUMS)

    with thread_pool() as pool:
        psfs = np.array(list(pool.map(psf, np.ndindex(shape)))).reshape(*shape, SAMPLES, SAMPLES)
    return psfs / np.maximum(psfs.sum(axis=(2, 3), keepdims=True), np.finfo(float).tiny)
