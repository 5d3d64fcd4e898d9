"""Rays of a lens without a prescription, to first order: from its pupil, its focal length and its distortion.

All rays meet in the plane of focus. Circles of confusion are therefore round, uniform and of the right size everywhere,
without vignetting and without longitudinal chromatic aberration.
"""


import numpy as np

from ...lens.entrance_pupil import entrance_pupil_diameter_mm, focus_nearness
from ...lens.radial_lens import RadialLens
from ...rays.ray_table import HEIGHTS, PUPIL, WAVELENGTHS_NM, RayTable, spline_coefficients
from .distortion import FieldGeometry


def first_order_rays(lens: RadialLens, reach: float = 1.0) -> RayTable:
    """The table of rays of a lens with this lens's first-order data and distortion, and no other aberrations.

    Parameters
    ----------
    lens : RadialLens
    reach : float
        `RayTable.reach`.
    """
    wavelengths_nm = _within(lens.wavelengths_nm[0], lens.wavelengths_nm[-1])
    fields = [FieldGeometry(lens.at_wavelength(nm), lens.name) for nm in wavelengths_nm]
    last_mm = max(field.last_real_mm for field in fields)
    heights_mm = last_mm * np.sin(np.pi / 2 * np.linspace(0, 1, HEIGHTS))
    paraxial_mm = np.array([field.paraxial_height_mm(heights_mm) for field in fields])
    illumination = np.array([field.relative_illumination(each) for field, each in
                             zip(fields, paraxial_mm, strict=True)])
    chief = (paraxial_mm / lens.capture_focal_length_mm)[..., None, None]  # tangents, away from the axis
    # axes from here on: wavelength, height, radius, azimuth
    pupil_mm = reach * entrance_pupil_diameter_mm(lens) / 2 * np.stack([PUPIL.x, PUPIL.y])
    nearness = focus_nearness(lens)
    tangent_x, tangent_y = nearness * pupil_mm[0] + 0 * chief, nearness * pupil_mm[1] + chief
    cosine = 1 / np.sqrt(1 + tangent_x**2 + tangent_y**2)
    along_mm = (pupil_mm[0] * tangent_x + pupil_mm[1] * tangent_y) * cosine  # from the foot to the plane
    foot_x, foot_y = (at - along_mm * tangent * cosine for at, tangent in
                      zip(pupil_mm, (tangent_x, tangent_y), strict=True))
    values = np.stack([foot_x, foot_y, *(tangent * cosine / (1 + cosine) for tangent in (tangent_x, tangent_y)),
                       np.ones_like(cosine), _path_mm(foot_x**2 + foot_y**2 + (along_mm * cosine)**2, chief, nearness),
                       illumination[..., None, None] / (4 * lens.f_number_effective**2) + 0 * cosine])
    return RayTable(lens.name, wavelengths_nm, float(last_mm), lens.entrance_pupil_mm,
                    spline_coefficients(values).astype(np.float32), reach)


def _path_mm(foot_square_mm2, chief, nearness):
    """Path from the foot to the image: all paths from the point in focus, through the plane of the feet, are equal."""
    if not nearness:
        return 0 * foot_square_mm2
    away_mm = np.sqrt(1 + chief**2) / nearness
    return away_mm - np.sqrt(away_mm**2 - foot_square_mm2)


def _within(first_nm, last_nm):
    """Wavelengths from the first to the last, distributed like `WAVELENGTHS_NM` in reciprocal wavelength."""
    if first_nm == last_nm:
        return np.array([float(first_nm)])
    share = (1 / WAVELENGTHS_NM[0] - 1 / np.array(WAVELENGTHS_NM)) / (1 / WAVELENGTHS_NM[0] - 1 / WAVELENGTHS_NM[-1])
    return 1 / (1 / first_nm - share * (1 / first_nm - 1 / last_nm))
