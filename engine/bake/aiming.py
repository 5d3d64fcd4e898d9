"""Aiming: which way rays leave a place of the stop so that, followed back, they come from an object point.

Rays begin on the stop and not on the object: so none misses the front of a wide lens on its way to the stop. Two
slopes are unknown, and found for all rays at once by Broyden's method (Mathematics of Computation 19, 577, 1965).
"""

import numpy as np

from .system import System
from .trace import start_on_stop, trace_to_object

STEEPEST, CHIEF_SLOPES = 3.0, 401  # slopes at the stop among which chief rays are looked for
NEWTON_STEPS = 4  # of the chief rays, from a good first guess
SLOPE_STEP = 1e-6  # for derivatives by slope
PLACE_STEP = 1e-3  # and by place, of the stop's semi-aperture
STEPS = 16
LONGEST_STEP = 0.2  # in slope
CONVERGED, AIMED = 2e-13, 1e-10  # of what a ray misses the object point by


def aim(system: System, indices: np.ndarray, fields: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray
        ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slopes at the stop of rays from object points.

    Parameters
    ----------
    system : System
    indices : array (surface + 1, wavelength)
    fields : array (field,)
        Angles in radians, or object heights in mm.
    x_mm, y_mm : arrays (ray,)
        Places on the stop.

    Returns
    -------
    slope_x, slope_y : arrays (wavelength, field, ray)
    aimed : bool array (wavelength, field, ray)
        Which of them do come from the object point.
    """
    def miss(x, y, slope_x, slope_y):
        return _miss(system, indices[:, :, None, None], fields[:, None], x, y, slope_x, slope_y)

    with np.errstate(all="ignore"):
        chief = _chief_slopes(system, indices, fields)[..., None]
        for _ in range(NEWTON_STEPS):
            here, there = (miss(0.0, 0.0, 0.0, slope)[1] for slope in (chief, chief + SLOPE_STEP))
            chief = chief - here * SLOPE_STEP / (there - here)
        return _broyden(miss, x_mm, y_mm, chief, PLACE_STEP * system.stop_semi_aperture_mm)


def _miss(system, indices, fields, x_mm, y_mm, slope_x, slope_y):
    """By how much rays miss the object point, as angles along x and y: array (2, wavelength, field, ray)."""
    position, direction = start_on_stop(system.prescription, x_mm, y_mm, slope_x, slope_y)
    position, direction, _, _ = trace_to_object(system.prescription, indices, position, direction)
    if system.object_at_infinity:
        return np.stack(np.broadcast_arrays(
            direction[0], direction[1] * np.cos(fields) - direction[2] * np.sin(fields)))
    distance_mm = system.prescription.object_distance_mm
    back_mm = (distance_mm + position[2]) / direction[2]
    x, y = position[:2] - back_mm * direction[:2]
    return np.stack(np.broadcast_arrays(x, y - fields)) / -distance_mm


def _chief_slopes(system, indices, fields):
    """First guess of the chief rays' slopes, from those of many: array (wavelength, field); NaN where there is none."""
    slopes = np.linspace(0, STEEPEST, CHIEF_SLOPES)
    position, direction = start_on_stop(system.prescription, 0.0, 0.0, 0.0, slopes)
    found = np.empty((indices.shape[1], fields.size))
    for wavelength, of_wavelength in enumerate(indices.T):
        start, along, _, _ = trace_to_object(system.prescription, of_wavelength, position, direction)
        if system.object_at_infinity:
            field = np.arctan2(along[1], along[2])
        else:
            back_mm = (system.prescription.object_distance_mm + start[2]) / along[2]
            field = back_mm * along[1] - start[1]
        rises = np.diff(field) > 0
        last = slopes.size if rises.all() else int(np.argmin(rises)) + 1
        found[wavelength] = np.interp(np.abs(fields), field[:last], slopes[:last], right=np.nan)
    return found


def _broyden(miss, x_mm, y_mm, chief, step_mm):
    """Slopes (x, y) at which `miss` vanishes, and where it does."""
    middle = miss(0.0, 0.0, 0.0, chief)
    by_slope_x = (miss(0.0, 0.0, SLOPE_STEP, chief) - middle)[0] / SLOPE_STEP
    by_slope_y = (miss(0.0, 0.0, 0.0, chief + SLOPE_STEP) - middle)[1] / SLOPE_STEP
    by_x = (miss(step_mm, 0.0, 0.0, chief) - middle)[0] / step_mm
    by_y = (miss(0.0, step_mm, 0.0, chief) - middle)[1] / step_mm
    slopes = np.stack(np.broadcast_arrays(-x_mm * by_x / by_slope_x, chief - y_mm * by_y / by_slope_y))
    zero = np.zeros_like(slopes[0])
    inverse = np.array([[1 / by_slope_x + zero, zero], [zero, 1 / by_slope_y + zero]])  # of the Jacobian
    missed = miss(x_mm, y_mm, *slopes)
    for _ in range(STEPS):
        off = np.abs(missed).max(axis=0)
        if not np.any(off > CONVERGED):
            break
        step = -_times(inverse, missed)
        step *= np.minimum(1, LONGEST_STEP / np.maximum(np.hypot(*step), 1e-30)) * (off > CONVERGED)
        slopes = slopes + step
        now = miss(x_mm, y_mm, *slopes)
        learnt = _times(inverse, now - missed)
        along = np.sum(step * learnt, axis=0)
        gain = (step - learnt) / np.where(np.abs(along) < 1e-300, np.inf, along)
        inverse = inverse + gain[:, None] * np.sum(step[:, None] * inverse, axis=0)
        missed = now
    return slopes[0], slopes[1], np.abs(missed).max(axis=0) < AIMED


def _times(matrix, vector):
    """Of 2 x 2 matrices and vectors, one for each ray."""
    return np.sum(matrix * vector, axis=1)
