"""A lens's aperture on the axis, by its traced pupil, compared with the f-number and the stop in its file."""

from functools import lru_cache

import numpy as np

from ..prescription.prescription import Prescription
from ..prescription.system import System, system_of
from ..runtime.errors import LensError
from .rays import FullPupil, trace_pupil

FAN = FullPupil(65, 1)  # along +y
TOLERANCE = 0.03  # relative, for an f-number and a stop diameter: a twelfth of a stop of light
NO_LIMIT = 1e9  # extent of a lost ray, in semi-apertures


def axial_f_number(system: System) -> float:
    """Focal length over the diameter of the beam from infinity that reaches the axial image point, by traced rays.

    The stop and the rims of all surfaces limit the beam. So does spherical aberration of the pupil, which the paraxial
    f-number does not include.

    Parameters
    ----------
    system : System
        Focused at infinity.

    Raises
    ------
    LensError
        No light gets through.
    """
    rays = trace_pupil(system, [0.0], [system.prescription.reference_wavelength_nm], FAN)
    extents = np.sqrt(system.rims(rays.square_height_mm2[:, 0, 0, :, 0]))
    extents[system.prescription.stop_index] = FAN.radii
    extent = np.where(rays.lost[0, 0, :, 0], NO_LIMIT, extents.max(axis=0))
    height_mm = np.interp(1.0, np.maximum.accumulate(extent), np.abs(rays.source[1, 0, 0, :, 0]))
    return system.efl_mm / (2 * float(height_mm))


@lru_cache(maxsize=128)
def aperture_notes(far: Prescription) -> tuple[str, ...]:
    """Differences of a wide-open lens from the f-number and the stop in its file: a sentence each.

    Parameters
    ----------
    far : Prescription
        With its widest stop in mm, focused at infinity.
    """
    system, notes = system_of(far), []
    stop_mm, file_mm = system.stop_semi_aperture_mm, far.surfaces[far.stop_index].semi_aperture_mm
    if np.isfinite(file_mm) and abs(stop_mm / file_mm - 1) > TOLERANCE:
        notes.append(f"f/{system.f_number:.3g} needs a stop of {2 * stop_mm:.4g} mm, which passes "
                     f"{(stop_mm / file_mm) ** 2:.0%} of the light of the file's {2 * file_mm:.4g} mm stop.")
    try:
        traced = axial_f_number(system)
    except LensError:  # no light gets through the lens: baking reports this
        return tuple(notes)
    if abs(traced / system.f_number - 1) > TOLERANCE:
        light = (system.f_number / traced) ** 2
        notes.append(f"On the axis, traced rays give f/{traced:.3g}: {light:.0%} of the light of "
                     f"f/{system.f_number:.3g}.")
    return tuple(notes)
