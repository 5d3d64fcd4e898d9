"""Sharpening: undo the softening of a lens image by the parts of pixels in which it is computed.

Light of a known distribution inside pixels is a mean over parts, is resampled to the parts of the sensor's pixels, and
shines evenly from these. All of this softens a picture by known amounts, which sharpening subtracts.
"""

from collections.abc import Callable

import numpy as np

from ..runtime.threads import in_bands

OF_PARTS = 1 / 6  # variance, in parts of a pixel squared: a mean over a part, and light that is even inside one
MORE = 1.15  # times the variance, because details lose more contrast than it states
STRIP = 128  # rows or columns that are sharpened together, in the processor's cache

Variance = Callable[[int, np.ndarray, np.ndarray], np.ndarray | float]


def resampling_variance(shift: np.ndarray) -> np.ndarray:
    """The variance that resampling to pixels of the same size adds, for their shift along an axis: in pixels squared.

    A shift by a whole number of pixels adds none. Otherwise a pixel is the mean of two.
    """
    fraction = shift % 1
    return fraction * (1 - fraction)


def sharpening_gain(times: int, supersampling: int) -> float:
    """The contrast that sharpening restores at the Nyquist frequency of pixels, along an axis, for mean shifts.

    Light is known in `times` x `times` parts of a pixel, and the picture is computed in `supersampling` x
    `supersampling` parts.
    """
    return 1 + MORE * parts_variance(supersampling / times) * (1 - np.cos(np.pi / supersampling))


def parts_variance(known: float) -> float:
    """The mean variance by parts of pixels in which light is known, of this width, and by those of width 1 in which the
    picture is computed."""
    return OF_PARTS * (1 + known**2)


def sharpen(picture: np.ndarray, variance: Variance) -> None:
    """Subtract a variance from a picture's blur along both axes, in place, by moving light to brighter neighbours.

    No pixel gives more than its light, and a pair of pixels moves no more than the differences to the next pixels on
    both sides. So light stays positive, and sharp edges get no rims.

    Parameters
    ----------
    picture : float32 array (row, column)
    variance : callable (axis, rows, columns) -> array (row, column) or float
        The variance along an axis at these rows and columns, which may have fractions: in pixels squared.
    """
    for axis in (0, 1):
        def work(band, axis=axis):
            lines = (picture[:, band].T, picture[band])[axis]
            across, along = np.arange(band.start, band.stop), np.arange(lines.shape[1] - 1) + 0.5
            removed = variance(axis, *((along, across), (across, along))[axis])
            _sharpen_lines(lines, MORE / 2 * (removed if np.ndim(removed) == 0 or axis else removed.T))

        in_bands(work, picture.shape[1 - axis], STRIP)


def _sharpen_lines(lines, share):
    """Move this share of the differences between neighbours in lines, in place, within the limits."""
    rise = np.diff(lines)
    up = np.sign(rise)
    moved = (share * np.abs(rise)).astype(lines.dtype, copy=False)
    np.minimum(moved[:, 1:], rise[:, :-1] * up[:, 1:], out=moved[:, 1:])
    np.minimum(moved[:, :-1], rise[:, 1:] * up[:, :-1], out=moved[:, :-1])
    np.maximum(moved, 0, out=moved)
    darker = np.minimum(lines[:, 1:], lines[:, :-1])
    np.minimum(moved, np.abs(darker, out=darker) / 2, out=moved)
    np.copysign(moved, rise, out=moved)
    lines[:, :-1] -= moved
    lines[:, 1:] += moved
