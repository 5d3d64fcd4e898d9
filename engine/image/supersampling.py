"""Supersampling: pictures in finer pixels, for PSFs finer than the pixels.

A pixel of a capture is the mean radiance of a square, without any detail, so all its parts get the same value. Any
smoother interpolation would move light into its neighbours, and a single bright pixel would become too wide.
"""

import numpy as np


def split_pixels(picture: np.ndarray, times: int) -> np.ndarray:
    """A picture (row, column) with each pixel split into `times` x `times` pixels of the same value."""
    rows, columns = picture.shape
    parts = np.broadcast_to(picture[:, None, :, None], (rows, times, columns, times))
    return parts.reshape(rows * times, columns * times)


def softening_px(times: int, supersampling: int, gain: float = 1.0) -> float:
    """The softening of a lens image by its pixels, beyond the lens and the pixel's own aperture: the standard deviation
    of a Gaussian blur, in pixels, that leaves as much contrast at the pixels' Nyquist frequency along an axis.

    Light is known in `times` x `times` parts of a pixel, and blurred in `supersampling` x `supersampling` parts. A
    known part is a mean over its area, and counts as constant there; a blurred part is a mean, too, and shines evenly
    from its area. Each of these four is a blur by a box. Where the lens leaves pixels in place, as on the axis, there
    is less. Sharpening then multiplies the contrast by `gain`.
    """
    contrast = gain * (np.sinc(0.5 / times) * np.sinc(0.5 / supersampling))**2
    return float(np.sqrt(max(0.0, -2 * np.log(contrast))) / np.pi)


def merge_pixels(picture: np.ndarray, times: int) -> np.ndarray:
    """Means of blocks of `times` x `times` pixels, as a sensor's pixel averages: the inverse of `split_pixels`."""
    if times == 1:
        return picture
    rows, columns = (n // times for n in picture.shape)
    return picture.reshape(rows, times, columns, times).mean(axis=(1, 3), dtype=np.float64)


def merge_columns(planes: np.ndarray, times: int) -> np.ndarray:
    """Means of `times` adjacent columns of planes (..., row, column), in their precision."""
    if times == 1:
        return planes
    return sum(planes[..., first::times] for first in range(times)) * planes.dtype.type(1 / times)
