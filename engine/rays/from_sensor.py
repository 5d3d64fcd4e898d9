"""A lens in the order in which rays from the sensor meet it, at one wavelength, for a camera that traces these rays.

A ray starts anywhere in its pixel and aims at a rectangle on the plane of the rear vertex, which encloses the part of
the exit pupil that is visible from the pixel. The irradiance of the sensor, the integral of L cos(t) dw, is an integral
of L cos^4(t) / z^2 dA over that plane, at the distance z.
"""

from dataclasses import dataclass

import numpy as np

from ..prescription.prescription import Prescription
from ..prescription.system import System
from .focus import build_system
from .trace import trace_from_image

BINS = 32  # of sensor heights, with a rectangle each
SEARCH = 96  # rays along a side of the searched rectangle
MOST_DOUBLINGS = 12  # the search starts at twice the paraxial beam, and doubles until it encloses all passing rays
ZOOMS = 2  # afterwards
LEAST_PASSING = 8  # rays: too few for an extent below this


@dataclass(frozen=True, eq=False)
class FromSensor:
    """Surfaces in the order in which rays from the sensor meet them; z points from each vertex towards the scene.

    Attributes
    ----------
    gap_mm : array (surface,)
        Distance to this vertex from the previous one, or from the sensor.
    curvature_per_mm, conic : arrays (surface,)
    terms : array (surface, term)
        Coefficients of the powers `first_power`, `first_power + power_step`, ... of the distance from the axis, in mm.
    first_power, power_step : int
    semi_aperture_mm : array (surface,)
        Including the stop's; inf if unlimited.
    index_ratio : array (surface,)
        Index in front of a surface over the index behind it, along these rays.
    absorption_per_mm : array (surface,)
        Absorption of the medium in front of a surface, along these rays.
    entrance_pupil_mm : float
        From the last of these surfaces to the entrance pupil, away from the scene.
    bin_mm : float
        Bin size of sensor heights from the axis; there is a rectangle per bin.
    to_pupil : float
        The line from a sensor point through the centre of the exit pupil crosses the rectangles' plane at this multiple
        of the sensor point's height.
    low_mm, high_mm, half_mm : arrays (bin,)
        Ends of the rectangles along the line away from the axis, relative to that crossing, and half of their extent
        across; 0 if no light gets through.
    """

    gap_mm: np.ndarray
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
    """Prepare a lens for rays from its sensor.

    Parameters
    ----------
    prescription : Prescription
        At its ring settings.
    wavelength_nm : float
    farthest_mm : float
        From the axis to the last sensor point.

    Raises
    ------
    LensError
        A prescription that cannot be traced or is not rotationally symmetric, or a wavelength at which the index of a
        glass is unknown.
    """
    prescription.require_radial("a lens traced in Cycles")
    system = build_system(prescription)
    surfaces, indices = system.prescription.surfaces[::-1], system.indices_at([wavelength_nm])[:, 0]
    extinction = np.array([glass.extinction_at([wavelength_nm])[0] for glass in system.glasses])[::-1]
    terms, first_power, power_step = _terms(surfaces)
    to_pupil = 1 / (1 - surfaces[0].thickness_mm / system.exit_pupil_mm)
    low, high, half = _rectangles(system, indices, np.linspace(0, farthest_mm, BINS + 1), to_pupil)
    return FromSensor(
        gap_mm=np.array([surface.thickness_mm for surface in surfaces]),
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
    """Coefficients for the reversed z axis, their first power and its step."""
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
    """Rectangles for sensor points at these heights: array (3, height) of both ends along the line away from the axis,
    and half of the extent across."""
    beam_mm = abs(system.marginal_heights_mm[-1])
    rectangles = []
    for height_mm in heights_mm:
        for doublings in range(MOST_DOUBLINGS):
            half_mm = beam_mm * 2.0 ** (doublings + 1)
            extent, complete = _passing_extent(system, indices, height_mm, to_pupil, -half_mm, half_mm, half_mm)
            if complete:
                break
        for _ in range(ZOOMS):
            extent, _ = _passing_extent(system, indices, height_mm, to_pupil, *extent)
        rectangles.append(extent)
    return np.array(rectangles).T


def _passing_extent(system, indices, height_mm, to_pupil, low_mm, high_mm, half_mm):
    """Bounds of the passing rays among a rectangle's rays, plus a step of the search; and whether they stay clear of
    the rectangle's edge."""
    across, step_x = np.linspace(low_mm, high_mm, SEARCH, retstep=True)
    up, step_y = np.linspace(0, half_mm, SEARCH // 2, retstep=True)
    x, y = np.meshgrid(across, up)
    through = _passes(system, indices, height_mm, to_pupil * height_mm + x, y)
    if through.sum() < LEAST_PASSING:
        return (0.0, 0.0, 0.0), False
    edge = through[-1].any() or through[:, [0, -1]].any()
    return (x[through].min() - step_x, x[through].max() + step_x, y[through].max() + step_y), not edge


def _passes(system, indices, height_mm, x_mm, y_mm):
    """Which rays pass from a sensor point at a height through points of the plane of the rear vertex."""
    towards = np.stack([height_mm - x_mm, 0 - y_mm, np.full_like(x_mm, system.prescription.surfaces[-1].thickness_mm)])
    start = np.stack([np.full_like(x_mm, height_mm), np.zeros_like(x_mm), np.zeros_like(x_mm)])
    with np.errstate(invalid="ignore"):
        _, direction, _, square_mm2 = trace_from_image(system.prescription, indices[:, None, None], start,
                                                       towards / np.sqrt(np.sum(towards**2, axis=0)))
        through = np.isfinite(direction).all(axis=0)
        for square, semi_mm in zip(square_mm2, _all_semi_apertures_mm(system), strict=True):
            through &= square <= semi_mm**2
    return through
