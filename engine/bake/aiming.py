"""Aiming: which way rays cross a place of the stop so that they come from an object point, or go to an image point.

Rays begin on the stop and not on the object: so none misses the front of a wide lens on its way to the stop. Two
slopes are unknown, and found for all rays at once by Broyden's method (Mathematics of Computation 19, 577, 1965).
"""

from collections.abc import Callable, Sequence

import numpy as np

from .system import System
from .trace import start_on_stop, trace_to_image, trace_to_object

SLOPES = np.linspace(0, 3.0, 401)  # at the stop, among which chief rays are looked for
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
    return _aimed(system, indices, _miss, _fields_reached(system, indices), fields, x_mm, y_mm)


def aim_at_image(system: System, indices: np.ndarray, heights_mm: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `aim`, of rays to places of the image plane: so high on the side of +y, array (height,)."""
    return _aimed(system, indices, _miss_image, _heights_reached_mm(system, indices), heights_mm, x_mm, y_mm)


def _aimed(system, indices, miss, reached, wanted, x_mm, y_mm):
    """Slopes at which `miss` vanishes, and where it does: of chief rays first, by what those of `SLOPES` reach."""
    def of_wavelength(indices, reached):
        def missed(*rays):
            return miss(system, indices, *rays)

        chief = _first_guess(reached, np.abs(wanted))[:, None]
        for _ in range(NEWTON_STEPS):
            here, there = (missed(wanted[:, None], 0.0, 0.0, 0.0, slope)[1] for slope in (chief, chief + SLOPE_STEP))
            chief = chief - here * SLOPE_STEP / (there - here)
        return _broyden(missed, wanted[:, None], x_mm, y_mm, chief, PLACE_STEP * system.stop_semi_aperture_mm)

    with np.errstate(all="ignore"):  # a wavelength after another: processors hold as much at hand
        return tuple(map(np.stack, zip(*map(of_wavelength, indices.T, reached), strict=True)))


def _first_guess(reached, wanted):
    """Slopes of chief rays, from what those of `SLOPES` reach before that folds back; NaN where none does."""
    rises = np.diff(reached) > 0
    last = SLOPES.size if rises.all() else int(np.argmin(rises)) + 1
    return np.interp(wanted, reached[:last], SLOPES[:last], right=np.nan)


def _fields_reached(system, indices):
    """Where chief rays of `SLOPES` come from: angles in radians, or object heights in mm, array (wavelength, slope)."""
    on_stop = start_on_stop(system.prescription, 0.0, 0.0, 0.0, SLOPES[None])
    with np.errstate(all="ignore"):
        position, direction, _, _ = trace_to_object(system.prescription, indices[:, :, None], *on_stop)
        if system.object_at_infinity:
            fields = np.arctan2(direction[1], direction[2])
        else:
            back_mm = (system.prescription.object_distance_mm + position[2]) / direction[2]
            fields = back_mm * direction[1] - position[1]
    return np.broadcast_to(fields, (indices.shape[1], SLOPES.size))


def _heights_reached_mm(system, indices):
    """Where chief rays of `SLOPES` land: array (wavelength, slope)."""
    with np.errstate(all="ignore"):
        return trace_to_image(system.prescription, indices[:, :, None],
                              *start_on_stop(system.prescription, 0.0, 0.0, 0.0, SLOPES[None]))[0][1]


def _miss(system, indices, fields, x_mm, y_mm, slope_x, slope_y):
    """By how much rays miss object points, as angles along x and y: array (2, ...)."""
    position, direction = start_on_stop(system.prescription, x_mm, y_mm, slope_x, slope_y)
    position, direction, _, _ = trace_to_object(system.prescription, indices, position, direction)
    if system.object_at_infinity:
        return np.stack(np.broadcast_arrays(
            direction[0], direction[1] * np.cos(fields) - direction[2] * np.sin(fields)))
    distance_mm = system.prescription.object_distance_mm
    back_mm = (distance_mm + position[2]) / direction[2]
    x, y = position[:2] - back_mm * direction[:2]
    return np.stack(np.broadcast_arrays(x, y - fields)) / -distance_mm


def _miss_image(system, indices, heights_mm, x_mm, y_mm, slope_x, slope_y):
    """By how much rays miss image points, in focal lengths along x and y: array (2, ...)."""
    on_stop = start_on_stop(system.prescription, x_mm, y_mm, slope_x, slope_y)
    x, y = trace_to_image(system.prescription, indices, *on_stop)[0][:2]
    return np.stack(np.broadcast_arrays(x, y - heights_mm)) / system.efl_mm


def _broyden(miss, wanted, x_mm, y_mm, chief, step_mm):
    """Slopes (x, y) at which `miss` vanishes, and where it does: arrays (field, ray). Rays step until theirs does."""
    middle = miss(wanted, 0.0, 0.0, 0.0, chief)
    by_slope_x = (miss(wanted, 0.0, 0.0, SLOPE_STEP, chief) - middle)[0] / SLOPE_STEP
    by_slope_y = (miss(wanted, 0.0, 0.0, 0.0, chief + SLOPE_STEP) - middle)[1] / SLOPE_STEP
    by_x = (miss(wanted, step_mm, 0.0, 0.0, chief) - middle)[0] / step_mm
    by_y = (miss(wanted, 0.0, step_mm, 0.0, chief) - middle)[1] / step_mm
    guess = np.stack(np.broadcast_arrays(-x_mm * by_x / by_slope_x, chief - y_mm * by_y / by_slope_y))
    zero = np.zeros_like(guess[0])
    inverse = np.array([[1 / by_slope_x + zero, zero], [zero, 1 / by_slope_y + zero]])  # of the Jacobian
    rays = (np.broadcast_to(each, zero.shape).ravel() for each in (wanted, x_mm, y_mm))
    slopes, off = broyden_steps(miss, tuple(rays), guess.reshape(2, -1), inverse.reshape(2, 2, -1))
    return *slopes.reshape(guess.shape), (off < AIMED).reshape(zero.shape)


def broyden_steps(miss: Callable[..., np.ndarray], rays: Sequence[np.ndarray], slopes: np.ndarray, inverse: np.ndarray
                  ) -> tuple[np.ndarray, np.ndarray]:
    """Slopes, or what else is looked for, after Broyden's steps from these, each ray's for as long as it needs.

    Parameters
    ----------
    miss : function (*rays, x, y)
        What is to vanish: array (2, ray), of `rays` and of what is looked for.
    rays : sequence of arrays (ray,)
    slopes : array (2, ray)
    inverse : array (2, 2, ray)
        Of the Jacobian, as far as known.

    Returns
    -------
    slopes : array (2, ray)
    off : array (ray,)
        What they miss by yet.
    """
    slopes, going, here = slopes.copy(), np.arange(slopes.shape[1]), slopes
    missed = miss(*rays, *here)
    off = np.abs(missed).max(axis=0)
    for _ in range(STEPS):
        far = off[going] > CONVERGED
        if not far.any():
            break
        going, rays, here = going[far], [each[far] for each in rays], here[:, far]
        missed, inverse = missed[:, far], inverse[..., far]
        step = -_times(inverse, missed)
        step *= np.minimum(1, LONGEST_STEP / np.maximum(np.hypot(*step), 1e-30))
        here = here + step
        now = miss(*rays, *here)
        learnt = _times(inverse, now - missed)
        along = np.sum(step * learnt, axis=0)
        gain = (step - learnt) / np.where(np.abs(along) < 1e-300, np.inf, along)
        inverse = inverse + gain[:, None] * np.sum(step[:, None] * inverse, axis=0)
        missed = now
        slopes[:, going], off[going] = here, np.abs(missed).max(axis=0)
    return slopes, off


def _times(matrix, vector):
    """Of 2 x 2 matrices and vectors, one for each ray."""
    return np.sum(matrix * vector, axis=1)
