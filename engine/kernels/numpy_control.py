"""A regression around each pixel in numpy: for machines without a library, and as the reference of tests."""

from collections.abc import Sequence

import numpy as np
import scipy

from .declarations import NUMBERS

WINDOW_PX = NUMBERS["WINDOW_PX"]


def numpy_control(halves: Sequence[np.ndarray], control_halves: Sequence[np.ndarray], control_rest: np.ndarray,
                  scale: np.ndarray, ratios: np.ndarray, weight: float | np.ndarray, ridge: float, least_ridge: float
                  ) -> tuple[np.ndarray, np.ndarray]:
    """As `kernels.control.control`."""
    picture, control = ((one + other) / 2 for one, other in (halves, control_halves))
    gains = _gains(np.nan_to_num(picture * scale, posinf=0.0, neginf=0.0),
                   np.nan_to_num(control * scale, posinf=0.0, neginf=0.0), ratios, ridge, least_ridge)
    return (picture + _combined(gains, weight * (control_rest - control)),
            halves[0] - halves[1] - _combined(gains, control_halves[0] - control_halves[1]))


def _combined(gains, control):
    """Linear combinations of the control's channels: array (channel, row, column)."""
    return np.einsum("icyx,iyx->cyx", gains, control)


def _gains(picture, control, ratios, ridge, least_ridge):
    """Gains by which channels of the control, added up, predict the picture: array (control channel, channel, row,
    column)."""
    normal = _neighbours_mean(control[:, None] * control)
    right = _neighbours_mean(control[:, None] * picture)
    channels = range(len(control))
    added = ridge * sum(normal[one, one] for one in channels) / len(channels) + np.float32(least_ridge)
    for one in channels:
        normal[one, one] += added
        right[one, one] += added * ratios[one]
    return _solve(normal, right)


def _neighbours_mean(planes):
    """Means of planes (..., row, column) over square windows without their middle; 0 outside the planes."""
    return window_mean(planes) - planes / WINDOW_PX**2


def window_mean(planes: np.ndarray) -> np.ndarray:
    """Means of planes (..., row, column) over square windows; 0 outside the planes."""
    for axis in (-2, -1):
        planes = scipy.ndimage.uniform_filter1d(planes, WINDOW_PX, axis=axis, mode="constant")
    return planes


def _solve(normal, right):
    """Solve positive definite systems (equation, unknown, ...) for right sides (equation, side, ...), in place."""
    count = len(normal)
    for one in range(count):
        for other in range(one + 1, count):
            factor = normal[other, one] / normal[one, one]
            normal[other, one:] -= factor * normal[one, one:]
            right[other] -= factor * right[one]
    for one in reversed(range(count)):
        for other in range(one + 1, count):
            right[one] -= normal[one, other] * right[other]
        right[one] /= normal[one, one]
    return right
