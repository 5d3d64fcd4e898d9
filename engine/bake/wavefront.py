"""Wavefronts at the exit pupil: traced at some wavelengths, and at those between them by their wave numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .pupil import PupilQuadrature, area_ratio
from .rays import HalfPupil, trace_pupil
from .system import System

LONGEST_RADIUS = 1e3  # of the reference sphere in focal lengths, for telecentric lenses, and where rays cross before it
FOLDING = 0.3  # of the area in the middle: rays come so close on their way to crossing
LEAST_AREA = 1e-6  # of that in the middle, beside a caustic


@dataclass(frozen=True, eq=False)
class Wavefronts:
    """What reaches image points from points of the object: arrays (..., wavelength, height, radius, azimuth).

    Attributes
    ----------
    pupil : HalfPupil
    wavelengths_nm : array (wavelength,)
    chief_height_mm : array (wavelength, height)
        Where chief rays meet the image plane.
    path_mm : array
        Optical path difference against the sphere about the chief ray's image point.
    cosine : array (2, ...)
        Direction cosines (x, y) from the image point to the wavefront on that sphere.
    ray : array (2, ...)
        Direction cosines of the rays at the image, which differ from those by the aberrations.
    source : array (2, ...)
        Coordinates in the object's beam over whose area the source's light is spread evenly, as of `TracedRays`.
    density : array
        Logarithm of the light per area of `cosine`: of the area of the object's beam that this is the image of.
    limits : array (limit, ...)
        Squared heights at the surfaces that cut some rays off, over their squared semi-apertures.
    spot_mm : array (2, ...)
        Where rays land, from the chief ray.
    """

    pupil: HalfPupil
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
        """At other wavelengths, by the polynomial over the wave number through all of these."""
        wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
        weights = polynomial_weights(1e3 / self.wavelengths_nm, 1e3 / wavelengths_nm)

        def between(values, axis=0):
            return np.moveaxis(np.tensordot(weights, values, (1, axis)), 0, axis)

        return Wavefronts(self.pupil, wavelengths_nm, between(self.chief_height_mm), between(self.path_mm),
                          between(self.cosine, 1), between(self.ray, 1), between(self.source, 1),
                          between(self.density), between(self.limits, 1), between(self.spot_mm, 1))

    def one(self, wavelength: int, height: int) -> "Wavefront":
        """That of one wavelength and height."""
        place = (..., wavelength, height, slice(None), slice(None))
        return Wavefront(self.pupil, float(self.wavelengths_nm[wavelength]), self.path_mm[place], self.cosine[place],
                         self.density[place], self.limits[place])

    def areas(self, radii: int, azimuths: int) -> tuple[np.ndarray, np.ndarray]:
        """Area of each bundle that passes: arrays (wavelength, height).

        In direction cosines at the image: its ratio to the axis is the relative illumination of a Lambertian object,
        for radiance is conserved along rays. And over the source's coordinates.
        """
        quadrature = PupilQuadrature(self.pupil, radii, azimuths)
        area = np.empty((2, *self.chief_height_mm.shape))
        for at in np.ndindex(self.chief_height_mm.shape):
            passing = quadrature.cells * quadrature.coverage(self.limits[:, *at])
            for number, coordinates in enumerate((self.ray, self.source)):
                area[number, *at] = 2 * np.sum(np.abs(quadrature.splines.jacobian(*coordinates[:, *at])) * passing)
        return area[0], area[1]


@dataclass(frozen=True, eq=False)
class Wavefront:
    """The wavefront of one wavelength and height, as `Wavefronts` has them: arrays (..., radius, azimuth)."""

    pupil: HalfPupil
    wavelength_nm: float
    path_mm: np.ndarray
    cosine: np.ndarray
    density: np.ndarray
    limits: np.ndarray

    @property
    def passing(self) -> np.ndarray:
        """Which rays pass all apertures: bool array."""
        return np.all(self.limits <= 1, axis=0)


def trace_wavefronts(system: System, heights_mm: Sequence[float] | np.ndarray,
                     wavelengths_nm: Sequence[float] | np.ndarray, pupil: HalfPupil) -> Wavefronts:
    """Wavefronts of field heights (paraxial image heights) at wavelengths.

    Raises
    ------
    LensError
        A chief ray does not get through.
    """
    rays = trace_pupil(system, heights_mm, wavelengths_nm, pupil)
    limits = _limits(system, rays)
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
    """Where rays cross the sphere about the chief ray's image point whose middle is so far before the image plane.

    Returns
    -------
    path_mm : array (...)
        Optical path difference against the chief ray.
    cosine : array (2, ...)
        Direction cosines from the image point.
    """
    chief = rays.position_mm[..., :1, :1]
    radius_mm = np.hypot(distance_mm, chief[1])
    about = rays.position_mm - chief
    along = np.sum(about * rays.direction[:2], axis=0)
    back_mm = along + np.sqrt(along**2 - np.sum(about**2, axis=0) + radius_mm**2)
    path_mm = rays.path_mm - back_mm
    return (continued(path_mm[..., :1, :1] - path_mm, rays.lost),
            continued((about - back_mm * rays.direction[:2]) / radius_mm, rays.lost))


def light_density(pupil: HalfPupil, source: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Logarithm of how many times larger areas are over the source's coordinates than over the cosines."""
    source, image = (np.abs(area_ratio(pupil, each)) for each in (source, cosine))
    source, image = (np.maximum(areas, LEAST_AREA * areas[..., :1, :1]) for areas in (source, image))
    return np.log(source / image)


def _limits(system, rays):
    """Of surfaces where apertures stop some of the rays, and of rays that are lost on their way."""
    heights = [continued(square, rays.lost) / semi_mm**2
               for square, semi_mm in zip(rays.square_height_mm2, system.semi_apertures_mm, strict=True)
               if np.any(square[~rays.lost] > semi_mm**2)]
    return np.array([*heights, *([2.0 * rays.lost] if rays.lost.any() else [])]).reshape(-1, *rays.lost.shape)


def continued(values: np.ndarray, lost: np.ndarray) -> np.ndarray:
    """Values of lost rays, continued outwards in a straight line from those that were not."""
    if not lost.any():
        return values
    values = values.copy()
    for row in range(1, lost.shape[-2]):
        beyond = 2 * values[..., row - 1, :] - values[..., max(row - 2, 0), :]
        values[..., row, :] = np.where(lost[..., row, :], beyond, values[..., row, :])
    return values


def polynomial_weights(nodes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Weights of a function's values at the nodes in the polynomial through them, by Lagrange: array (place, node)."""
    weights = np.ones((places.size, nodes.size))
    for node in range(nodes.size):
        others = np.delete(nodes, node)
        weights[:, node] = np.prod((places[:, None] - others) / (nodes[node] - others), axis=1)
    return weights
