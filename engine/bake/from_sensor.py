"""A lens as rays from the sensor meet it, at one wavelength: what a camera needs that traces rays through it.

A ray starts anywhere in its pixel and aims at a rectangle on the plane of the rear vertex, about all that can be seen
of the exit pupil from there. The irradiance of the sensor, integral of L cos(t) dw, is an integral over that plane, at
the distance z: cos^4(t) / z^2 dA.
"""

from dataclasses import dataclass

import numpy as np

from .focus import build_system
from .prescription import Prescription
from .system import System
from .trace import trace_from_image

BINS = 32  # of sensor heights, each with its own rectangle
SEARCH = 96  # rays along a side of a rectangle, to find what gets through
MOST_DOUBLED = 12  # the search begins with twice the paraxial beam, and doubles until it has all
ZOOMS = 2  # once all is found
LEAST_FOUND = 8  # rays: fewer tell nothing of an extent


@dataclass(frozen=True, eq=False)
class FromSensor:
    """Surfaces in the order in which rays from the sensor meet them; z grows from each vertex towards the scene.

    Attributes
    ----------
    apart_mm : array (surface,)
        From the vertex before, or from the sensor, to this one.
    curvature_per_mm, conic : arrays (surface,)
    terms : array (surface, term)
        Coefficients of the distance from the axis, from its power `first_power` on by `power_step`, in mm.
    first_power, power_step : int
    semi_aperture_mm : array (surface,)
        That of the stop included; inf where nothing stops light.
    index_ratio : array (surface,)
        Index before a surface over that behind it, as these rays go.
    absorption_per_mm : array (surface,)
        Of what lies before a surface.
    entrance_pupil_mm : float
        From the last of these surfaces to the entrance pupil, away from the scene.
    bin_mm : float
        Of sensor heights from the axis; rectangles hold for a bin each.
    to_pupil : float
        Of a sensor place's height: where the line through it and the middle of the exit pupil meets the plane.
    low_mm, high_mm, half_mm : arrays (bin,)
        The rectangles' ends along the line away from the axis, from there, and half their extent across; 0 where no
        light gets through.
    """

    apart_mm: np.ndarray
    curvature_per_mm: np.ndarray
    conic: np.ndarray
    terms: np.ndarray
    first_power: int
    power_step: int
    semi_aperture_mm: np.ndarray
    index_ratio: np.ndarray
    absorption_per_mm: np.ndarray
    entrance_pupil_mm: float
    bin_mm: float
    to_pupil: float
    low_mm: np.ndarray
    high_mm: np.ndarray
    half_mm: np.ndarray


def lens_from_sensor(prescription: Prescription, wavelength_nm: float, farthest_mm: float) -> FromSensor:
    """A lens for rays from places of its sensor.

    Parameters
    ----------
    prescription : Prescription
        As it is turned.
    wavelength_nm : float
    farthest_mm : float
        From the axis to the last sensor place.

    Raises
    ------
    LensError
        A prescription that cannot be traced, or a wavelength that one of its glasses is not known at.
    """
    system = build_system(prescription)
    surfaces, indices = system.prescription.surfaces[::-1], system.indices_at([wavelength_nm])[:, 0]
    extinction = np.array([glass.extinction_at([wavelength_nm])[0] for glass in system.glasses])[::-1]
    terms, first_power, power_step = _terms(surfaces)
    to_pupil = 1 / (1 - surfaces[0].thickness_mm / system.exit_pupil_mm)
    low, high, half = _rectangles(system, indices, np.linspace(0, farthest_mm, BINS + 1), to_pupil)
    return FromSensor(
        apart_mm=np.array([surface.thickness_mm for surface in surfaces]),
        curvature_per_mm=np.array([-1 / surface.radius_mm for surface in surfaces]),
        conic=np.array([surface.conic for surface in surfaces]),
        terms=terms, first_power=first_power, power_step=power_step,
        semi_aperture_mm=_all_semi_apertures_mm(system)[::-1],
        index_ratio=(indices[1:] / indices[:-1])[::-1],
        absorption_per_mm=4 * np.pi * extinction / (wavelength_nm * 1e-6),
        entrance_pupil_mm=system.entrance_pupil_mm, bin_mm=farthest_mm / BINS,
        to_pupil=to_pupil, low_mm=np.minimum(low[:-1], low[1:]), high_mm=np.maximum(high[:-1], high[1:]),
        half_mm=np.maximum(half[:-1], half[1:]))


def _terms(surfaces):
    """Coefficients for a z that grows the other way, their first power and its step."""
    if any(surface.odd_aspheric for surface in surfaces):
        count = max(max(2 * len(surface.aspheric), 2 * len(surface.odd_aspheric) - 1) for surface in surfaces)
        terms = np.zeros((len(surfaces), count))
        for row, surface in zip(terms, surfaces, strict=True):
            row[1:2 * len(surface.aspheric):2] = surface.aspheric
            row[:2 * len(surface.odd_aspheric):2] = surface.odd_aspheric
        return -terms, 1, 1
    count = max(len(surface.aspheric) for surface in surfaces)
    return -np.array([[*surface.aspheric, *(0.0,) * (count - len(surface.aspheric))] for surface in surfaces]), 2, 2


def _all_semi_apertures_mm(system):
    semi_mm = system.semi_apertures_mm
    semi_mm[system.prescription.stop_index] = system.stop_semi_aperture_mm
    return semi_mm


def _rectangles(system: System, indices, heights_mm, to_pupil):
    """Rectangles for sensor places of these heights: array (3, height) of both ends along the line away from the axis,
    and half the extent across."""
    beam_mm = abs(system.marginal_heights_mm[-1])
    rectangles = []
    for height_mm in heights_mm:
        for doubled in range(MOST_DOUBLED):
            half_mm = beam_mm * 2.0 ** (doubled + 1)
            found, all_of_it = _what_passes(system, indices, height_mm, to_pupil, -half_mm, half_mm, half_mm)
            if all_of_it:
                break
        for _ in range(ZOOMS):
            found, _ = _what_passes(system, indices, height_mm, to_pupil, *found)
        rectangles.append(found)
    return np.array(rectangles).T


def _what_passes(system, indices, height_mm, to_pupil, low_mm, high_mm, half_mm):
    """The rectangle, and a step of the search around it, that holds what passes of a rectangle's rays; and whether it
    does not reach that one's edge."""
    across, step_x = np.linspace(low_mm, high_mm, SEARCH, retstep=True)
    up, step_y = np.linspace(0, half_mm, SEARCH // 2, retstep=True)
    x, y = np.meshgrid(across, up)
    through = _passes(system, indices, height_mm, to_pupil * height_mm + x, y)
    if through.sum() < LEAST_FOUND:
        return (0.0, 0.0, 0.0), False
    edge = through[-1].any() or through[:, [0, -1]].any()
    return (x[through].min() - step_x, x[through].max() + step_x, y[through].max() + step_y), not edge


def _passes(system, indices, height_mm, x_mm, y_mm):
    """Which rays get through from a sensor place of a height by places on the plane of the rear vertex."""
    towards = np.stack([height_mm - x_mm, 0 - y_mm, np.full_like(x_mm, system.prescription.surfaces[-1].thickness_mm)])
    start = np.stack([np.full_like(x_mm, height_mm), np.zeros_like(x_mm), np.zeros_like(x_mm)])
    with np.errstate(invalid="ignore"):
        _, direction, _, square_mm2 = trace_from_image(system.prescription, indices[:, None, None], start,
                                                       towards / np.sqrt(np.sum(towards**2, axis=0)))
        through = np.isfinite(direction).all(axis=0)
        for square, semi_mm in zip(square_mm2, _all_semi_apertures_mm(system), strict=True):
            through &= square <= semi_mm**2
    return through
