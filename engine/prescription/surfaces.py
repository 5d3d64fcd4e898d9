"""Conic, aspheric, biconic and toroidal surfaces: sag, normal, intersection with rays, and refraction.

Rays are arrays (3, ...) of position and direction cosines, in mm relative to the vertex of the next surface. Sags,
normals and intersections are in the surface's own frame, which its pose displaces from the axis of the lens.
"""

import numpy as np

from .prescription import Pose, Surface

STEPS = 50  # of Newton's method
CONVERGED_MM, GOOD_MM = 1e-13, 1e-9
LEAST_SQUARE_MM2 = 1e-24  # the slope of a term in r is undefined at the vertex, and finite next to it
LEAST_ROOT = 1e-6  # an iteration may pass beyond the conic's end before it reaches the surface


def vertex_curvature(surface: Surface, section: str = "y") -> float:
    """Curvature of the section along "x" or "y" at the vertex, per mm, including the term in r^2."""
    radius_mm, skew = surface.radius_mm, (surface.skews or (0.0,))[0]
    if section == "x" and surface.radius_x_mm is not None:
        radius_mm, skew = surface.radius_x_mm, -skew
    term = 0.0 if surface.profile not in ("", section) else (surface.aspheric or (0.0,))[0]
    return 1 / radius_mm + 2 * term * (1 + skew)


def to_surface_frame(pose: Pose | None, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rays (3, ...) in the frame of a displaced surface, from those relative to its place on the axis."""
    if pose is None:
        return position, direction
    back = pose.rotation.T
    return np.tensordot(back, position - _column(pose.offset_mm, position), 1), np.tensordot(back, direction, 1)


def from_surface_frame(pose: Pose | None, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of `to_surface_frame`."""
    if pose is None:
        return position, direction
    rotation = pose.rotation
    return np.tensordot(rotation, position, 1) + _column(pose.offset_mm, position), np.tensordot(rotation, direction, 1)


def _column(vector, like):
    return np.reshape(vector, (3, *(1,) * (np.ndim(like) - 1)))


def sag_and_gradient(surface: Surface, x_mm: np.ndarray, y_mm: np.ndarray
                     ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sag in mm, and its derivatives with respect to x and y."""
    if surface.radius_x_mm is None:
        sag, slope = sag_and_slope(surface, x_mm**2 + y_mm**2)
        return sag, 2 * slope * x_mm, 2 * slope * y_mm
    if surface.profile:
        return _toroid(surface, x_mm, y_mm)
    return _biconic(surface, x_mm, y_mm)


def _biconic(surface, x_mm, y_mm):
    """As `sag_and_gradient`. Beyond the end of the surface it continues, without an edge, as a paraboloid."""
    bends = 1 / surface.radius_x_mm, 1 / surface.radius_mm
    ends = (1 + surface.conic_x) * bends[0]**2, (1 + surface.conic) * bends[1]**2
    root = np.sqrt(np.maximum(1 - ends[0] * x_mm**2 - ends[1] * y_mm**2, LEAST_ROOT**2))
    sag = (bends[0] * x_mm**2 + bends[1] * y_mm**2) / (1 + root)
    steeper = np.where(root > LEAST_ROOT, sag / (2 * root * (1 + root)), 0.0)
    slope_x, slope_y = (bend / (1 + root) + steeper * end for bend, end in zip(bends, ends, strict=True))
    skews = (*surface.skews, *(0.0,) * (len(surface.aspheric) - len(surface.skews)))
    for power, (term, skew) in enumerate(zip(surface.aspheric, skews, strict=True), 1):
        square = (1 - skew) * x_mm**2 + (1 + skew) * y_mm**2
        raised = term * square**(power - 1)
        sag = sag + raised * square
        slope_x, slope_y = slope_x + power * (1 - skew) * raised, slope_y + power * (1 + skew) * raised
    return sag, 2 * slope_x * x_mm, 2 * slope_y * y_mm


def _toroid(surface, x_mm, y_mm):
    """As `sag_and_gradient`: (R - z)^2 + across^2 = (R - profile)^2, with the radius R of the other section."""
    if surface.profile == "y":
        profile, _, slope = _biconic(surface, np.zeros_like(y_mm), y_mm)
        sag, by_x, steeper = _turned(1 / surface.radius_x_mm, profile, x_mm)
        return sag, by_x, slope * steeper
    profile, slope, _ = _biconic(surface, x_mm, np.zeros_like(x_mm))
    sag, by_y, steeper = _turned(1 / surface.radius_mm, profile, y_mm)
    return sag, slope * steeper, by_y


def _turned(bend, profile_mm, across_mm):
    """Sag of a turned profile, and its derivatives with respect to the distance from it and to the profile's sag."""
    bend = bend / (1 - bend * profile_mm)
    root = np.sqrt(np.maximum(1 - (bend * across_mm)**2, LEAST_ROOT**2))
    steeper = np.where(root > LEAST_ROOT, 1 / root, 2 / (1 + root))
    return profile_mm + bend * across_mm**2 / (1 + root), bend * across_mm * steeper, steeper


def sag_and_slope(surface: Surface, square_mm2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sag of a surface of revolution in mm, and its derivative with respect to the squared distance from the axis."""
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
    if not _is_conic(surface):
        _, by_x, by_y = sag_and_gradient(surface, x, y)
        normal = np.stack([-by_x, -by_y, np.ones_like(z)])
    else:
        curvature = 1 / surface.radius_mm
        normal = np.stack([-curvature * x, -curvature * y, 1 - curvature * (1 + surface.conic) * z])
    return normal / np.sqrt(np.sum(normal**2, axis=0))


def distance_to(surface: Surface, position: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Distances along rays to a surface, in mm; negative if they have passed it, NaN if they miss it."""
    to_plane = -position[2] / direction[2]
    x, y = position[:2] + to_plane * direction[:2]
    if not _is_conic(surface):
        return to_plane + _distance_to_asphere(surface, x, y, direction)
    along_x, along_y, along_z = direction
    curvature = 1 / surface.radius_mm
    b = along_z - curvature * (x * along_x + y * along_y)
    square = curvature * (x**2 + y**2)
    root = np.sqrt(b**2 - curvature * (1 + surface.conic * along_z**2) * square)
    return to_plane + square / (b + np.copysign(root, along_z))


def _is_conic(surface):
    """Whether rays meet it in closed form."""
    return not (surface.aspheric or surface.odd_aspheric) and surface.radius_x_mm is None


def _distance_to_asphere(surface, x, y, direction):
    """Distances from the vertex plane by Newton's method. Each ray iterates until it converges."""
    rays = np.broadcast_arrays(x, y, *direction)
    shape, rays = rays[0].shape, np.stack([each.ravel() for each in rays])
    distances, active, distance = np.full(rays.shape[1], np.nan), np.arange(rays.shape[1]), np.zeros(rays.shape[1])
    for _ in range(STEPS):
        x, y, along_x, along_y, along_z = rays
        hit_x, hit_y = x + distance * along_x, y + distance * along_y
        sag, rise = _sag_along(surface, hit_x, hit_y, along_x, along_y)
        step = (sag - distance * along_z) / (rise - along_z)
        distance, size = distance - step, np.abs(step)
        distances[active] = np.where(size < GOOD_MM, distance, np.nan)
        far = size > CONVERGED_MM
        if not far.any():
            break
        active, distance, rays = active[far], distance[far], rays[:, far]
    return distances.reshape(shape)


def _sag_along(surface, x_mm, y_mm, along_x, along_y):
    """Sag, and its derivative along a ray."""
    if surface.radius_x_mm is None:
        sag, slope = sag_and_slope(surface, x_mm**2 + y_mm**2)
        return sag, 2 * slope * (x_mm * along_x + y_mm * along_y)
    sag, by_x, by_y = sag_and_gradient(surface, x_mm, y_mm)
    return sag, by_x * along_x + by_y * along_y


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
