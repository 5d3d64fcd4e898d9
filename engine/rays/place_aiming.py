"""Ray aiming for lenses without rotational symmetry: slopes at points of the stop for rays to places on the sensor.

Chief rays start along the axis and follow their place outwards in small steps, so that they stay on the sheet of the
field that begins on the axis. The other rays start from a chief ray and its derivatives.
"""

import numpy as np

from ..prescription.system import System
from .aiming import AIMED, PLACE_STEP, SLOPE_STEP, broyden_steps
from .trace import trace_both_ways

OUTWARDS = np.linspace(0, 1, 13)[1:]  # shares of a place's distance


def aim_at_places(system: System, indices: np.ndarray, places_mm: np.ndarray, x_mm: np.ndarray, y_mm: np.ndarray
                  ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slopes at the stop of rays to places of the image plane.

    Parameters
    ----------
    system : System
    indices : array (surface + 1, wavelength)
    places_mm : array (2, place)
        x and y, in the image as formed by the lens.
    x_mm, y_mm : arrays (ray,)
        Points of the stop.

    Returns
    -------
    slope_x, slope_y : arrays (wavelength, place, ray)
    aimed : bool array (wavelength, place, ray)
        Rays that do reach the place.
    """
    with np.errstate(all="ignore"):
        found = np.stack([_aimed(system, media[:, None], places_mm, np.stack([x_mm, y_mm])) for media in indices.T],
                         axis=1)
    return found[0], found[1], found[2] < AIMED


def _aimed(system, media, places_mm, stop_mm):
    """Slopes (x, y) at a wavelength, and the largest error: array (3, place, ray)."""
    def missed(to_x, to_y, x_mm, y_mm, slope_x, slope_y):
        landed = trace_both_ways(system.prescription, media[:, :, None], x_mm[None], y_mm[None], slope_x[None],
                                 slope_y[None]).position[:2, 0]
        return (landed - np.stack([to_x, to_y])) / system.efl_mm

    chief = _chief_slopes(missed, places_mm)
    by_slope, by_stop = _derivatives(missed, places_mm, chief, PLACE_STEP * system.stop_semi_aperture_mm)
    inverse = np.linalg.inv(_finite(by_slope)).transpose(1, 2, 0)
    moved = np.einsum("ijp,pjk,kr->ipr", inverse, _finite(by_stop), stop_mm)
    (_, places), rays = places_mm.shape, stop_mm.shape[1]
    guess = (chief[:, :, None] - moved).reshape(2, -1)
    slopes, error = broyden_steps(missed, (*places_mm.repeat(rays, axis=1), *np.tile(stop_mm, places)), guess,
                                  inverse.repeat(rays, axis=2))
    return np.stack([*slopes, error]).reshape(3, places, rays)


def _chief_slopes(missed, places_mm):
    """Slopes of the chief rays of places: array (2, place), NaN where none is found."""
    before = slopes = np.zeros_like(places_mm)
    zero = np.zeros_like(places_mm[0])
    for share in OUTWARDS:
        by_slope, _ = _derivatives(missed, share * places_mm, slopes, 1.0)
        inverse = np.linalg.inv(_finite(by_slope)).transpose(1, 2, 0)
        found, error = broyden_steps(missed, (*share * places_mm, zero, zero), 2 * slopes - before, inverse)
        before, slopes = slopes, np.where(error < AIMED, found, np.nan)
    return slopes


def _derivatives(missed, places_mm, chief, step_mm):
    """Derivatives of the error with respect to slopes, and to points of the stop: arrays (place, 2, 2)."""
    here = np.concatenate([np.zeros_like(chief), chief])
    middle, derivatives = missed(*places_mm, *here), []
    for coordinate, step in ((2, SLOPE_STEP), (3, SLOPE_STEP), (0, step_mm), (1, step_mm)):
        ahead = here.copy()
        ahead[coordinate] += step
        derivatives.append((missed(*places_mm, *ahead) - middle) / step)
    columns = np.stack(derivatives).transpose(2, 1, 0)
    return columns[..., :2], columns[..., 2:]


def _finite(matrices):
    """Matrices with lost ones replaced by the identity, which leaves their rays lost."""
    lost = ~np.isfinite(matrices).all(axis=(1, 2), keepdims=True)
    return np.where(lost, np.eye(2), matrices)
