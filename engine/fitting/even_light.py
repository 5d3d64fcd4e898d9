"""The light of an even field on the sensor, for any sizes of a lens's rims.

Rays are traced once for each focus, from points of the sensor through the widest stop. An f-number takes those within
its own stop, and rims block some of them, so a fit traces rays only once. The light is the projected solid angle of the
rays that arrive at a point of the sensor: radiance is conserved along them. Pictures, which move the light of object
points by their PSFs, have the same light (`tests/engine/fitting/test_even_light.py` compares both).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..prescription.prescription import Prescription
from ..prescription.system import System, system_of
from ..rays.aiming import aim_at_image, farthest_aim_mm
from ..rays.lost_rays import continued
from ..rays.pupil import PupilSplines, covered, gauss_legendre
from ..rays.rays import HalfPupil
from ..rays.rings import Rings, turned
from ..rays.trace import trace_both_ways
from ..runtime.errors import LensError

GREEN_NM = 550.0  # photographs are compared in their green channel
PUPIL = HalfPupil(33, 33)
RADII, AZIMUTHS = 20, 24  # samples of half of a stop: 0.002 of the light
CORNER = 1.01  # of the way to the corner of the frame: light there is blurred into it
INSIDE = 0.98  # of the farthest height that a chief ray reaches
ORDER = 2  # of the differences that continue lost rays


def check_even_light(prescription: Prescription) -> None:
    """Raise a LensError for a lens that `EvenField` cannot trace: not rotationally symmetric, or with mirrors."""
    prescription.require_radial("the light of an even field")
    if prescription.mirrors:
        raise LensError(prescription.name, f"surface {prescription.mirrors[0] + 1}", "a mirror",
                        "the light of an even field needs a lens without mirrors")


def picture_corner_mm(prescription: Prescription, focus_mm: float) -> float:
    """Distance from the axis at which the picture ends: just beyond the corner of the frame, or where the farthest
    chief ray arrives if that is closer; at the last paraxial height without a frame."""
    system = system_of(turned(prescription, Rings(focus_mm=focus_mm)).prescription)
    sides_mm = prescription.sensor_mm
    frame_mm = CORNER * np.hypot(*sides_mm) / 2 if sides_mm else system.last_height_mm
    return float(min(frame_mm, INSIDE * farthest_aim_mm(system, system.indices_at([GREEN_NM]))))


@dataclass(frozen=True, eq=False)
class StopLight:
    """Samples of a stop, for points of the sensor: arrays (..., height, radius, azimuth).

    Attributes
    ----------
    weight : array
        Projected solid angle at the sensor; 0 for rays that do not get through the lens.
    square_mm2 : array (surface, ...)
        Squared distance from the axis at each surface.
    square_sine : array
        Squared sine of the angle to the normal of the sensor.
    """

    weight: np.ndarray
    square_mm2: np.ndarray
    square_sine: np.ndarray

    def at(self, surfaces: Sequence[int], semi_apertures_mm: np.ndarray, pixel_loss: float = 0.0) -> np.ndarray:
        """The light at the heights relative to the first of them, with rims at these surfaces alone: array (height,).

        Parameters
        ----------
        surfaces : sequence of int
            Indices.
        semi_apertures_mm : array (surface,)
        pixel_loss : float
            Pixels collect exp(-pixel_loss sin^2) of the light at an angle.
        """
        limits = self.square_mm2[list(surfaces)] / np.reshape(np.square(semi_apertures_mm), (-1, 1, 1, 1))
        light = self.weight * covered(limits) * np.exp(-pixel_loss * self.square_sine)
        total = light.sum(axis=(1, 2))
        return total / total[0]


class EvenField:
    """Rays from points of the sensor through a lens at one focus.

    Parameters
    ----------
    prescription : Prescription
    focus_mm : float
        From the entrance pupil; inf for infinity.
    heights_mm : array (height,)
        Distances of the points from the axis: the first is 0.

    Attributes
    ----------
    f_number, focus_mm : float
        The widest f-number, and the focus within the range of the lens.
    system : System
    square_mm2 : array (surface, height, radius, azimuth)
        Squared distance from the axis at each surface, of rays across the widest stop.
    lost : bool array (height, radius, azimuth)

    Raises
    ------
    LensError
        As `check_even_light`; or no ray reaches a height.
    """

    def __init__(self, prescription: Prescription, focus_mm: float, heights_mm: np.ndarray) -> None:
        check_even_light(prescription)
        lens = turned(prescription, Rings(focus_mm=focus_mm))
        self.f_number, self.focus_mm, self.heights_mm = lens.f_number, lens.focus_mm, heights_mm
        self.system: System = system_of(lens.prescription)
        self._direction, self.square_mm2, self.lost = self._traced()

    def _traced(self):
        """Direction cosines along x and y, squared heights, and lost rays."""
        system, indices = self.system, self.system.indices_at([GREEN_NM])
        x_mm, y_mm = (system.stop_semi_aperture_mm * place.ravel() for place in (PUPIL.x, PUPIL.y))
        slope_x, slope_y, aimed = aim_at_image(system, indices, self.heights_mm, x_mm, y_mm)
        with np.errstate(invalid="ignore"):
            rays = trace_both_ways(system.prescription, indices[:, :, None, None], x_mm, y_mm, slope_x, slope_y)
        shape = len(self.heights_mm), *PUPIL.shape
        lost = ~(aimed & np.isfinite(rays.path_mm)).reshape(shape)
        if lost[:, 0, 0].any():
            height_mm = self.heights_mm[np.argmax(lost[:, 0, 0])]
            raise LensError(system.prescription.name, "height on the sensor", f"{height_mm:.4g} mm",
                            "no ray gets there through the middle of the stop: reduce the field")
        values = np.concatenate([rays.direction[:2], rays.square_mm2]).reshape(-1, *shape)
        values = continued(values, ~lost, order=ORDER)
        return values[:2], values[2:2 + len(system.glasses)], lost

    @property
    def most_mm(self) -> np.ndarray:
        """Distance from the axis of the outermost ray at each surface and height: array (surface, height)."""
        return np.sqrt(np.where(self.lost, 0.0, self.square_mm2).max(axis=(2, 3)))

    def through(self, f_number: float) -> StopLight:
        """The light through the stop of an f-number, or through the widest stop."""
        share = min(1.0, self.f_number / f_number)
        nodes, weights = gauss_legendre(RADII)
        radii, azimuths = (nodes + 1) / 2 * share, (np.arange(AZIMUTHS) + 0.5) * np.pi / AZIMUTHS
        splines = PupilSplines(PUPIL, radii, azimuths)
        along_x, along_y = splines.values(self._direction[0], odd=True), splines.values(self._direction[1])
        nearest = [np.abs(rays[:, None] - places).argmin(axis=0)
                   for rays, places in ((PUPIL.radii, radii), (PUPIL.azimuths, azimuths))]
        arrives = ~self.lost[:, nearest[0][:, None], nearest[1]]
        weight = np.abs(splines.jacobian(*self._direction)) * weights[:, None] * arrives
        return StopLight(weight, splines.values(self.square_mm2), along_x**2 + along_y**2)
