"""The end of the field on the sensor: where the prescription ends it, or where no light passes."""

import numpy as np

from ..prescription.system import System
from ..rays.field_heights import image_radius_mm
from ..rays.fields import find_fields, trace_fields, undisturbed
from ..rays.rays import FullPupil
from ..rays.view import View
from ..runtime.errors import LensError

PUPIL = FullPupil(5, 12)
LEAST_RAYS = 2  # that pass, in addition to the chief ray
STEP = 0.95  # towards the axis, until light passes
MOST_STEPS = 60
INSIDE = 1 - 1e-9


def within_field(system: System, view: View, places_mm: np.ndarray, wavelengths_nm: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Places on the sensor, moved towards the axis of the lens into the field; and their distance from the axis before,
    relative to the end of the field: arrays (2, place) and (place,).

    The field ends at a circle about the axis, or closer where no light passes at one of the wavelengths.

    Raises
    ------
    LensError
        Light passes nowhere towards the axis.
    """
    axis_mm = view.axis_mm[:, None]
    within = np.hypot(*(places_mm - axis_mm)) / image_radius_mm(undisturbed(system))
    share = np.minimum(1.0, INSIDE / np.maximum(within, INSIDE))
    dark = np.arange(within.size)
    for _ in range(MOST_STEPS):
        inside_mm = axis_mm + share * (places_mm - axis_mm)
        dark = dark[~_lit(system, view, inside_mm[:, dark], wavelengths_nm)]
        if not dark.size:
            return inside_mm, np.where(share < np.minimum(1, INSIDE / np.maximum(within, INSIDE)), 1 / share, within)
        share[dark] *= STEP
    raise LensError(system.prescription.name, "field", "dark", "no light passes the apertures on the way from the axis "
                    f"to ({places_mm[0, dark[0]]:.4g}, {places_mm[1, dark[0]]:.4g}) mm on the sensor")


def _lit(system, view, places_mm, wavelengths_nm):
    """Whether light passes to places at all wavelengths."""
    points = find_fields(system, view, places_mm, wavelengths_nm)
    rays = trace_fields(system, view, points, PUPIL)
    passing = ~rays.lost & np.all(system.limits(rays.square_height_mm2) <= 1, axis=0)
    return np.all((passing[..., 1:, :].sum(axis=(-2, -1)) >= LEAST_RAYS) & ~points.lost, axis=0)
