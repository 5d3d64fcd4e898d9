"""Sequential ray tracing from the stop: backwards to the object and forwards to the image plane.

`indices` are arrays (surface + 1, ...) that broadcast against the rays. Squared heights are lists with an array
(2, ...) of x^2 and y^2 per surface. They, points of the stop, and positions and directions at the image plane, are in
the frames of these surfaces, which their poses displace. All other positions and directions are in the frame of the
lens, relative to a surface's place on the axis.
"""

from typing import NamedTuple

import numpy as np

from ..kernels.library import NUMPY, running
from ..kernels.tracing import KINDS, TracedSurfaces, trace
from ..prescription.prescription import Pose, Prescription
from ..prescription.surfaces import (
    distance_to,
    from_surface_frame,
    refracted,
    sag_and_gradient,
    to_surface_frame,
    unit_normal,
)


def start_on_stop(prescription: Prescription, x_mm: np.ndarray, y_mm: np.ndarray, slope_x: np.ndarray,
                  slope_y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and direction (3, ...) of rays at points of the stop, with slopes dx/dz and dy/dz in front of it.

    Slopes, and the results, are in the frame of the lens.
    """
    x_mm, y_mm, slope_x, slope_y = np.broadcast_arrays(x_mm, y_mm, slope_x, slope_y)
    stop = prescription.surfaces[prescription.stop_index]
    position = np.stack([x_mm, y_mm, sag_and_gradient(stop, x_mm, y_mm)[0]])
    direction = np.stack([slope_x, slope_y, np.ones_like(slope_x)]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    return from_surface_frame(stop.pose, position, direction)[0], direction


def trace_to_object(prescription: Prescription, indices: np.ndarray, position: np.ndarray, direction: np.ndarray
                    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | float, list[np.ndarray]]:
    """Trace rays from the stop back to the first surface.

    Returns
    -------
    position, direction : arrays (3, ...)
        Position on the first surface (on the stop if the stop is first), and direction in front of it, along the
        light.
    path_mm : array
        Optical path from the first surface to the stop.
    squares_mm2 : list of arrays (2, ...)
        Squared heights at the surfaces in front of the stop.
    """
    return _back(prescription, indices, position, direction, prescription.stop_index)


def trace_from_image(prescription: Prescription, indices: np.ndarray, position: np.ndarray, direction: np.ndarray
                     ) -> tuple[np.ndarray, np.ndarray, np.ndarray | float, list[np.ndarray]]:
    """Trace rays from the image plane back through all surfaces; returns as `trace_to_object`."""
    on_axis = from_surface_frame(prescription.image_pose, position, direction)
    return _back(prescription, indices, *on_axis, len(prescription.surfaces))


def _back(prescription, indices, position, direction, number):
    path_mm, squares_mm2 = 0.0, []
    for step in _steps_back(prescription, indices, position, direction, number):
        position, direction, section_mm, section_mm2 = step
        path_mm = path_mm + section_mm
        squares_mm2.insert(0, section_mm2)
    return position, direction, path_mm, squares_mm2


def _steps_back(prescription, indices, position, direction, number):
    """Trace rays, given relative to the vertex of surface `number` or to the image plane, back through the surfaces
    in front of it: yields the position on each, the direction in front of it, the optical path behind it, and the
    squared heights."""
    for before in range(number - 1, -1, -1):
        surface = prescription.surfaces[before]
        position, backwards, section_mm, section_mm2 = _through(
            surface, _moved(position, surface.thickness_mm), -direction, indices[before + 1], indices[before])
        direction = -backwards
        yield position, direction, section_mm, section_mm2


def points_from_image(prescription: Prescription, indices: np.ndarray, position: np.ndarray, direction: np.ndarray
                      ) -> tuple[np.ndarray, np.ndarray]:
    """Where rays from the image plane meet it and the surfaces, for drawings.

    Returns
    -------
    points_mm : array (surface + 1, 3, ...)
        On each surface, and on the image plane, in the frame of the lens relative to the first vertex.
    direction : array (3, ...)
        In front of the first surface, along the light.
    """
    vertices_mm = np.cumsum([0.0, *(surface.thickness_mm for surface in prescription.surfaces)])
    on_axis = from_surface_frame(prescription.image_pose, position, direction)
    steps = list(_steps_back(prescription, indices, *on_axis, len(prescription.surfaces)))[::-1]
    relative_mm = [*(step[0] for step in steps), on_axis[0]]
    points_mm = np.stack([_moved(point, vertex) for point, vertex in zip(relative_mm, vertices_mm, strict=True)])
    return points_mm, steps[0][1]


def invariants_from_image(prescription: Prescription, indices: np.ndarray, position: np.ndarray, direction: np.ndarray
                          ) -> np.ndarray:
    """(n sin(angle))^2 at each surface, which refraction keeps, of rays from the image plane: array (surface, ...)."""
    on_axis = from_surface_frame(prescription.image_pose, position, direction)
    steps = _steps_back(prescription, indices, *on_axis, len(prescription.surfaces))
    squares = []
    for surface, index, (place, before, *_) in zip(prescription.surfaces[::-1], indices[-2::-1], steps, strict=True):
        hit, along = to_surface_frame(surface.pose, place, before)
        squares.insert(0, index**2 * (1 - np.sum(along * unit_normal(surface, hit), axis=0)**2))
    return np.stack(squares)


def trace_to_image(prescription: Prescription, indices: np.ndarray, position: np.ndarray, direction: np.ndarray
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[np.ndarray]]:
    """Trace rays from the stop, before refraction there, to the image plane.

    Returns as `trace_to_object`, with squared heights at the stop and the surfaces behind it. Position and direction
    are in the frame of the image plane.
    """
    stop = prescription.stop_index
    position, direction, heights_mm2 = _bent(
        prescription.surfaces[stop], *to_surface_frame(prescription.surfaces[stop].pose, position, direction),
        indices[stop] / indices[stop + 1])
    path_mm, squares_mm2 = 0.0, [heights_mm2]
    for number in range(stop + 1, len(prescription.surfaces)):
        gap_mm = prescription.surfaces[number - 1].thickness_mm
        position, direction, section_mm, heights_mm2 = _through(
            prescription.surfaces[number], _moved(position, -gap_mm), direction, indices[number], indices[number + 1])
        path_mm = path_mm + section_mm
        squares_mm2.append(heights_mm2)
    position = _moved(position, -prescription.surfaces[-1].thickness_mm)
    position, direction = to_surface_frame(prescription.image_pose, position, direction)
    to_image_mm = -position[2] / direction[2]
    return position + to_image_mm * direction, direction, path_mm + indices[-1] * to_image_mm, squares_mm2


class BothWays(NamedTuple):
    """Rays traced from the stop in both directions, by `trace_to_object` and `trace_to_image`.

    `path_mm` is the optical path from `entry` to the image plane. `square_mm2` is an array: squared distances from the
    axis at each surface (surface, ...), and then x^2 and y^2 at each surface with a rectangular aperture.
    """

    entry: np.ndarray
    before: np.ndarray
    position: np.ndarray
    direction: np.ndarray
    path_mm: np.ndarray
    square_mm2: np.ndarray


def trace_both_ways(prescription: Prescription, indices: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray,
                    slope_x: np.ndarray, slope_y: np.ndarray) -> BothWays:
    """Trace rays through points of the stop, back to the first surface and on to the image plane.

    Parameters
    ----------
    prescription : Prescription
    indices : array (surface + 1, wavelength, 1, ...)
    x_mm, y_mm, slope_x, slope_y : arrays (wavelength, ...), or broadcasting to this
        Points of the stop, and slopes dx/dz and dy/dz in front of it.
    """
    *rays, _ = np.broadcast_arrays(x_mm, y_mm, slope_x, slope_y, indices[0])
    if running() == NUMPY:
        return _trace_both_ways(prescription, indices, *rays)
    surfaces, shape = traced_surfaces(prescription), rays[0].shape
    traced = [trace(surfaces, media.ravel(), [each.ravel() for each in at_wavelength])
              for media, *at_wavelength in zip(indices.swapaxes(0, 1), *rays, strict=True)]
    values, square_mm2 = zip(*traced, strict=True)
    values = np.stack(values, axis=1).reshape(-1, *shape)
    square_mm2 = np.stack(square_mm2, axis=1).reshape(-1, *shape)
    return BothWays(values[:3], values[3:6], values[6:9], values[9:12], values[12], square_mm2)


def _trace_both_ways(prescription, indices, x_mm, y_mm, slope_x, slope_y):
    """`trace_both_ways` in numpy; the reference for its tests."""
    on_stop = start_on_stop(prescription, x_mm, y_mm, slope_x, slope_y)
    entry, before, front_mm, front_mm2 = trace_to_object(prescription, indices, *on_stop)
    position, direction, rear_mm, rear_mm2 = trace_to_image(prescription, indices, *on_stop)
    squares_mm2 = [*front_mm2, *rear_mm2]
    return BothWays(entry, before, position, direction, front_mm + rear_mm, np.stack([
        *(np.sum(each, axis=0) for each in squares_mm2),
        *(square for number in prescription.rectangles for square in squares_mm2[number])]))


def traced_surfaces(prescription: Prescription) -> TracedSurfaces:
    """The surfaces of a prescription for the compiled loops."""
    surfaces = prescription.surfaces
    even, odd = (max(len(getattr(surface, terms)) for surface in surfaces) for terms in ("aspheric", "odd_aspheric"))
    shapes = np.zeros((len(surfaces), 3 + even + odd))
    for shape, surface in zip(shapes, surfaces, strict=True):
        shape[:3] = 1 / surface.radius_mm, surface.conic, surface.thickness_mm
        shape[3:3 + len(surface.aspheric)] = surface.aspheric
        shape[3 + even:3 + even + len(surface.odd_aspheric)] = surface.odd_aspheric
    kinds, sections = _sections(surfaces, even)
    return TracedSurfaces(shapes, prescription.stop_index, even, odd, kinds, sections, _poses(prescription),
                          _rows_of_rectangles(prescription))


def _sections(surfaces, even):
    """`TracedSurfaces.kinds` and `sections`."""
    if all(surface.radius_x_mm is None for surface in surfaces):
        return None, None
    kinds, sections = np.zeros(len(surfaces), np.int64), np.zeros((len(surfaces), 2 + even))
    for number, surface in enumerate(surfaces):
        if surface.radius_x_mm is not None:
            kinds[number] = KINDS[surface.profile]
            sections[number, :2] = 1 / surface.radius_x_mm, surface.conic_x
            sections[number, 2:2 + len(surface.skews)] = surface.skews
    return kinds, sections


def _rows_of_rectangles(prescription):
    """`TracedSurfaces.rectangles`."""
    if not prescription.rectangles:
        return None
    rows = np.zeros(len(prescription.surfaces), np.int64)
    rows[list(prescription.rectangles)] = len(rows) + 2 * np.arange(len(prescription.rectangles))
    return rows


def _poses(prescription):
    """`TracedSurfaces.poses`."""
    poses = [*(surface.pose for surface in prescription.surfaces), prescription.image_pose]
    if not any(poses):
        return None
    return np.stack([np.append(pose.offset_mm, pose.rotation) for pose in (each or Pose() for each in poses)])


def _through(surface, position, direction, before, behind):
    """Propagate rays to a surface and refract them there: position, direction, optical path, and squared heights."""
    position, direction = to_surface_frame(surface.pose, position, direction)
    distance_mm = distance_to(surface, position, direction)
    position, direction, heights_mm2 = _bent(surface, position + distance_mm * direction, direction, before / behind)
    return position, direction, before * distance_mm, heights_mm2


def _bent(surface, position, direction, ratio):
    """Refract rays on a surface, given in its own frame: position and direction in the frame of the lens, and squared
    heights."""
    refracted_rays = position, refracted(direction, unit_normal(surface, position), ratio)
    return *from_surface_frame(surface.pose, *refracted_rays), position[:2]**2


def _moved(position, along_mm):
    """Positions relative to a vertex that is `along_mm` in front of the previous one."""
    return position + np.reshape([0.0, 0.0, along_mm], (3, *(1,) * (position.ndim - 1)))
