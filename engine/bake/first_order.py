"""Rays of a lens that is known by tables alone: of its pupil, its focal length and its distortion, to first order.

They all meet in the plane in focus, so that circles of confusion are round, evenly lit and of the right size
everywhere; nothing cuts into the bundles, and no colour is focused nearer than another.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..field.distortion import FieldGeometry
from ..image.depth_range import entrance_pupil_diameter_mm, focus_nearness
from .ray_table import HEIGHTS, PUPIL, WAVELENGTHS_NM, RayTable, spline_coefficients

if TYPE_CHECKING:
    from ..lens.lens import Lens


def first_order_rays(lens: "Lens") -> RayTable:
    """The table of rays of a lens without aberrations, but for its distortion, that has this one's first-order data."""
    wavelengths_nm = _within(lens.wavelengths_nm[0], lens.wavelengths_nm[-1])
    fields = [FieldGeometry(lens.at_wavelength(nm), lens.name) for nm in wavelengths_nm]
    last_mm = max(field.last_real_mm for field in fields)
    heights_mm = last_mm * np.sin(np.pi / 2 * np.linspace(0, 1, HEIGHTS))
    paraxial_mm = np.array([field.paraxial_height_mm(heights_mm) for field in fields])
    illumination = np.array([field.relative_illumination(each) for field, each in
                             zip(fields, paraxial_mm, strict=True)])
    chief = (paraxial_mm / lens.capture_focal_length_mm)[..., None, None]  # tangents, away from the axis
    # axes from here on: wavelength, height, radius, azimuth
    pupil_mm, nearness = entrance_pupil_diameter_mm(lens) / 2 * np.stack([PUPIL.x, PUPIL.y]), focus_nearness(lens)
    tangent_x, tangent_y = nearness * pupil_mm[0] + 0 * chief, nearness * pupil_mm[1] + chief
    cosine = 1 / np.sqrt(1 + tangent_x**2 + tangent_y**2)
    along_mm = (pupil_mm[0] * tangent_x + pupil_mm[1] * tangent_y) * cosine  # from the foot to the plane
    foot_x, foot_y = (at - along_mm * tangent * cosine for at, tangent in
                      zip(pupil_mm, (tangent_x, tangent_y), strict=True))
    values = np.stack([foot_x, foot_y, *(tangent * cosine / (1 + cosine) for tangent in (tangent_x, tangent_y)),
                       np.ones_like(cosine), _path_mm(foot_x**2 + foot_y**2 + (along_mm * cosine)**2, chief, nearness),
                       illumination[..., None, None] / (4 * lens.f_number_effective**2) + 0 * cosine])
    return RayTable(lens.name, wavelengths_nm, float(last_mm), lens.entrance_pupil_mm,
                    spline_coefficients(values).astype(np.float32))


def _path_mm(foot_square_mm2, chief, nearness):
    """From the foot to the image: all ways from the point in focus, and so from the plane across, are as long."""
    if not nearness:
        return 0 * foot_square_mm2
    away_mm = np.sqrt(1 + chief**2) / nearness
    return away_mm - np.sqrt(away_mm**2 - foot_square_mm2)


def _within(first_nm, last_nm):
    """Wavelengths between these that stand as `WAVELENGTHS_NM` do between the first and the last of them."""
    if first_nm == last_nm:
        return np.array([float(first_nm)])
    share = (1 / WAVELENGTHS_NM[0] - 1 / np.array(WAVELENGTHS_NM)) / (1 / WAVELENGTHS_NM[0] - 1 / WAVELENGTHS_NM[-1])
    return 1 / (1 / first_nm - share * (1 / first_nm - 1 / last_nm))
