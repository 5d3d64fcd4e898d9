"""Conic and aspheric surfaces: sag, normal, intersection with rays, and refraction.

Rays are arrays (3, ...) of position and direction cosines, in mm relative to the vertex of the next surface.
"""

import numpy as np

from .prescription import Surface

STEPS = 50  # of Newton's method
CONVERGED_MM, GOOD_MM = 1e-13, 1e-9
LEAST_SQUARE_MM2 = 1e-24  # the slope of a term in r is undefined at the vertex, and finite next to it
LEAST_ROOT = 1e-6  # an iteration may pass beyond the conic's end before it reaches the surface


def vertex_curvature(surface: Surface) -> float:
    """Curvature at the vertex, per mm, including the term in r^2."""
    return 1 / surface.radius_mm + 2 * (surface.aspheric[0] if surface.aspheric else 0.0)


def sag_and_slope(surface: Surface, square_mm2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sag in mm, and its derivative with respect to the squared distance from the axis."""
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
    """Unit normals at points of a surface: array (3, ...), towards the image at the vertex."""
    x, y, z = position
    if surface.aspheric or surface.odd_aspheric:
        slope = 2 * sag_and_slope(surface, x**2 + y**2)[1]
        normal = np.stack([-slope * x, -slope * y, np.ones_like(z)])
    else:
        curvature = 1 / surface.radius_mm
        normal = np.stack([-curvature * x, -curvature * y, 1 - curvature * (1 + surface.conic) * z])
    return normal / np.sqrt(np.sum(normal**2, axis=0))


def distance_to(surface: Surface, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distances along rays to a surface, in mm; negative if they have passed it, NaN if they miss it."""
    to_plane = -position[2] / direction[2]
    x, y = position[:2] + to_plane * direction[:2]
    if surface.aspheric or surface.odd_aspheric:
        return to_plane + _distance_to_asphere(surface, x, y, direction)
    along_x, along_y, along_z = direction
    curvature = 1 / surface.radius_mm
    b = along_z - curvature * (x * along_x + y * along_y)
    square = curvature * (x**2 + y**2)
    root = np.sqrt(b**2 - curvature * (1 + surface.conic * along_z**2) * square)
    return to_plane + square / (b + np.copysign(root, along_z))


def _distance_to_asphere(surface, x, y, direction):
    """Distances from the vertex plane by Newton's method. Each ray iterates until it converges."""
    rays = np.broadcast_arrays(x, y, *direction)
    shape, rays = rays[0].shape, np.stack([each.ravel() for each in rays])
    distances, active, distance = np.full(rays.shape[1], np.nan), np.arange(rays.shape[1]), np.zeros(rays.shape[1])
    for _ in range(STEPS):
        x, y, along_x, along_y, along_z = rays
        hit_x, hit_y = x + distance * along_x, y + distance * along_y
        sag, slope = sag_and_slope(surface, hit_x**2 + hit_y**2)
        step = (sag - distance * along_z) / (2 * slope * (hit_x * along_x + hit_y * along_y) - along_z)
        distance, size = distance - step, np.abs(step)
        distances[active] = np.where(size < GOOD_MM, distance, np.nan)
        far = size > CONVERGED_MM
        if not far.any():
            break
        active, distance, rays = active[far], distance[far], rays[:, far]
    return distances.reshape(shape)


def refracted(direction: np.ndarray, normal: np.ndarray, ratio: np.ndarray | float) -> np.ndarray:
    """Directions behind a surface, by Snell's law; NaN for total reflection.

    Parameters
    ----------
    direction, normal : arrays (3, ...)
    ratio : array or float
        Index in front of the surface over the index behind it.
    """
    cosine = np.sum(direction * normal, axis=0)
    behind = np.copysign(np.sqrt(1 - ratio**2 * (1 - cosine**2)), cosine)
    return ratio * direction + (behind - ratio * cosine) * normal
