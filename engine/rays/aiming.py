"""Ray aiming: slopes at points of the stop for rays that come from an object point, or go to an image point.

Rays start on the stop rather than on the object, so every ray reaches the front of a wide-angle lens. The two unknown
slopes are solved for all rays at once by Broyden's method (Mathematics of Computation 19, 577, 1965).
"""

from collections.abc import Callable, Sequence

import numpy as np

from ..kernels import tracing
from ..kernels.library import NUMPY, running
from ..prescription.system import System
from .trace import start_on_stop, trace_both_ways, trace_to_image, trace_to_object, traced_surfaces

SLOPES = np.linspace(0, 3.0, 401)  # at the stop, searched for chief rays
NEWTON_STEPS = 4  # for chief rays, from a good first guess
SLOPE_STEP = 1e-6  # for derivatives with respect to slope
PLACE_STEP = 1e-3  # and with respect to position, in semi-apertures of the stop
STEPS = 16
LONGEST_STEP = 0.2  # in slope
CONVERGED, AIMED = 2e-12, 1e-10  # error at the object point; for the second, as an angle


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
        Points of the stop.

    Returns
    -------
    slope_x, slope_y : arrays (wavelength, field, ray)
    aimed : bool array (wavelength, field, ray)
        Rays that do come from the object point.
    """
    kind = tracing.ANGLE if system.object_at_infinity else tracing.OBJECT_HEIGHT
    return _aimed(system, indices, kind, _fields_reached(system, indices), fields, x_mm, y_mm)


def aim_at_image(system: System, indices: np.ndarray, heights_mm: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `aim`, for rays to points of the image plane at heights along +y: array (height,)."""
    return _aimed(system, indices, tracing.IMAGE_HEIGHT, _heights_reached_mm(system, indices), heights_mm, x_mm, y_mm)


def farthest_aim_mm(system: System, indices: np.ndarray) -> float:
    """The largest image height that `aim_at_image` finds at all wavelengths: just inside the fold of a field that folds
    back, where a chief ray's height changes too little with its slope."""
    heights_mm = _heights_reached_mm(system, indices)
    return float(min(reached[_before_fold(reached) - 1] for reached in heights_mm))


def _before_fold(reached):
    """The number of slopes up to where the field folds back."""
    rises = np.diff(reached) > 0
    return reached.size if rises.all() else int(np.argmin(rises)) + 1


def _aimed(system, indices, kind, reached, targets, x_mm, y_mm):
    """Slopes of rays to targets of a kind, and whether they reach them. Chief rays come first, interpolated between
    `_slopes`."""
    search = _search if running() == NUMPY else _compiled_search
    with np.errstate(all="ignore"):  # one wavelength at a time fits in the processor's cache
        guesses = [_first_guess(slopes, places, np.abs(targets))
                   for slopes, places in zip(_slopes(system, indices), reached, strict=True)]
        found = np.stack([search(system, media, kind, targets, guess, x_mm, y_mm)
                          for media, guess in zip(indices.T, guesses, strict=True)], axis=1)
        return found[0], found[1], found[2] < AIMED * _per_angle(system, kind, targets)[:, None]


def _per_angle(system, kind, targets):
    """The error at object points for a ray's error in angle, which grows with the square of their distance from the
    pinhole; 1 for other targets: array (target,)."""
    if kind != tracing.OBJECT_HEIGHT:
        return np.ones_like(targets)
    return 1 + (targets / system.prescription.object_distance_mm)**2


def _compiled_search(system, indices, kind, targets, guess, x_mm, y_mm):
    along = [np.cos(targets), np.sin(targets)] if kind == tracing.ANGLE else [targets, np.zeros_like(targets)]
    scale = system.efl_mm if kind == tracing.IMAGE_HEIGHT else system.prescription.object_distance_mm
    return tracing.aim(traced_surfaces(system.prescription), indices, kind, scale, np.stack(along), guess,
                       np.stack([x_mm, y_mm]), PLACE_STEP * system.stop_semi_aperture_mm)


def _search(system, indices, kind, targets, guess, x_mm, y_mm):
    """As `kernels.tracing.aim`, in numpy; the reference for its tests."""
    def missed(*rays):
        return (_miss_image if kind == tracing.IMAGE_HEIGHT else _miss)(system, indices, *rays)

    chief = guess[:, None]
    for _ in range(NEWTON_STEPS):
        here, ahead = (missed(targets[:, None], 0.0, 0.0, 0.0, slope)[1] for slope in (chief, chief + SLOPE_STEP))
        chief = chief - here * SLOPE_STEP / (ahead - here)
    return _broyden(missed, targets[:, None], x_mm, y_mm, chief, PLACE_STEP * system.stop_semi_aperture_mm)


def _slopes(system, indices):
    """`SLOPES` with the sign that fields of positive heights have at the stop: array (wavelength, slope)."""
    return np.multiply.outer(np.sign(indices[system.prescription.stop_index]), SLOPES)


def _first_guess(slopes, reached, targets):
    """Slopes of chief rays by interpolation, up to where the field folds back; NaN beyond."""
    last = _before_fold(reached)
    return np.interp(targets, reached[:last], slopes[:last], right=np.nan)


def _fields_reached(system, indices):
    """Fields of chief rays with `_slopes`: angles in radians or object heights in mm, array (wavelength, slope)."""
    with np.errstate(all="ignore"):
        chief = trace_both_ways(system.prescription, indices[:, :, None], 0.0, 0.0, 0.0, _slopes(system, indices))
        if system.object_at_infinity:
            return np.arctan2(chief.before[1], chief.before[2])
        back_mm = (system.prescription.object_distance_mm + chief.entry[2]) / chief.before[2]
        return back_mm * chief.before[1] - chief.entry[1]


def _heights_reached_mm(system, indices):
    """Image heights of chief rays with `_slopes`: array (wavelength, slope)."""
    with np.errstate(all="ignore"):
        slopes = _slopes(system, indices)
        return trace_both_ways(system.prescription, indices[:, :, None], 0.0, 0.0, 0.0, slopes).position[1]


def _miss(system, indices, fields, x_mm, y_mm, slope_x, slope_y):
    """Errors of rays at their object points, as angles along x and y: array (2, ...)."""
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
    """Errors of rays at their image points, in focal lengths along x and y: array (2, ...)."""
    on_stop = start_on_stop(system.prescription, x_mm, y_mm, slope_x, slope_y)
    x, y = trace_to_image(system.prescription, indices, *on_stop)[0][:2]
    return np.stack(np.broadcast_arrays(x, y - heights_mm)) / system.efl_mm


def _broyden(miss, targets, x_mm, y_mm, chief, step_mm):
    """Slopes (x, y) at which `miss` vanishes, and the largest error: array (3, field, ray)."""
    middle = miss(targets, 0.0, 0.0, 0.0, chief)
    by_slope_x = (miss(targets, 0.0, 0.0, SLOPE_STEP, chief) - middle)[0] / SLOPE_STEP
    by_slope_y = (miss(targets, 0.0, 0.0, 0.0, chief + SLOPE_STEP) - middle)[1] / SLOPE_STEP
    by_x = (miss(targets, step_mm, 0.0, 0.0, chief) - middle)[0] / step_mm
    by_y = (miss(targets, 0.0, step_mm, 0.0, chief) - middle)[1] / step_mm
    guess = np.stack(np.broadcast_arrays(-x_mm * by_x / by_slope_x, chief - y_mm * by_y / by_slope_y))
    zero = np.zeros_like(guess[0])
    inverse = np.array([[1 / by_slope_x + zero, zero], [zero, 1 / by_slope_y + zero]])  # of the Jacobian
    rays = (np.broadcast_to(each, zero.shape).ravel() for each in (targets, x_mm, y_mm))
    slopes, error = broyden_steps(miss, tuple(rays), guess.reshape(2, -1), inverse.reshape(2, 2, -1))
    return np.stack([*slopes, error]).reshape(3, *zero.shape)


def broyden_steps(miss: Callable[..., np.ndarray], rays: Sequence[np.ndarray], slopes: np.ndarray, inverse: np.ndarray
                  ) -> tuple[np.ndarray, np.ndarray]:
    """Solve two equations per ray by Broyden's method. Each ray iterates until it converges.

    Parameters
    ----------
    miss : function (*rays, x, y)
        Residual, array (2, ray), of the parameters `rays` and the unknowns x and y.
    rays : sequence of arrays (ray,)
    slopes : array (2, ray)
        First guess of the unknowns.
    inverse : array (2, 2, ray)
        Estimate of the inverse Jacobian.

    Returns
    -------
    slopes : array (2, ray)
    error : array (ray,)
        Largest absolute residual.
    """
    slopes, active, here = slopes.copy(), np.arange(slopes.shape[1]), slopes
    missed = miss(*rays, *here)
    error = np.abs(missed).max(axis=0)
    for _ in range(STEPS):
        far = error[active] > CONVERGED
        if not far.any():
            break
        active, rays, here = active[far], [each[far] for each in rays], here[:, far]
        missed, inverse = missed[:, far], inverse[..., far]
        step = -_times(inverse, missed)
        step *= np.minimum(1, LONGEST_STEP / np.maximum(np.hypot(*step), 1e-30))
        here = here + step
        missed_next = miss(*rays, *here)
        change = _times(inverse, missed_next - missed)
        along = np.sum(step * change, axis=0)
        gain = (step - change) / np.where(np.abs(along) < 1e-300, np.inf, along)
        inverse = inverse + gain[:, None] * np.sum(step[:, None] * inverse, axis=0)
        missed = missed_next
        slopes[:, active], error[active] = here, np.abs(missed).max(axis=0)
    return slopes, error


def _times(matrix, vector):
    """Products of 2 x 2 matrices and vectors, one per ray."""
    return np.sum(matrix * vector, axis=1)
