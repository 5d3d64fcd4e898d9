"""Rays from object points across the stop: position, direction, optical path, and height at each surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..prescription.system import System
from ..runtime.errors import LensError
from .aiming import aim
from .trace import trace_both_ways


class Pupil:
    """Rays across the stop.

    Attributes
    ----------
    radii, azimuths : arrays
        From 0 to 1, and from +y through +x.
    x, y : arrays (radius, azimuth)
    """

    mirrored = False
    """Whether the azimuths cover one half of the stop, and the other half is its mirror image."""

    def __init__(self, radii: np.ndarray, azimuths: np.ndarray):
        self.radii, self.azimuths = radii, azimuths
        radius, azimuth = np.meshgrid(radii, azimuths, indexing="ij")
        self.x, self.y = radius * np.sin(azimuth), radius * np.cos(azimuth)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of arrays of rays: (radius, azimuth)."""
        return self.x.shape


class HalfPupil(Pupil):
    """Radii 0 to 1 of the stop, and azimuths from +y through +x to -y; the other half is the mirror image.

    A centred lens with its field on the y axis is symmetric about the meridional plane.

    Radii are evenly spaced or, with `close_at_rim`, the sines of evenly spaced angles, which are densest at the rim.
    """

    mirrored = True

    def __init__(self, radii: int, azimuths: int, close_at_rim: bool = False):
        even = np.linspace(0, 1, radii)
        super().__init__(np.sin(np.pi / 2 * even) if close_at_rim else even, np.linspace(0, np.pi, azimuths))


class FullPupil(Pupil):
    """Radii 0 to 1 of the stop, and azimuths all around, without the first one again at the end."""

    def __init__(self, radii: int, azimuths: int):
        super().__init__(np.linspace(0, 1, radii), np.linspace(0, 2 * np.pi, azimuths, endpoint=False))


@dataclass(frozen=True, eq=False)
class TracedRays:
    """Rays by wavelength and field height: arrays (..., wavelength, height, radius, azimuth).

    Rays of radius 0 are chief rays.

    Attributes
    ----------
    pupil : Pupil
    wavelengths_nm : array (wavelength,)
    position_mm : array (2, ...)
        x and y at the image plane; image points have y > 0.
    direction : array (3, ...)
        Direction cosines at the image plane.
    path_mm : array
        Optical path from the object point, or from a plane wavefront.
    source : array (2, ...)
        Coordinates in the incident beam, over whose area the light is evenly distributed: position in mm in the cross
        section of a beam from infinity, or direction cosines from a Lambertian point on the object plane.
    square_height_mm2 : array (surface, ...)
        Squared distance from the axis at each surface.
    lost : bool array
        Rays that missed a surface or were totally reflected.
    """

    pupil: Pupil
    wavelengths_nm: np.ndarray
    position_mm: np.ndarray
    direction: np.ndarray
    path_mm: np.ndarray
    source: np.ndarray
    square_height_mm2: np.ndarray
    lost: np.ndarray

    @property
    def chief_height_mm(self) -> np.ndarray:
        """Heights of the chief rays on the image plane: array (wavelength, height)."""
        return self.position_mm[1, :, :, 0, 0]


def trace_pupil(system: System, heights_mm: Sequence[float] | np.ndarray, wavelengths_nm: Sequence[float] | np.ndarray,
                pupil: Pupil) -> TracedRays:
    """Trace rays from field heights across the stop, at several wavelengths.

    Parameters
    ----------
    system : System
    heights_mm : sequence of float
        Paraxial image heights, along y.
    wavelengths_nm : sequence of float
    pupil : Pupil

    Raises
    ------
    LensError
        A chief ray is lost, or one half of the stop cannot represent both.
    """
    rays = trace_any(system, heights_mm, wavelengths_nm, pupil)
    _check_chief_rays(system, heights_mm, rays)
    return rays


def trace_any(system: System, heights_mm: Sequence[float] | np.ndarray, wavelengths_nm: Sequence[float] | np.ndarray,
              pupil: Pupil) -> TracedRays:
    """As `trace_pupil`, including heights whose chief rays are lost."""
    if pupil.mirrored:
        system.prescription.require_radial("a field of heights")
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    indices, fields = system.indices_at(wavelengths_nm), system.fields_of(heights_mm)
    x_mm, y_mm = (system.stop_semi_aperture_mm * place.ravel() for place in (pupil.x, pupil.y))
    slope_x, slope_y, aimed = aim(system, indices, fields, x_mm, y_mm)
    with np.errstate(invalid="ignore"):
        traced = trace_both_ways(system.prescription, indices[:, :, None, None], x_mm, y_mm, slope_x, slope_y)
        to_entry_mm, source = _object_space(system, fields[:, None], traced.entry, traced.before)
    path_mm = to_entry_mm + traced.path_mm
    arrays = {"position_mm": traced.position[:2], "direction": traced.direction, "path_mm": path_mm, "source": source,
              "square_height_mm2": traced.square_mm2, "lost": ~(aimed & np.isfinite(path_mm))}
    return TracedRays(pupil, wavelengths_nm, **{name: values.reshape(*values.shape[:-1], *pupil.shape)
                                                for name, values in arrays.items()})


def _object_space(system, fields, entry, before):
    """Optical path from the object point, or from the plane wave through the origin, to the first surface; and
    `TracedRays.source`."""
    if system.object_at_infinity:
        section_y = entry[1] * np.cos(fields) - entry[2] * np.sin(fields)
        return np.sum(entry * before, axis=0), np.stack([entry[0], section_y])
    return (system.prescription.object_distance_mm + entry[2]) / before[2], before[:2]


def _check_chief_rays(system, heights_mm, rays):
    lost = np.argwhere(rays.lost[:, :, 0, 0])
    if lost.size:
        wavelength, height = lost[0]
        raise LensError(system.prescription.name, "field height", f"{heights_mm[height]:.4g} mm",
                        f"no ray gets through the middle of the stop at {rays.wavelengths_nm[wavelength]:g} nm: "
                        "reduce the field")
