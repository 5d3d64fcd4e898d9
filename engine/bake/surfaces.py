"""Surfaces as rays meet them: conics and aspheres, where a ray arrives, and how it is refracted.

Rays are arrays (3, ...) of position and direction cosines, in mm about the vertex of the surface they are bound for.
"""

import numpy as np

from .prescription import Surface

STEPS = 50  # of Newton's method
CONVERGED_MM, GOOD_MM = 1e-13, 1e-9
LEAST_SQUARE_MM2 = 1e-24  # a term in r has no slope at the vertex, and a finite one next to it
LEAST_ROOT = 1e-6  # beyond the conic's end a ray may come by on its way to a place where there is a surface


def vertex_curvature(surface: Surface) -> float:
    """Curvature at the vertex, per mm; a term in r^2 bends there too."""
    return 1 / surface.radius_mm + 2 * (surface.aspheric[0] if surface.aspheric else 0.0)


def sag_and_slope(surface: Surface, square_mm2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sag in mm, and its derivative by the squared distance from the axis."""
    curvature = 1 / surface.radius_mm
    root = np.sqrt(np.maximum(1 - (1 + surface.conic) * curvature**2 * square_mm2, LEAST_ROOT**2))
    sag, slope = curvature * square_mm2 / (1 + root), curvature / (2 * root)
    if surface.aspheric:
        powers, change = np.zeros_like(square_mm2), np.zeros_like(square_mm2)
        for power, term in reversed(list(enumerate(surface.aspheric, 1))):  # Horner's scheme
            change = change * square_mm2 + power * term
            powers = (powers + term) * square_mm2
        sag, slope = sag + powers, slope + change
    off_axis = np.maximum(square_mm2, LEAST_SQUARE_MM2)
    for power, term in enumerate(surface.odd_aspheric):
        raised = off_axis ** (power + 0.5)
        sag, slope = sag + term * raised, slope + (power + 0.5) * term * raised / off_axis
    return sag, slope


def unit_normal(surface: Surface, position: np.ndarray) -> np.ndarray:
    """Normal of a surface at places on it: array (3, ...), towards the image at the vertex."""
    x, y, z = position
    if surface.aspheric or surface.odd_aspheric:
        slope = 2 * sag_and_slope(surface, x**2 + y**2)[1]
        normal = np.stack([-slope * x, -slope * y, np.ones_like(z)])
    else:
        curvature = 1 / surface.radius_mm
        normal = np.stack([-curvature * x, -curvature * y, 1 - curvature * (1 + surface.conic) * z])
    return normal / np.sqrt(np.sum(normal**2, axis=0))


def way_to(surface: Surface, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """How far rays have to go to a surface, in mm, negative if they have passed it; NaN where they miss it."""
    to_plane = -position[2] / direction[2]
    x, y = position[:2] + to_plane * direction[:2]
    if surface.aspheric or surface.odd_aspheric:
        return to_plane + _way_to_asphere(surface, x, y, direction)
    along_x, along_y, along_z = direction
    curvature = 1 / surface.radius_mm
    b = along_z - curvature * (x * along_x + y * along_y)
    square = curvature * (x**2 + y**2)
    root = np.sqrt(b**2 - curvature * (1 + surface.conic * along_z**2) * square)
    return to_plane + square / (b + np.copysign(root, along_z))


def _way_to_asphere(surface, x, y, direction):
    """From the vertex plane, by Newton's method, each ray for as long as it needs."""
    rays = np.broadcast_arrays(x, y, *direction)
    shape, rays = rays[0].shape, np.stack([each.ravel() for each in rays])
    found, going, way = np.full(rays.shape[1], np.nan), np.arange(rays.shape[1]), np.zeros(rays.shape[1])
    for _ in range(STEPS):
        x, y, along_x, along_y, along_z = rays
        there_x, there_y = x + way * along_x, y + way * along_y
        sag, slope = sag_and_slope(surface, there_x**2 + there_y**2)
        step = (sag - way * along_z) / (2 * slope * (there_x * along_x + there_y * along_y) - along_z)
        way, size = way - step, np.abs(step)
        found[going] = np.where(size < GOOD_MM, way, np.nan)
        far = size > CONVERGED_MM
        if not far.any():
            break
        going, way, rays = going[far], way[far], rays[:, far]
    return found.reshape(shape)


def refracted(direction: np.ndarray, normal: np.ndarray, ratio: np.ndarray | float) -> np.ndarray:
    """Directions behind a surface, by Snell's law; NaN where there is total reflection.

    Parameters
    ----------
    direction, normal : arrays (3, ...)
    ratio : array or float
        Index before the surface over that behind it.
    """
    cosine = np.sum(direction * normal, axis=0)
    behind = np.copysign(np.sqrt(1 - ratio**2 * (1 - cosine**2)), cosine)
    return ratio * direction + (behind - ratio * cosine) * normal
