"""Where the light on the sensor of a rotationally symmetric lens ends: at the corner of its frame, or closer."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..prescription.system import System
from .field_heights import image_radius_mm
from .rays import HalfPupil, trace_any

PUPIL = HalfPupil(17, 21)
LEAST_RAYS = 3  # that pass, in addition to the chief ray
BEYOND = 1.003  # of the frame's corner: light there is blurred into the frame
REACHED = 0.999  # of the corner: the field of such a prescription ends at the frame
WIDEST_RAD = np.radians(89.5)  # heights are tangents of angles
PLACES, ZOOMS = 33, 3  # between the end of the design's field and the widest angle, and between two of these


class LightEnd(NamedTuple):
    """The end of the light.

    Attributes
    ----------
    height_mm : float
        Paraxial image height.
    dark : bool
        Whether no light arrives beyond; otherwise, the end is the one of the frame or of the prescription's field.
    """

    height_mm: float
    dark: bool


@lru_cache(maxsize=16)
def light_end(system: System, wavelengths_nm: tuple[float, ...]) -> LightEnd:
    """The end of the light at all of some wavelengths, at the corner of the frame at the farthest.

    Beyond the prescription's field, light is followed outwards while a chief ray and others get through and the picture
    does not fold back. A field that reaches the corner is left as it is, and so is one without a frame.

    Raises
    ------
    LensError
        The chief ray at the end of the prescription's field is lost.
    """
    last_mm, sides_mm = system.last_height_mm, system.prescription.sensor_mm
    if not sides_mm or image_radius_mm(system) >= REACHED * np.hypot(*sides_mm) / 2:
        return LightEnd(last_mm, False)
    target_mm, focal_mm = BEYOND * np.hypot(*sides_mm) / 2, system.capture_focal_length_mm
    inner_rad, outer_rad = np.arctan(last_mm / focal_mm), WIDEST_RAD
    for _ in range(ZOOMS):
        angles_rad = np.linspace(inner_rad, outer_rad, PLACES)
        real_mm, lit = _light(system, focal_mm * np.tan(angles_rad), wavelengths_nm)
        within = np.logical_and.accumulate(lit & (real_mm < target_mm))
        if within.all():
            return LightEnd(float(focal_mm * np.tan(outer_rad)), True)
        last = max(int(np.count_nonzero(within)) - 1, 0)
        inner_rad, outer_rad = angles_rad[last:last + 2]
    return LightEnd(float(focal_mm * np.tan(inner_rad)), not bool(lit[last + 1]))


def _light(system, heights_mm, wavelengths_nm):
    """Where chief rays of heights meet the image plane, at the reference wavelength; and whether, at all wavelengths,
    they land ever farther out and other rays get through with them: arrays (height,)."""
    rays = trace_any(system, heights_mm, (system.prescription.reference_wavelength_nm, *wavelengths_nm), PUPIL)
    within = rays.square_height_mm2 <= np.reshape(system.semi_apertures_mm, (-1, 1, 1, 1, 1))**2
    passing = ~rays.lost & np.all(within, axis=0)
    real_mm = np.where(rays.lost[:, :, 0, 0], 0.0, rays.chief_height_mm)
    rises = np.diff(real_mm, axis=1, prepend=0.0) > 0
    return real_mm[0], np.all(rises & (passing[:, :, 1:].sum(axis=(2, 3)) >= LEAST_RAYS), axis=0)
