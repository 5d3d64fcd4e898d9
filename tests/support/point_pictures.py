"""Light of a distant point, out of focus, on the pixels of a camera: rays one by one, without the engine's tracer."""

import numpy as np

import physical_rays
from flat_pictures import SHAPE_PX
from lensfield.engine.prescription.system import system_of
from lensfield.engine.rays.rings import Rings, ring_ends, turned

GREEN_NM = 550.0
ACROSS = 1000  # rays


def point_rays(prescription, f_number, angle_deg):
    """Where the rays of an evenly lit beam from infinity, at this angle to the axis, arrive on the sensor behind the
    lens at its closest focus: array (2, ray), with y > 0."""
    system = system_of(turned(prescription, Rings(ring_ends(prescription)[1].focus_mm, f_number)).prescription)
    lens, angle = system.prescription, np.radians(angle_deg)
    half_mm = 1.2 * max(surface.semi_aperture_mm for surface in lens.surfaces if np.isfinite(surface.semi_aperture_mm))
    places_mm = (np.arange(ACROSS) + 0.5) / ACROSS * 2 * half_mm - half_mm
    x_mm, v_mm = (each.ravel() for each in np.meshgrid(places_mm, places_mm))
    direction = np.repeat([[0.0], [np.sin(angle)], [np.cos(angle)]], x_mm.size, axis=1)
    # a cross section of the beam, in front of the lens and through its entrance pupil's centre
    start_mm = np.stack([x_mm, v_mm * np.cos(angle), -v_mm * np.sin(angle)]) - 3 * half_mm * direction
    start_mm[2] += system.entrance_pupil_mm
    with np.errstate(invalid="ignore"):
        place, _, _, is_open, stop_mm = physical_rays.trace(lens, np.abs(system.indices_at([GREEN_NM]).ravel()),
                                                            start_mm, direction)
        is_open &= np.hypot(*stop_mm) <= system.stop_semi_aperture_mm
    return place[:2, is_open & np.isfinite(place[0])]


def point_light(places_mm, turn_deg, sensor_mm, shape_px=SHAPE_PX, background=0.0):
    """Light on the pixels, 1 at the brightest, of rays turned from +y, up, to the right; with a background."""
    turn = np.radians(turn_deg)
    right_mm, up_mm = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ places_mm
    ends_mm = [(-side_mm / 2, side_mm / 2) for side_mm in sensor_mm[::-1]]
    light, _, _ = np.histogram2d(-up_mm, right_mm, shape_px, ends_mm)
    return light / light.max() + background


def true_widths_mm(places_mm):
    """Height of the centroid, and root mean square widths along y and x."""
    return places_mm[1].mean(), places_mm[1].std(), places_mm[0].std()
