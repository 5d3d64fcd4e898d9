"""Which field heights are baked: close together where PSFs change fastest, as where beams begin to be cut off."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..errors import LensError
from .diffraction import point_spread
from .quality import Quality
from .rays import HalfPupil, trace_pupil
from .system import System
from .wavefront import trace_wavefronts
from .window import needed_width_um

CHIEF_RAYS = 49
SURVEY = 33  # heights, evenly over the picture, at which the change of PSFs is seen
SAMPLES = 49  # of their PSFs
LEAST = 0.25  # of the mean change, that no part of the picture goes without heights


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


def telling_heights_mm(system: System, number: int, quality: Quality) -> np.ndarray:
    """Paraxial heights between which PSFs change by much the same, so that what is interpolated is as good everywhere.

    Between two heights the error is a half of the second difference, which goes with the square of their distance: so
    heights lie as close as its root asks for.
    """
    survey_mm = even_heights_mm(system, SURVEY)
    wavefronts = trace_wavefronts(system, survey_mm, [system.prescription.reference_wavelength_nm], quality.pupil)
    pitch_um = needed_width_um(wavefronts, quality.sums) / SAMPLES
    psfs = np.array([point_spread(wavefronts.one(0, height), pitch_um, SAMPLES, quality.sums)
                     for height in range(SURVEY)])
    psfs /= np.maximum(psfs.sum(axis=(1, 2), keepdims=True), np.finfo(float).tiny)
    change = np.abs(psfs[:-2] - 2 * psfs[1:-1] + psfs[2:]).sum(axis=(1, 2))
    change = np.concatenate([change[:1], change, change[-1:]])
    closeness = np.sqrt(change + LEAST * change.mean())
    reached = np.concatenate([[0.0], np.cumsum((closeness[1:] + closeness[:-1]) / 2)])
    places = np.interp(np.linspace(0, reached[-1], number), reached, np.arange(SURVEY))
    heights_mm = PchipInterpolator(np.arange(SURVEY), survey_mm)(places)
    return np.concatenate([[0.0], heights_mm[1:-1], [system.last_height_mm]])
