"""Rays over the stop: aimed by Optiland at a few wavelengths, traced at all of them in one call."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from optiland.rays import RealRays

from ..errors import LensError
from .system import System

AIMED_WAVELENGTHS = 6  # rays start where a polynomial through these has them: pupils shift little with the wavelength
ASTRAY = 1e-3  # of the stop: far outside of what gets through, a wide bundle has several ways to a place


class HalfPupil:
    """Radii 0 to 1 of the stop, and azimuths from +y over +x to -y; the other half is the mirror image.

    A centred lens with its field on the y axis is symmetric about the meridional plane.
    """

    def __init__(self, radii: int, azimuths: int):
        self.radii = np.linspace(0, 1, radii)
        self.azimuths = np.linspace(0, np.pi, azimuths)
        radius, azimuth = np.meshgrid(self.radii, self.azimuths, indexing="ij")
        self.x, self.y = radius * np.sin(azimuth), radius * np.cos(azimuth)

    @property
    def shape(self) -> tuple[int, int]:
        """Of arrays of rays: (radius, azimuth)."""
        return self.x.shape


@dataclass(frozen=True, eq=False)
class TracedRays:
    """Rays of one field height and wavelength, arrays (radius, azimuth); the first radius is the chief ray.

    Attributes
    ----------
    wavelength_nm : float
    position_mm, direction : arrays (3, radius, azimuth)
        At the image plane.
    path_mm : array
        Optical path from the object point, or from a plane wave front.
    source : array (2, radius, azimuth)
        Coordinates in the object's beam over whose area the source's light is spread evenly: where a beam from
        infinity crosses its own section in mm, or direction cosines from a Lambertian point of the object plane.
    square_height_mm2 : array (surface, radius, azimuth)
        Squared distance from the axis, at every surface.
    lost : bool array
        Rays that missed a surface, were totally reflected, or came astray: through the stop elsewhere than aimed.
    """

    wavelength_nm: float
    position_mm: np.ndarray
    direction: np.ndarray
    path_mm: np.ndarray
    source: np.ndarray
    square_height_mm2: np.ndarray
    lost: np.ndarray

    @property
    def chief_height_mm(self) -> float:
        """Where the chief ray meets the image plane, on the side where images have +y."""
        return float(self.position_mm[1, 0, 0])


def trace_pupil(system: System, height_mm: float, wavelengths_nm: Sequence[float] | np.ndarray,
                pupil: HalfPupil) -> list[TracedRays]:
    """Trace the rays of one field height over the stop, at several wavelengths.

    Parameters
    ----------
    system : System
    height_mm : float
        Paraxial image height.
    wavelengths_nm : sequence of float
    pupil : HalfPupil

    Returns
    -------
    list of TracedRays

    Raises
    ------
    LensError
        The chief ray does not get through.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    launch = _launch(system, height_mm, wavelengths_nm, pupil)
    flat = launch.transpose(1, 0, 2, 3).reshape(6, -1)
    rays = RealRays(*flat, np.ones(flat.shape[1]),
                    np.repeat(wavelengths_nm * 1e-3, pupil.x.size))
    start = flat[:3].copy(), flat[3:].copy()
    system.optic.surfaces.trace(rays)
    traced = _traced(system, start, rays, (wavelengths_nm.size, *pupil.shape))
    at_stop = np.sqrt(traced["square_height_mm2"][system.prescription.stop_index]) / system.stop_semi_aperture_mm
    traced["lost"] |= ~(np.abs(at_stop - pupil.radii[:, None]) < ASTRAY)
    for index, nm in enumerate(wavelengths_nm):
        if traced["lost"][index, 0, 0]:
            raise LensError(system.prescription.name, "field height", f"{height_mm:.4g} mm",
                            f"no ray gets through the middle of the stop at {nm:g} nm: end the field earlier")
    return [TracedRays(float(nm), **{name: values[..., index, :, :] for name, values in traced.items()})
            for index, nm in enumerate(wavelengths_nm)]


def _launch(system, height_mm, wavelengths_nm, pupil):
    """Where rays start and which way they go: array (wavelength, 6, radius, azimuth)."""
    if wavelengths_nm.size <= AIMED_WAVELENGTHS:
        return np.stack([_aimed(system, height_mm, nm, pupil) for nm in wavelengths_nm])
    first, last = wavelengths_nm[0], wavelengths_nm[-1]
    spread = (1 - np.cos(np.pi * np.arange(AIMED_WAVELENGTHS) / (AIMED_WAVELENGTHS - 1))) / 2
    nodes = first + (last - first) * spread
    aimed = np.stack([_aimed(system, height_mm, nm, pupil) for nm in nodes])
    launch = np.tensordot(_lagrange_weights(nodes, wavelengths_nm), aimed, axes=(1, 0))
    launch[:, 3:] /= np.linalg.norm(launch[:, 3:], axis=1, keepdims=True)
    return launch


def _lagrange_weights(nodes, values):
    """Weights of a function's values at the nodes in the polynomial through them: array (value, node)."""
    weights = np.ones((values.size, nodes.size))
    for node in range(nodes.size):
        others = np.delete(nodes, node)
        weights[:, node] = np.prod((values[:, None] - others) / (nodes[node] - others), axis=1)
    return weights


def _aimed(system, height_mm, nm, pupil):
    """Rays through the points of the stop, as array (6, radius, azimuth)."""
    field = np.full(pupil.x.size, system.field_of_height(height_mm))
    try:
        rays = system.optic.ray_tracer.ray_generator.generate_rays(
            np.zeros_like(field), field, pupil.x.ravel(), pupil.y.ravel(), nm * 1e-3)
    except ValueError as error:
        raise LensError(system.prescription.name, "field height", f"{height_mm:.4g} mm",
                        f"no rays find the stop ({error}): end the field earlier") from None
    return np.reshape([rays.x, rays.y, rays.z, rays.L, rays.M, rays.N], (6, *pupil.shape))


def _traced(system, start, rays, shape):
    """The arrays of `TracedRays`, (…, wavelength, radius, azimuth)."""
    surfaces = system.optic.surfaces
    position, direction = np.stack([rays.x, rays.y, rays.z]), np.stack([rays.L, rays.M, rays.N])
    start_position, start_direction = start
    if np.isinf(system.prescription.object_distance_mm):
        wave = np.sum(start_position * start_direction, axis=0)
        along = np.hypot(start_direction[1], start_direction[2])
        source = np.stack([start_position[0], (start_position[1] * start_direction[2]
                                               - start_position[2] * start_direction[1]) / along])
    else:
        wave, source = np.zeros(position.shape[1]), start_direction[:2]
    inner = slice(1, -1)  # neither the object nor the image plane
    places = zip(surfaces.x[inner], surfaces.y[inner], strict=True)
    arrays = {"position_mm": position, "direction": direction, "path_mm": rays.opd + wave, "source": source,
              "square_height_mm2": np.stack([x**2 + y**2 for x, y in places]),
              "lost": ~np.isfinite(position).all(axis=0) | (np.asarray(rays.i) <= 0)}
    return {name: np.reshape(values, (*values.shape[:-1], *shape)) for name, values in arrays.items()}
