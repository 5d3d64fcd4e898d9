"""Supersampling: pictures in finer pixels, where PSFs are finer than the pixels are.

A pixel of a capture is the mean radiance of a square, and nothing more is known of it: so its parts are alike. Anything
smoother than that would carry light into its neighbours, and a single bright pixel would look wider than it is.
"""

import numpy as np


def split_pixels(picture: np.ndarray, times: int) -> np.ndarray:
    """A picture (row, column) with so many pixels across and down for each one, all of its value."""
    rows, columns = picture.shape
    parts = np.broadcast_to(picture[:, None, :, None], (rows, times, columns, times))
    return parts.reshape(rows * times, columns * times)


def merge_pixels(picture: np.ndarray, times: int) -> np.ndarray:
    """The means of so many pixels across and down: the inverse of `split_pixels`, as a sensor's pixel sums them up."""
    if times == 1:
        return picture
    rows, columns = (n // times for n in picture.shape)
    return picture.reshape(rows, times, columns, times).mean(axis=(1, 3), dtype=np.float64)
