"""Rays of a lens without a prescription, to first order: from its pupil, its focal length and its distortion.

All rays meet in the plane of focus. Circles of confusion are therefore round, uniform and of the right size everywhere,
without vignetting and without longitudinal chromatic aberration.
"""

import numpy as np

from ...lens.entrance_pupil import entrance_pupil_diameter_mm, focus_nearness
from ...lens.radial_lens import RadialLens
from ...rays.ray_table import HEIGHTS, PUPIL, RayTable, spline_coefficients
from ..in_focus_rays import in_focus_rays, pupil_margin, table_wavelengths
from .distortion import FieldGeometry


def first_order_rays(lens: RadialLens, reach: float = 1.0) -> RayTable:
    """The table of rays of a lens with this lens's first-order data and distortion, and no other aberrations.

    Parameters
    ----------
    lens : RadialLens
    reach : float
        `RayTable.reach`.
    """
    wavelengths_nm = table_wavelengths(lens.wavelengths_nm[0], lens.wavelengths_nm[-1])
    fields = [FieldGeometry(lens.at_wavelength(nm), lens.name) for nm in wavelengths_nm]
    last_mm = max(field.last_real_mm for field in fields)
    heights_mm = last_mm * np.sin(np.pi / 2 * np.linspace(0, 1, HEIGHTS))
    paraxial_mm = np.array([field.paraxial_height_mm(heights_mm) for field in fields])
    illumination = np.array([field.relative_illumination(each) for field, each in
                             zip(fields, paraxial_mm, strict=True)])
    chief = (paraxial_mm / lens.capture_focal_length_mm)[..., None, None]  # tangents, away from the axis
    # axes from here on: wavelength, height, radius, azimuth
    stop = reach * np.stack([PUPIL.x, PUPIL.y])
    light = illumination[..., None, None] / (4 * lens.rim_f_number**2)
    values = in_focus_rays(entrance_pupil_diameter_mm(lens) / 2 * stop, np.stack([0 * chief, chief]),
                           focus_nearness(lens), light, pupil_margin(stop, lens.central_obstruction))
    return RayTable(lens.name, wavelengths_nm, float(last_mm), lens.entrance_pupil_mm,
                    spline_coefficients(values).astype(np.float32), reach, lens.dark_beyond)
