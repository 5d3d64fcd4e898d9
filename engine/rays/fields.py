"""Rays of lenses without rotational symmetry: from points in focus to places on the sensor, across the complete stop.

Coordinates are in the image, which is upside down: light from the right and above lands at -x and -y. The upright
picture's are their negatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..prescription.system import System, system_of
from ..runtime.errors import LensError
from .aiming import AIMED, PLACE_STEP, SLOPE_STEP, broyden_steps
from .rays import Pupil, TracedRays
from .trace import BothWays, trace_both_ways
from .view import View, focus_lean, sensor_axes, sensor_vertex_mm

STEPS = 12  # from the axis to a place
CURVE_PLACES = 17
CHIEF_STEP = 1e-4  # in slope, for derivatives of places and fields


@dataclass(frozen=True, eq=False)
class FieldPoints:
    """Points in focus whose chief rays, through the middle of the stop, land at places on the sensor.

    Attributes
    ----------
    wavelengths_nm : array (wavelength,)
    slope : array (2, wavelength, place)
        Of the chief rays, at the stop.
    tangent : array (2, wavelength, place)
        Of the angle between the camera's axis and the light from the viewpoint's direction.
    nearness : array (wavelength, place)
        Inverse depths along the camera's axis from the viewpoint, in 1/mm.
    change : array (2, 2, wavelength, place)
        Derivatives of the tangents with respect to x and y of the places, in 1/mm.
    lost : bool array (wavelength, place)
        Places that no chief ray reaches.
    """

    wavelengths_nm: np.ndarray
    slope: np.ndarray
    tangent: np.ndarray
    nearness: np.ndarray
    change: np.ndarray
    lost: np.ndarray

    def at(self, places: slice) -> "FieldPoints":
        """Some of the places."""
        return FieldPoints(self.wavelengths_nm, *(getattr(self, name)[..., places] for name in
                                                  ("slope", "tangent", "nearness", "change", "lost")))


def view_of(system: System) -> View:
    """The camera of a lens.

    Its axis is the normal of the sensor. Places on the sensor count from where light along this axis lands in the
    design, whose surfaces are centred.

    Raises
    ------
    LensError
        No light along this axis reaches the sensor.
    """
    prescription = system.prescription
    nearness = 1 / (prescription.object_distance_mm + system.entrance_pupil_mm)
    axes = sensor_axes(prescription)
    view = View(axes, np.array([0.0, 0.0, system.entrance_pupil_mm]), np.zeros(2),
                sensor_vertex_mm(prescription), nearness, focus_lean(system, axes))
    if prescription.image_pose is None:
        return view
    design = undisturbed(system)
    media = design.indices_at([prescription.reference_wavelength_nm])[:, 0]
    towards = (axes[2][:, None], np.array([nearness]))
    slope, error = _searched(_missed_points(design, view, media), towards, np.zeros((2, 1)))
    landing = view.places_mm(_traced(design.prescription, media, 0.0, 0.0, *slope).position)
    if not error[0] < AIMED:
        raise LensError(prescription.name, "image_pose", prescription.image_pose.tilt_deg,
                        "no light reaches the sensor: tilt it less")
    return replace(view, origin_mm=landing[:, 0])


def undisturbed(system: System) -> System:
    """The lens with centred surfaces; turns about the axis remain."""
    prescription = system.prescription
    return system_of(replace(prescription.centred(), image_pose=prescription.image_pose))


def find_fields(system: System, view: View, places_mm: np.ndarray, wavelengths_nm: Sequence[float] | np.ndarray
                ) -> FieldPoints:
    """Points in focus whose chief rays land at places on the sensor: array (2, place), x and y."""
    wavelengths_nm, slopes, errors = np.asarray(wavelengths_nm, dtype=float), [], []
    all_media = system.indices_at(wavelengths_nm).T
    with np.errstate(all="ignore"):
        for media in all_media:
            missed = _missed_places(system, view, media)
            start = slopes[-1] if slopes else _continued(missed, places_mm)
            slope, error = _searched(missed, places_mm, start)
            slopes.append(slope)
            errors.append(error)
        found = [_fields(system, view, *each) for each in zip(all_media, slopes, strict=True)]
    tangents, nearnesses, changes = zip(*found, strict=True)
    return FieldPoints(wavelengths_nm, np.stack(slopes, axis=1), np.stack(tangents, axis=-2),
                       np.stack(nearnesses, axis=-2), np.stack(changes, axis=-2),
                       ~(np.stack(errors) < AIMED))


def chief_ray_curve(system: System, end_mm: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Chief rays to places on a line from the middle of the picture to this end, x and y in mm, at the reference
    wavelength: their distances from the middle in mm, up to the first lost ray, and their angles to the camera's axis
    in radians: arrays (place,)."""
    share, nm = np.linspace(0, 1, CURVE_PLACES), system.prescription.reference_wavelength_nm
    points = find_fields(system, view_of(system), -np.outer(end_mm, share), [nm])
    known = np.logical_and.accumulate(~points.lost[0])
    return np.hypot(*end_mm) * share[known], np.arctan(np.hypot(*points.tangent[:, 0, known]))


def trace_fields(system: System, view: View, points: FieldPoints, pupil: Pupil) -> TracedRays:
    """Trace rays from points in focus across the stop; places on the sensor take the heights' part."""
    x_mm, y_mm = (system.stop_semi_aperture_mm * each.ravel() for each in (pupil.x, pupil.y))
    with np.errstate(all="ignore"):
        arrays = [_rays_of_fields(system, view, media, points, number, x_mm, y_mm)
                  for number, media in enumerate(system.indices_at(points.wavelengths_nm).T)]
    stacked = {name: np.stack([each[name] for each in arrays], axis=-3) for name in arrays[0]}
    return TracedRays(pupil, points.wavelengths_nm, **{name: values.reshape(*values.shape[:-1], *pupil.shape)
                                                       for name, values in stacked.items()})


def _rays_of_fields(system, view, media, points, number, x_mm, y_mm):
    """The arrays of `TracedRays` at one wavelength: (..., place, ray)."""
    direction, nearness = view.directions(points.tangent[:, number]), points.nearness[number]
    missed = _missed_points(system, view, media)
    slope, error = _aimed(missed, (direction, nearness), points.slope[:, number], x_mm, y_mm,
                          PLACE_STEP * system.stop_semi_aperture_mm)
    traced = _traced(system.prescription, media, x_mm, y_mm, *slope)
    to_entry_mm, source = view.object_space(direction[..., None], nearness[:, None], traced.entry)
    path_mm = to_entry_mm + traced.path_mm
    return {"position_mm": view.places_mm(traced.position), "direction": traced.direction, "path_mm": path_mm,
            "source": source, "square_height_mm2": traced.square_mm2,
            "lost": ~((error < AIMED) & np.isfinite(path_mm))}


def aim_at_places(system: System, view: View, points: FieldPoints, places_mm: np.ndarray, x_mm: np.ndarray,
                  y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes at points of the stop of rays to places on the sensor.

    Parameters
    ----------
    system, view
    points : FieldPoints
        Of these places.
    places_mm : array (2, place)
    x_mm, y_mm : arrays (ray,)
        Points of the stop.

    Returns
    -------
    slope : array (2, wavelength, place, ray)
    aimed : bool array (wavelength, place, ray)
        Rays that do reach the place.
    """
    with np.errstate(all="ignore"):
        found = [_aimed(_missed_places(system, view, media), places_mm, points.slope[:, number], x_mm, y_mm,
                        PLACE_STEP * system.stop_semi_aperture_mm)
                 for number, media in enumerate(system.indices_at(points.wavelengths_nm).T)]
    slopes, errors = zip(*found, strict=True)
    return np.stack(slopes, axis=1), np.stack(errors) < AIMED


def _traced(prescription, media, x_mm, y_mm, slope_x, slope_y) -> BothWays:
    """`trace_both_ways` at one wavelength: arrays (..., ray)."""
    rays = (np.asarray(each)[None] for each in np.broadcast_arrays(x_mm, y_mm, slope_x, slope_y))
    indices = media.reshape(-1, 1, *(1,) * np.ndim(slope_x))
    return BothWays(*(each[:, 0] if each.ndim > 1 + np.ndim(slope_x) else each[0]
                      for each in trace_both_ways(prescription, indices, *rays)))


def _in_front(prescription, media):
    """The lens up to its stop, for rays that are only needed there, and its refractive indices."""
    stop = prescription.stop_index
    return replace(_part(prescription, prescription.surfaces[:stop + 1]), image_pose=None), media[:stop + 2]


def _behind(prescription, media):
    """The lens from its stop on, and its refractive indices."""
    stop = prescription.stop_index
    return _part(prescription, prescription.surfaces[stop:]), media[stop:]


def _part(prescription, surfaces):
    """The shapes of a part of a lens, at its present focus; its media and mirrors are in the indices."""
    shapes = tuple(replace(surface, gaps_mm=(), glass="", mirror=False) for surface in surfaces)
    return replace(prescription, surfaces=shapes, focused_at_mm=(), focus="paraxial")


def _missed_places(system, view, media):
    """Function of (x, y) on the sensor and the ray: its error there, in focal lengths."""
    behind = _behind(system.prescription, media)

    def missed(place_x, place_y, x_mm, y_mm, slope_x, slope_y):
        position = _traced(*behind, x_mm, y_mm, slope_x, slope_y).position
        return (view.places_mm(position) - np.stack(np.broadcast_arrays(place_x, place_y))) / system.efl_mm

    return missed


def _missed_points(system, view, media):
    """Function of an object point and the ray: its error there, as an angle along x and y."""
    in_front = _in_front(system.prescription, media)

    def missed(direction_x, direction_y, direction_z, nearness, x_mm, y_mm, slope_x, slope_y):
        traced = _traced(*in_front, x_mm, y_mm, slope_x, slope_y)
        entry, before = traced.entry, traced.before
        away = [each + nearness * (at - eye) for each, at, eye in
                zip((direction_x, direction_y, direction_z), entry, view.viewpoint_mm, strict=True)]
        return np.stack([away[2] * before[0] - away[0] * before[2], away[2] * before[1] - away[1] * before[2]])

    return missed


def _fields(system, view, media, slope):
    """Tangents, nearness, and their change with the place, of points in focus on chief rays."""
    step = CHIEF_STEP * np.array([[0, 1, -1, 0, 0], [0, 0, 0, 1, -1]])
    traced = _traced(system.prescription, media, 0.0, 0.0, *(slope[..., None] + step[:, None]))
    tangent, nearness = view.in_focus(traced.entry, traced.before)
    place = view.places_mm(traced.position)
    by_slope, place_by_slope = (np.stack([each[..., 1] - each[..., 2], each[..., 3] - each[..., 4]], axis=-1)
                                for each in (tangent, place))  # (component, place, slope)
    change = np.moveaxis(by_slope, 1, 0) @ np.linalg.inv(np.moveaxis(place_by_slope, 1, 0))
    return tangent[..., 0], nearness[..., 0], np.moveaxis(change, 0, -1)


def _continued(missed, places_mm):
    """Slopes of chief rays to places, from the axis outwards in steps."""
    before, slope = np.zeros_like(places_mm), np.zeros_like(places_mm)
    for step in range(STEPS + 1):
        before, (slope, _) = slope, _searched(missed, places_mm * step / STEPS,
                                              2 * slope - before if step > 1 else slope)
    return slope


def _searched(missed, targets, slope):
    """Slopes of chief rays, from guesses, and their errors."""
    chief, inverse, _ = _linear(missed, targets, slope, None)
    return broyden_steps(missed, (*_flat(targets), *np.zeros_like(chief)), chief, inverse)


def _aimed(missed, targets, slope, x_mm, y_mm, step_mm):
    """Slopes (2, place, ray) at points of the stop, and errors (place, ray), around chief rays."""
    chief, inverse, by_place = _linear(missed, targets, slope, step_mm)
    stop = np.stack([x_mm, y_mm])
    turn = np.einsum("ijn,jkn,kr->inr", inverse, by_place, stop)
    start = chief[..., None] - turn
    shape = start.shape[1:]
    rays = [np.broadcast_to(each[:, None], shape).ravel() for each in _flat(targets)]
    rays += [np.broadcast_to(each, shape).ravel() for each in stop]
    inverses = np.broadcast_to(inverse[..., None], (2, 2, *shape)).reshape(2, 2, -1)
    slopes, error = broyden_steps(missed, rays, start.reshape(2, -1), inverses)
    return slopes.reshape(start.shape), error.reshape(shape)


def _flat(targets):
    """The components of targets: a list of arrays (place,)."""
    return [row for each in targets for row in np.atleast_2d(each)]


def _linear(missed, targets, slope, step_mm):
    """Slopes of chief rays, the inverse of the derivatives of their errors with respect to slopes, and the derivatives
    with respect to the point of the stop: arrays (2, place) and (2, 2, place)."""
    targets = _flat(targets)

    def change(step, x_mm, y_mm, slope_x, slope_y):
        return (missed(*targets, x_mm, y_mm, slope[0] + slope_x, slope[1] + slope_y) - middle) / step

    middle = missed(*targets, 0.0, 0.0, *slope)
    by_slope = np.stack([change(SLOPE_STEP, 0.0, 0.0, SLOPE_STEP, 0.0),
                         change(SLOPE_STEP, 0.0, 0.0, 0.0, SLOPE_STEP)], axis=1)
    determinant = by_slope[0, 0] * by_slope[1, 1] - by_slope[0, 1] * by_slope[1, 0]
    inverse = np.array([[by_slope[1, 1], -by_slope[0, 1]], [-by_slope[1, 0], by_slope[0, 0]]]) / determinant
    by_place = step_mm and np.stack([change(step_mm, step_mm, 0.0, 0.0, 0.0),
                                     change(step_mm, 0.0, step_mm, 0.0, 0.0)], axis=1)
    return slope, inverse, by_place
