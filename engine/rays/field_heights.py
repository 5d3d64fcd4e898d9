"""Field heights at equal distances in the picture, and where their chief rays meet it."""

import numpy as np
import scipy

from ..prescription.system import System
from ..runtime.errors import LensError
from .rays import FullPupil, trace_pupil

CHIEF_RAYS = 49


def even_heights_mm(system: System, number: int, last_mm: float | None = None) -> np.ndarray:
    """Paraxial heights whose chief rays meet the image plane at equal distances, at the reference wavelength, up to the
    last: the end of the prescription's field unless it is given.

    Raises
    ------
    LensError
        The chief ray's height does not increase with the field: the picture folds back on itself.
    """
    last_mm = system.last_height_mm if last_mm is None else last_mm
    fields, real_mm = _chief_rays(system, last_mm)
    paraxial_mm = system.heights_of(fields)
    if np.any(np.diff(real_mm) <= 0):
        raise LensError(system.prescription.name, "field",
                        f"folding back at an image height of {real_mm[np.argmin(np.diff(real_mm) > 0)]:.4g} mm",
                        "reduce the field")
    heights_mm = scipy.interpolate.PchipInterpolator(real_mm, paraxial_mm)(np.linspace(0, real_mm[-1], number))
    return np.concatenate([[0.0], heights_mm[1:-1], [last_mm]])


def chief_ray_curve(system: System, last_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the axis at which chief rays meet the image plane, in mm, and their angles to the axis at the
    entrance pupil, in radians, at the reference wavelength: arrays (CHIEF_RAYS,) from the axis to a paraxial height."""
    fields, real_mm = _chief_rays(system, last_mm)
    pupil_mm = system.prescription.object_distance_mm + system.entrance_pupil_mm
    return real_mm, abs(fields if system.object_at_infinity else np.arctan(fields / pupil_mm))


def _chief_rays(system, last_mm):
    """Fields at equal angles, for wide lenses, and the distances in mm at which their chief rays meet the image."""
    last_field, = system.fields_of([last_mm])
    fields = np.linspace(0, 1, CHIEF_RAYS) * last_field
    nm = system.prescription.reference_wavelength_nm
    return fields, trace_pupil(system, system.heights_of(fields), [nm], FullPupil(1, 1)).chief_height_mm[0]


def image_radius_mm(system: System) -> float:
    """Distance from the axis at which the last chief ray meets the image plane, at the reference wavelength."""
    nm = system.prescription.reference_wavelength_nm
    return float(abs(trace_pupil(system, [system.last_height_mm], [nm], FullPupil(1, 1)).chief_height_mm[0, 0]))
