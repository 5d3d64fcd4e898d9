"""Rays through surfaces given by implicit equations, by search for roots and numerical gradients: a second opinion."""

import numpy as np
import scipy

from lensfield.engine.prescription.prescription import Pose

STEP_MM = 1e-5


def biconic(surface):
    """Function of (x, y, z) that vanishes on a surface, by Zemax's definition of a biconic with anamorphic terms."""
    bend_x, bend_y = 1 / surface.radius_x_mm, 1 / surface.radius_mm

    def implicit(x, y, z):
        root = np.sqrt(1 - (1 + surface.conic_x) * (bend_x * x)**2 - (1 + surface.conic) * (bend_y * y)**2)
        conic = (bend_x * x**2 + bend_y * y**2) / (1 + root)
        skews = np.pad(surface.skews, (0, len(surface.aspheric) - len(surface.skews)))
        return z - conic - sum(a * ((1 - p) * x**2 + (1 + p) * y**2)**n for n, (a, p) in
                               enumerate(zip(surface.aspheric, skews, strict=True), 1))

    return implicit


def toroid(surface):
    """The same for a toroid: points are as far from the axis of the turn as those of the profile."""
    radius, bend, conic = surface.radius_x_mm, 1 / surface.radius_mm, surface.conic
    if surface.profile == "x":
        radius, bend, conic = surface.radius_mm, 1 / surface.radius_x_mm, surface.conic_x

    def implicit(x, y, z):
        along, across = (y, x) if surface.profile == "y" else (x, y)
        profile = bend * along**2 / (1 + np.sqrt(1 - (1 + conic) * (bend * along)**2))
        profile += sum(term * along**(2 * power) for power, term in enumerate(surface.aspheric, 1))
        if np.isinf(radius):
            return z - profile
        return np.sign(radius) * (abs(radius - profile) - np.hypot(radius - z, across))

    return implicit


def conic(surface):
    """The same for a surface of revolution."""
    bend = 1 / surface.radius_mm
    return lambda x, y, z: z - bend * (x**2 + y**2) / (1 + np.sqrt(1 - (1 + surface.conic) * bend**2 * (x**2 + y**2)))


def implicit_of(surface):
    """The function of a surface's kind."""
    return conic(surface) if surface.radius_x_mm is None else (toroid if surface.profile else biconic)(surface)


def gradient(implicit, place):
    """Unit normals at points (3, ...), towards +z."""
    steps = STEP_MM * np.eye(3).reshape(3, 3, *(1,) * (np.ndim(place) - 1))
    normal = np.stack([implicit(*(place + step)) - implicit(*(place - step)) for step in steps])
    return normal * np.sign(normal[2]) / np.sqrt(np.sum(normal**2, axis=0))


def root_mm(implicit, start, along, first_mm, last_mm):
    """Distance along a ray to a surface, between two others."""
    return scipy.optimize.brentq(lambda way: implicit(*(start + way * along)), first_mm, last_mm, xtol=1e-13)


def traced(prescription, indices, position, direction):
    """One ray, given in front of the first surface in the lens's frame, on the image plane: its place there and its
    direction, in the frame of the plane; its path from the start; and squared heights."""
    vertex_mm, path_mm, squares = 0.0, 0.0, []
    for surface, before, behind in zip(prescription.surfaces, indices[:-1], indices[1:], strict=True):
        origin, axes = _placed(surface.pose, vertex_mm)
        implicit = implicit_of(surface)
        start, along = axes.T @ (position - origin), axes.T @ direction
        near = -start[2] / along[2]
        way = root_mm(implicit, start, along, near - 3, near + 3)
        hit, normal = start + way * along, gradient(implicit, start + way * along)
        sideways = before / behind * (along - (along @ normal) * normal)
        along = sideways + np.sqrt(1 - sideways @ sideways) * normal
        position, direction, path_mm = origin + axes @ hit, axes @ along, path_mm + before * way
        squares.append(hit[0]**2 + hit[1]**2)
        vertex_mm += surface.thickness_mm
    origin, axes = _placed(prescription.image_pose, vertex_mm)
    start, along = axes.T @ (position - origin), axes.T @ direction
    way = -start[2] / along[2]
    return start + way * along, along, path_mm + indices[-1] * way, np.array(squares)


def _placed(pose, vertex_mm):
    pose = pose or Pose()
    tilt = scipy.spatial.transform.Rotation.from_euler("xyz", pose.tilt_deg, degrees=True)
    return pose.offset_mm + np.array([0.0, 0.0, vertex_mm]), tilt.as_matrix()
