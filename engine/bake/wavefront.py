"""Wavefronts at the exit pupil: traced at some wavelengths, and interpolated between them over the wave number."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..prescription.system import System
from ..rays.pupil import PupilQuadrature, area_ratio, polynomial_weights
from ..rays.rays import HalfPupil, Pupil, TracedRays, trace_pupil

LONGEST_RADIUS = 1e3  # of the reference sphere, in focal lengths: if telecentric, or if rays cross in front of it
FOLDING = 0.3  # area relative to the pupil's centre below which rays are about to cross
LEAST_AREA = 1e-6  # relative to the pupil's centre, near a caustic


@dataclass(frozen=True, eq=False)
class Wavefronts:
    """Wavefronts of object points at their image points: arrays (..., wavelength, height, radius, azimuth).

    In a lens without rotational symmetry, places on the sensor take the heights' part.

    Attributes
    ----------
    pupil : Pupil
    wavelengths_nm : array (wavelength,)
    chief_height_mm : array (wavelength, height)
        y of the chief rays on the image plane.
    path_mm : array
        Optical path difference to the sphere around the chief ray's image point.
    cosine : array (2, ...)
        Direction cosines (x, y) from the image point to the wavefront on that sphere.
    ray : array (2, ...)
        Direction cosines of the rays at the image; they differ from `cosine` by the aberrations.
    source : array (2, ...)
        Coordinates in the incident beam, over whose area the light is evenly distributed, as in `TracedRays`.
    density : array
        Logarithm of the light per area of `cosine`, which is the corresponding area of the incident beam.
    limits : array (limit, ...)
        `System.limits` that block some of the rays.
    spot_mm : array (2, ...)
        Ray positions on the image plane, relative to the chief ray.
    """

    pupil: Pupil
    wavelengths_nm: np.ndarray
    chief_height_mm: np.ndarray
    path_mm: np.ndarray
    cosine: np.ndarray
    ray: np.ndarray
    source: np.ndarray
    density: np.ndarray
    limits: np.ndarray
    spot_mm: np.ndarray

    def at(self, wavelengths_nm: Sequence[float] | np.ndarray) -> "Wavefronts":
        """Wavefronts at other wavelengths, interpolated by a polynomial over the wave number."""
        wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
        weights = polynomial_weights(1e3 / self.wavelengths_nm, 1e3 / wavelengths_nm)

        def between(values, axis=0):
            return np.moveaxis(np.tensordot(weights, values, (1, axis)), 0, axis)

        return Wavefronts(self.pupil, wavelengths_nm, between(self.chief_height_mm), between(self.path_mm),
                          between(self.cosine, 1), between(self.ray, 1), between(self.source, 1),
                          between(self.density), between(self.limits, 1), between(self.spot_mm, 1))

    def one(self, wavelength: int, height: int) -> "Wavefront":
        """Wavefront of one wavelength and height."""
        place = (..., wavelength, height, slice(None), slice(None))
        return Wavefront(self.pupil, float(self.wavelengths_nm[wavelength]), self.path_mm[place], self.cosine[place],
                         self.source[place], self.density[place], self.limits[place], self.spot_mm[place])

    def areas(self, radii: int, azimuths: int) -> tuple[np.ndarray, np.ndarray]:
        """Areas of each passing bundle: arrays (wavelength, height).

        The first is in direction cosines at the image. Its ratio to the axis is the relative illumination of a
        Lambertian object, because radiance is conserved along rays. The second is in the source's coordinates.
        """
        quadrature, sides = _quadrature(self.pupil, radii, azimuths), 2 if self.pupil.mirrored else 1
        area = np.empty((2, *self.chief_height_mm.shape))
        for at in np.ndindex(self.chief_height_mm.shape):
            passing = quadrature.cells * quadrature.coverage(self.limits[:, *at])
            for number, coordinates in enumerate((self.ray, self.source)):
                area[number, *at] = sides * np.sum(np.abs(quadrature.splines.jacobian(*coordinates[:, *at])) * passing)
        return area[0], area[1]


@lru_cache(maxsize=4)
def _quadrature(pupil, radii, azimuths):
    return PupilQuadrature(pupil, radii, azimuths)


@dataclass(frozen=True, eq=False)
class Wavefront:
    """A wavefront of `Wavefronts` at one wavelength and height: arrays (..., radius, azimuth)."""

    pupil: Pupil
    wavelength_nm: float
    path_mm: np.ndarray
    cosine: np.ndarray
    source: np.ndarray
    density: np.ndarray
    limits: np.ndarray
    spot_mm: np.ndarray

    @property
    def passing(self) -> np.ndarray:
        """Whether rays pass all apertures: bool array."""
        return np.all(self.limits <= 1, axis=0)


def trace_wavefronts(system: System, heights_mm: Sequence[float] | np.ndarray,
                     wavelengths_nm: Sequence[float] | np.ndarray, pupil: HalfPupil) -> Wavefronts:
    """Trace the wavefronts of field heights (paraxial image heights) at wavelengths.

    Raises
    ------
    LensError
        A chief ray is lost.
    """
    return wavefronts_of(system, trace_pupil(system, heights_mm, wavelengths_nm, pupil))


def wavefronts_of(system: System, rays: TracedRays) -> Wavefronts:
    """The wavefronts of traced rays."""
    pupil, limits = rays.pupil, _limits(system, rays)
    pupil_mm = abs(system.exit_pupil_distance_mm)
    longest_mm = LONGEST_RADIUS * system.efl_mm
    path_mm, cosine = _on_reference_sphere(rays, min(pupil_mm, longest_mm))
    areas = area_ratio(pupil, cosine)
    nearly_folded = (areas <= FOLDING * areas[..., :1, :1]) & np.all(limits <= 1, axis=0)
    folded = np.any(nearly_folded, axis=(0, 2, 3))[:, None, None]
    if folded.any():
        far = _on_reference_sphere(rays, longest_mm)
        path_mm, cosine = np.where(folded, far[0], path_mm), np.where(folded, far[1], cosine)
    source = continued(rays.source, rays.lost)
    return Wavefronts(pupil, rays.wavelengths_nm, rays.chief_height_mm, path_mm, cosine,
                      continued(rays.direction[:2], rays.lost), source, light_density(pupil, source, cosine),
                      limits, continued(rays.position_mm - rays.position_mm[..., :1, :1], rays.lost))


def _on_reference_sphere(rays, distance_mm):
    """Wavefronts on the sphere around the chief ray's image point that crosses the axis `distance_mm` in front of the
    image plane.

    Returns
    -------
    path_mm : array (...)
        Optical path difference to the chief ray.
    cosine : array (2, ...)
        Direction cosines from the image point.
    """
    chief = rays.position_mm[..., :1, :1]
    radius_mm = np.hypot(distance_mm, np.hypot(*chief))
    about = rays.position_mm - chief
    along = np.sum(about * rays.direction[:2], axis=0)
    back_mm = along + np.sqrt(along**2 - np.sum(about**2, axis=0) + radius_mm**2)
    path_mm = rays.path_mm - back_mm
    return (continued(path_mm[..., :1, :1] - path_mm, rays.lost),
            continued((about - back_mm * rays.direction[:2]) / radius_mm, rays.lost))


def light_density(pupil: Pupil, source: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Logarithm of the ratio of areas in the source's coordinates to areas in the cosines."""
    source, image = (np.abs(area_ratio(pupil, each)) for each in (source, cosine))
    source, image = (np.maximum(areas, LEAST_AREA * areas[..., :1, :1]) for areas in (source, image))
    return np.log(source / image)


def _limits(system, rays):
    """`Wavefronts.limits` for surfaces whose apertures block some of the rays, and for lost rays."""
    limits = [continued(limit, rays.lost) for limit in system.limits(rays.square_height_mm2)
              if np.any(limit[~rays.lost] > 1)]
    return np.array([*limits, *([2.0 * rays.lost] if rays.lost.any() else [])]).reshape(-1, *rays.lost.shape)


def continued(values: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Values with those of lost rays extrapolated linearly outwards from the others."""
    if not lost.any():
        return values
    values = values.copy()
    for row in range(1, lost.shape[-2]):
        beyond = 2 * values[..., row - 1, :] - values[..., max(row - 2, 0), :]
        values[..., row, :] = np.where(lost[..., row, :], beyond, values[..., row, :])
    return values
