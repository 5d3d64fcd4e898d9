"""The cat's eyes of a lens's rims, compared with discs of a distant point in photographs.

The lens is set to its closest distance, and the point is at infinity. Its disc is where the rays arrive that the stop
and the rims pass. Widths are as in `points.py`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..prescription.prescription import Prescription
from ..prescription.system import system_of
from ..rays.lost_rays import continued
from ..rays.pupil import PupilQuadrature
from ..rays.rays import HalfPupil, trace_any
from ..rays.rings import Rings, ring_ends, turned
from ..runtime.errors import LensError
from .even_light import GREEN_NM
from .points import PointDisc, Widths

PUPIL, RADII, AZIMUTHS = HalfPupil(33, 33), 40, 48  # rays, and samples of half of the stop: 0.002 of the ratio
FIELDS, BEYOND = 33, 1.5  # object points, up to this many measured heights
OTHER_STOP = 0.1  # relative difference of f-numbers that the lens has and the photograph states


def compare_points(discs: Sequence[PointDisc], lenses: dict[str, Prescription]) -> list[str]:
    """Lines that compare measured discs with what lenses make of the same point.

    At the f-number of a central disc, others are also compared by their areas relative to it.

    Parameters
    ----------
    discs : sequence of PointDisc
    lenses : dict of Prescription
        By the words for them, such as "before" and "after".

    Raises
    ------
    LensError
        As `disc_widths`.
    """
    central = {disc.f_number: disc for disc in discs if disc.is_central}
    return [line for disc in discs for line in _lines(disc, central.get(disc.f_number, disc), lenses)]


def _lines(disc, middle, lenses):
    """Lines about a disc: its shape, and its area relative to another disc."""
    predicted, in_middle = ([disc_widths(lens, each.f_number, each.height_mm) for lens in lenses.values()]
                            for each in (disc, middle))
    ratios = [each.ratio for each in predicted]
    yield (f"{disc.path.name}: f/{disc.f_number:g}, {disc.height_mm:.1f} mm from the axis: radial by tangential width "
           f"{_compared(disc.widths.ratio, disc.ratio_sigma, ratios, lenses)}")
    if disc is not middle:
        areas = [each.area_mm2 / other.area_mm2 for each, other in zip(predicted, in_middle, strict=True)]
        area = disc.widths.area_mm2 / middle.widths.area_mm2
        sigma = area * np.hypot(disc.area_sigma, middle.area_sigma)
        yield f"{disc.path.name}: area relative to {middle.path.name} {_compared(area, sigma, areas, lenses)}"


def _compared(measured, sigma, predicted, words):
    differences = ", ".join(f"{word} {each:.3f} ({each - measured:+z.3f})" for word, each in
                            zip(words, predicted, strict=True))
    return f"{measured:.3f} ± {sigma:.3f}; {differences}"


def disc_widths(prescription: Prescription, f_number: float, height_mm: float) -> Widths:
    """Widths of the disc of a point at infinity, with the lens set to its closest distance.

    Parameters
    ----------
    prescription : Prescription
    f_number : float
    height_mm : float
        Of the disc's centroid on the sensor.

    Raises
    ------
    LensError
        The lens lacks this f-number, is not rotationally symmetric, or passes no light to this height.
    """
    prescription.require_radial("the disc of a point")
    lens = turned(prescription, Rings(ring_ends(prescription)[1].focus_mm, f_number))
    if abs(np.log(lens.f_number / f_number)) > OTHER_STOP:
        raise LensError(prescription.name, "f-number", f"{f_number:g} in the photographs",
                        f"the lens has f/{lens.f_number:.3g}: give photographs of this lens")
    system = system_of(replace(lens.prescription, object_distance_mm=np.inf))
    heights_mm, *squares_mm2 = _moments(system, np.linspace(0, BEYOND * height_mm, FIELDS))
    if height_mm > heights_mm[-1]:
        raise LensError(prescription.name, "height on the sensor", f"{height_mm:.4g} mm",
                        f"light of a distant point arrives up to {heights_mm[-1]:.4g} mm at its closest focus: check "
                        "the camera's sensor")
    return Widths(*(float(np.sqrt(np.interp(height_mm, heights_mm, each))) for each in squares_mm2))


def _moments(system, fields_mm):
    """Heights of discs' centroids and their mean square widths, radial and tangential: array (3, disc)."""
    rays = trace_any(system, fields_mm, [GREEN_NM], PUPIL)
    lost, quadrature = rays.lost[0], _quadrature()
    splines = quadrature.splines
    position_mm, source, limits = (
        continued(each, ~rays.lost)[:, 0] for each in
        (rays.position_mm, rays.source, system.limits(rays.square_height_mm2)))
    x_mm, y_mm = splines.values(position_mm[0], odd=True), splines.values(position_mm[1])
    passing = np.array([quadrature.coverage(np.array([*limits[:, field], 2.0 * lost[field]]))
                        for field in range(len(fields_mm))])
    light = quadrature.cells * passing * np.abs(splines.jacobian(*source))
    lit = (light.sum(axis=(1, 2)) > 0) & ~lost[:, 0, 0]
    light, x_mm, y_mm = light[lit], x_mm[lit], y_mm[lit]
    light /= light.sum(axis=(1, 2), keepdims=True)
    height_mm = np.sum(light * y_mm, axis=(1, 2), keepdims=True)
    return np.stack([height_mm[:, 0, 0], *(np.sum(light * each**2, axis=(1, 2)) for each in (y_mm - height_mm, x_mm))])


@lru_cache(maxsize=1)
def _quadrature():
    return PupilQuadrature(PUPIL, RADII, AZIMUTHS)
