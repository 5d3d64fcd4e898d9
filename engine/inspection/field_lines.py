"""How light passes a prescription along lines of its field, from the axis outwards.

A rotationally symmetric lens has one, over image heights. Other lenses have one for each side, edge and corner of the
picture, without those that are mirror images of others.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from ..prescription.mirrors import mirrored
from ..prescription.system import System
from ..rays.field_heights import even_heights_mm
from ..rays.fields import find_fields, trace_fields, view_of
from ..rays.rays import FullPupil, HalfPupil, Pupil, TracedRays, trace_pupil

CHIEF = FullPupil(1, 1)
RIM, FULL_RIM = HalfPupil(9, 9), FullPupil(9, 16)
SPOT = FullPupil(13, 32)


@dataclass(frozen=True, eq=False)
class FieldLine:
    """A line of the field.

    Attributes
    ----------
    kind : str
        What precedes the places in messages.
    places : list of str
        Places on the sensor.
    values : array (..., place)
    """

    kind: str
    places: list[str]
    values: np.ndarray


def chief_ray_lines(system: System, number: int) -> Iterator[FieldLine]:
    """Heights of chief rays on the surfaces, as `System.rims`, at `number` places of each line: (limit, place)."""
    for kind, places, rays in _traced_lines(system, number, CHIEF, CHIEF):
        yield FieldLine(kind, places, _reach(system, rays)[..., 0, 0])


def light_lines(system: System, number: int) -> Iterator[FieldLine]:
    """Share of the stop's area whose rays pass all apertures, at `number` places of each line. Around the chief ray,
    these have no gaps."""
    for kind, places, rays in _traced_lines(system, number, RIM, FULL_RIM):
        reach = np.where(rays.lost[0], np.inf, _reach(system, rays).max(axis=0))
        reach = np.maximum.accumulate(reach, axis=1)
        rims = np.square([[np.interp(1.0, along, rays.pupil.radii) for along in of_place.T] for of_place in reach])
        shares = (scipy.integrate.trapezoid(rims, rays.pupil.azimuths, axis=1) / np.pi if rays.pupil.mirrored else
                  rims.mean(axis=1))
        yield FieldLine(kind, places, shares)


def _reach(system, rays):
    """Heights of rays on the surfaces, in semi-apertures, or in the half-widths of rectangles: array (limit, place,
    radius, azimuth)."""
    return np.sqrt(system.rims(rays.square_height_mm2[:, 0]))


def _traced_lines(system: System, number: int, pupil: Pupil,
                  full: Pupil) -> Iterator[tuple[str, list[str], TracedRays]]:
    """Kind and names of places, and rays across the stop, of each line at the reference wavelength."""
    nm = [system.prescription.reference_wavelength_nm]
    if system.prescription.radial:
        rays = trace_pupil(system, even_heights_mm(system, number), nm, pupil)
        yield "an image height of ", [f"{mm:.4g} mm" for mm in rays.chief_height_mm[0]], rays
        return
    view = view_of(system)
    for end_mm in _ends_mm(system):
        x_mm, y_mm = np.multiply.outer(end_mm, np.linspace(0, 1, number))
        points = find_fields(system, view, -np.stack([x_mm, y_mm]), nm)  # the image is upside down
        yield ("", [f"x = {x:.4g}, y = {y:.4g} mm" for x, y in zip(x_mm, y_mm, strict=True)],
               trace_fields(system, view, points, full))


def _ends_mm(system):
    """x and y of the ends of lines: the middles of the sensor's edges and its corners, within the field."""
    up, right = ((1,) if half else (1, -1) for half in mirrored(system.prescription))
    width_mm, height_mm = system.prescription.sensor_mm or (2 * system.last_height_mm,) * 2
    sides = [(x, 0) for x in right] + [(0, y) for y in up] + [(x, y) for x in right for y in up]
    for side in sides:
        end_mm = np.array(side) * (width_mm, height_mm) / 2
        yield end_mm * min(1, system.last_height_mm / np.hypot(*end_mm))


def spot_contrast(system: System, lines_per_mm: float) -> float:
    """Contrast of fine lines in the middle of the picture without diffraction, at the reference wavelength: along x or
    y, whichever is lower."""
    view, nm = view_of(system), [system.prescription.reference_wavelength_nm]
    rays = trace_fields(system, view, find_fields(system, view, np.zeros((2, 1)), nm), SPOT)
    passing = ~rays.lost[0, 0] & np.all(system.limits(rays.square_height_mm2[:, 0, 0]) <= 1, axis=0)
    waves = np.exp(2j * np.pi * lines_per_mm * np.where(passing, rays.position_mm[:, 0, 0], 0))
    light = SPOT.radii[:, None] * passing  # of a ring is proportional to its radius
    return float(np.abs(np.average(waves, axis=(1, 2), weights=np.broadcast_to(light, waves.shape))).min())
