"""Mirror lenses for tests: 98 mm f/7, with a Mangin mirror that is the stop, a convex mirror, and a corrector in the
hole; and a telescope."""

from dataclasses import replace

import numpy as np

from lensfield.engine.prescription.prescription import Prescription, Surface

GLASS = "1.6/40"
SURFACES = (
    Surface(46.0, 2.2, GLASS, 8.3), Surface(124.0, 1.2, semi_aperture_mm=8.3),
    Surface(thickness_mm=16.2, semi_obstruction_mm=3.6),
    Surface(-36.5, 1.8, GLASS),
    Surface(-57.8, -1.8, GLASS, stop=True, mirror=True, reflectance=0.8, semi_obstruction_mm=3.2),
    Surface(-36.5, -15.4, semi_aperture_mm=7.0),
    Surface(-58.0, 15.4, semi_aperture_mm=3.6, mirror=True, reflectance=0.7, conic=-22.0),
    Surface(-14.0, 1.0, GLASS, 3.2), Surface(np.inf, 11.54, semi_aperture_mm=3.2))
MIRROR_LENS = Prescription("mirror lens", SURFACES, ("f_number", 7.0), ("image_height_mm", 4.3),
                           sensor_mm=(7.2, 4.8), focus="best")


def two_mirrors(stop=0):
    """A Cassegrain telescope of 300 mm, a paraboloid and the hyperboloid of its foci; its stop is on either mirror."""
    first_mm, gap_mm, power = 100.0, 70.0, 3.0  # the first focal length, the distance, the second magnification
    second_mm = 2 * power * (first_mm - gap_mm) / (power - 1)
    mirrors = (Surface(-2 * first_mm, -gap_mm, conic=-1.0, mirror=True),
               Surface(-second_mm, power * (first_mm - gap_mm), conic=-((power + 1) / (power - 1)) ** 2, mirror=True))
    surfaces = tuple(replace(mirror, stop=number == stop) for number, mirror in enumerate(mirrors))
    return Prescription("two mirrors", surfaces, ("entrance_pupil_diameter_mm", 40.0), ("angle_deg", 1.0))
