"""Rays through spheres, conics and mirrors in plain vectors: the light travels along its direction, and a mirror turns
it back. Shares no code with the engine's tracer, which refracts to negative indices instead.
"""

import numpy as np


def trace(prescription, indices, position, direction):
    """Trace rays in coordinates of the first vertex, by positive indices in front of each surface and behind the last.

    Parameters
    ----------
    prescription : Prescription
        Conics of revolution on the axis.
    indices : array (surface + 1,)
    position, direction : arrays (3, ray)
        In front of the lens.

    Returns
    -------
    position, direction : arrays (3, ray)
        On the image plane.
    path_mm : array (ray,)
        Optical path from the given position.
    open : bool array (ray,)
        Whether the rims, except the stop's, and the central obstructions let the ray pass.
    stop_mm : array (2, ray)
        x and y on the stop.
    """
    path_mm, is_open, vertex_mm = np.zeros(position.shape[1]), np.ones(position.shape[1], bool), 0.0
    for surface, before, behind in zip(prescription.surfaces, indices, indices[1:], strict=False):
        along_mm = _distance_mm(surface, position - [[0.0], [0.0], [vertex_mm]], direction)
        position = position + along_mm * direction
        path_mm = path_mm + before * along_mm
        x, y, z = position
        height = np.hypot(x, y)
        if surface.stop:
            stop_mm = np.stack([x, y])
        else:
            is_open &= height <= surface.semi_aperture_mm
        is_open &= height >= surface.semi_obstruction_mm
        direction = _turned(surface, np.stack([x, y, z - vertex_mm]), direction, before / behind)
        vertex_mm += surface.thickness_mm
    along_mm = (vertex_mm - position[2]) / direction[2]
    return position + along_mm * direction, direction, path_mm + indices[-1] * along_mm, is_open, stop_mm


def _distance_mm(surface, position, direction):
    """Distance to the sheet next to the vertex: the root of c (x^2 + y^2 + (1 + k) z^2) - 2 z that is nearer to it."""
    c, shape = 1 / surface.radius_mm, np.array([[1.0], [1.0], [1 + surface.conic]])
    to_plane = -position[2] / direction[2]
    if c == 0:
        return to_plane
    a = c * np.sum(shape * direction**2, axis=0)
    b = c * np.sum(shape * direction * position, axis=0) - direction[2]
    rest = c * np.sum(shape * position**2, axis=0) - 2 * position[2]
    root = np.sqrt(b**2 - a * rest)
    roots = np.stack([(-b + root) / a, (-b - root) / a]) if np.all(a != 0) else np.stack([rest / (-2 * b)] * 2)
    return np.take_along_axis(roots, np.abs(roots - to_plane).argmin(axis=0)[None], 0)[0]


def _turned(surface, place, direction, ratio):
    """Directions behind a surface: mirrored, or by Snell's law in vectors."""
    c = 1 / surface.radius_mm
    normal = np.stack([c * place[0], c * place[1], c * (1 + surface.conic) * place[2] - 1])
    normal /= np.linalg.norm(normal, axis=0)
    cosine = np.sum(direction * normal, axis=0)
    if surface.mirror:
        return direction - 2 * cosine * normal
    normal, cosine = -np.sign(cosine) * normal, np.abs(cosine)  # against the light
    return ratio * direction + (ratio * cosine - np.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal
