"""From places on the picture back to directions: the inverse of a camera model.

The search walks from the axis outwards along the line to each place, so it cannot end on the far side of a fold, where
a polynomial returns to places that it has met before.
"""

from typing import NamedTuple

import numpy as np

from ..calibration.models import Model

STEPS, REACH = 16, 1.25  # of the walk to a place, and beyond it
NEWTON_STEPS, HALVINGS, SLOPE_STEP = 6, 25, 1e-6
CONVERGED = 1e-9
LONGEST_STEP = 3.0  # relative to the predicted one: a longer one would lead across a fold
LEAST_SLOPE = 0.2  # of places over tangents, relative to the axis: soon after, a polynomial turns back
MOST_ANGLE_DEG = 80.0  # a plane shows wider fields hardly at all
SMOOTH_ANGLE_DEG = 84.0  # up to which tangents follow the model, for splines through them


class Straight(NamedTuple):
    """Where light comes from.

    Attributes
    ----------
    tangents : array (place, 2)
        Of the angles to the axis, to the right and downwards; continued beyond the end of the field.
    end : array (place,)
        Distance from the axis at which the field ends towards a place, relative to the place: 1 or more inside it, up
        to 1.25.
    """

    tangents: np.ndarray
    end: np.ndarray


def straight_places(model: Model, coefficients: tuple[float, ...], places: np.ndarray,
                    steps: int = STEPS) -> Straight:
    """The directions of the light that a model places on the plane at unit distance.

    Parameters
    ----------
    model : Model
    coefficients : tuple of float
    places : array (place, 2)
    steps : int
        To walk in, a multiple of 4: few for a model without folds.
    """
    walk = _Walk(model, np.array(coefficients), np.asarray(places, float), steps)
    tangents, end = walk.to_end(SMOOTH_ANGLE_DEG)
    return Straight(tangents, walk.to_end(MOST_ANGLE_DEG)[1] if model.fisheye else end)


class _Walk:
    """Solutions of a model for shares of the way from the axis to places."""

    def __init__(self, model, coefficients, places, steps):
        self._model, self._coefficients, self.places = model, coefficients, places
        self._shares = np.arange(1, round(REACH * steps) + 1) / steps
        self._origin = self._placed(np.zeros((1, 2)))
        self._axis = self._slopes(np.zeros((1, 2)))[0]

    def to_end(self, most_angle_deg):
        """Tangents of all places, and the share of their way at which the field ends, by its angle or by a fold."""
        at, end = np.zeros_like(self.places), np.zeros(len(self.places))
        slope = _solved(np.repeat(self._axis[None], len(end), axis=0), self.places - self._origin)
        on, solved = np.ones(len(end), bool), np.zeros_like(at)
        for share in self._shares:
            on[on] = self._step(np.flatnonzero(on), share, most_angle_deg, at, slope, end)
            if share == 1:
                solved[on] = at[on]
        width = self._shares[0]
        for _ in range(HALVINGS):
            width /= 2
            self._step(np.flatnonzero(~on), (end + width)[~on], most_angle_deg, at, slope, end)
        fisheye, beyond = self._model.fisheye, (end < 1)[:, None]
        tangents = _tangents(np.where(beyond, at, solved), fisheye)
        outwards = (_tangents(at + SLOPE_STEP * slope, fisheye) - tangents) / SLOPE_STEP
        return tangents + np.where(beyond, outwards * (1 - end[:, None]), 0), end

    def _step(self, which, share, most_angle_deg, at, slope, end):
        """Move the solutions of some places to a share of their way if the model leads there; whether it does."""
        share = np.broadcast_to(share, len(which))[:, None]
        way = self.places[which] - self._origin
        step = slope[which] * (share - end[which, None])
        trial = at[which] + step
        for _ in range(NEWTON_STEPS):
            slopes = self._slopes(trial)
            missing = self._origin + share * way - self._placed(trial)
            trial = trial + _solved(slopes, missing)
            near = np.abs(missing).max(axis=1) <= CONVERGED * (1 + np.abs(way).max(axis=1))
            if near.all():
                break
        short = np.hypot(*(trial - at[which]).T) <= LONGEST_STEP * np.hypot(*step.T)
        good = near & short & (self._least_slope(slopes) > LEAST_SLOPE) & (
            _angles_deg(trial, self._model.fisheye) <= most_angle_deg)
        reached = which[good]
        at[reached], slope[reached], end[reached] = trial[good], _solved(slopes, way)[good], share[good, 0]
        return good

    def _least_slope(self, slopes):
        """The smallest slope in any direction, relative to the axis; 0 or less on the far side of a fold."""
        relative = slopes @ np.linalg.inv(self._axis)
        return np.sign(np.linalg.det(relative)) * np.linalg.norm(relative, ord=-2, axis=(1, 2))

    def _placed(self, at):
        return self._model.place(directions(at, self._model.fisheye), self._coefficients)

    def _slopes(self, at):
        """Derivatives of places with respect to both coordinates: array (place, 2, 2)."""
        columns = [(self._placed(at + step) - self._placed(at - step)) / (2 * SLOPE_STEP)
                   for step in SLOPE_STEP * np.eye(2)]
        return np.stack(columns, axis=-1)


def directions(at: np.ndarray, angles: bool) -> np.ndarray:
    """Directions (..., 3), x to the right, y downwards, z forwards, of tangents, or of angles from the axis in
    radians: arrays (..., 2)."""
    if not angles:
        return np.concatenate([at, np.ones((*at.shape[:-1], 1))], axis=-1)
    angle = np.hypot(at[..., 0], at[..., 1])[..., None]
    return np.concatenate([at * np.sinc(angle / np.pi), np.cos(angle)], axis=-1)


def _tangents(at, angles):
    if not angles:
        return at
    angle = np.hypot(at[:, 0], at[:, 1])[:, None]
    return at * np.where(angle > 0, np.tan(angle) / np.where(angle > 0, angle, 1), 1)


def _angles_deg(at, angles):
    distance = np.hypot(at[:, 0], at[:, 1])
    return np.degrees(distance if angles else np.arctan(distance))


def _solved(slopes, wanted):
    """Steps that change places as wanted; none where slopes are singular."""
    (a, b), (c, d) = np.moveaxis(slopes, 0, -1)
    determinant = a * d - b * c
    safe = np.where(np.abs(determinant) > 1e-12, determinant, np.inf)
    return np.stack([d * wanted[:, 0] - b * wanted[:, 1], a * wanted[:, 1] - c * wanted[:, 0]], axis=-1) / safe[:, None]
