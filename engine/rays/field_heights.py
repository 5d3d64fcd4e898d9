"""Field heights at equal distances in the picture, and the last one."""

import numpy as np
import scipy

from ..prescription.system import System
from ..runtime.errors import LensError
from .rays import HalfPupil, trace_pupil

CHIEF_RAYS = 49


def even_heights_mm(system: System, number: int) -> np.ndarray:
    """Paraxial heights whose chief rays meet the image plane at equal distances, at the reference wavelength.

    Raises
    ------
    LensError
        The chief ray's height does not increase with the field: the picture folds back on itself.
    """
    last_field, = system.fields_of([system.last_height_mm])
    paraxial_mm = system.heights_of(np.linspace(0, 1, CHIEF_RAYS) * last_field)  # at equal angles, for wide lenses
    rays = trace_pupil(system, paraxial_mm, [system.prescription.reference_wavelength_nm], HalfPupil(1, 1))
    real_mm = rays.chief_height_mm[0]
    if np.any(np.diff(real_mm) <= 0):
        raise LensError(system.prescription.name, "field",
                        f"folding back at an image height of {real_mm[np.argmin(np.diff(real_mm) > 0)]:.4g} mm",
                        "reduce the field")
    heights_mm = scipy.interpolate.PchipInterpolator(real_mm, paraxial_mm)(np.linspace(0, real_mm[-1], number))
    return np.concatenate([[0.0], heights_mm[1:-1], [system.last_height_mm]])


def image_radius_mm(system: System) -> float:
    """Distance from the axis at which the last chief ray meets the image plane, at the reference wavelength."""
    nm = system.prescription.reference_wavelength_nm
    return float(abs(trace_pupil(system, [system.last_height_mm], [nm], HalfPupil(1, 1)).chief_height_mm[0, 0]))
