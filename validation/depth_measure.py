"""Errors of noisy pictures against a noisy reference, corrected for noise: pictures are arrays (seed, row, column)."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

LAMPS, REACH_PX = 4.0, 13  # brightness of lamps relative to the mean, and side of the square that each occupies
EDGES = 0.2  # fraction of the other pixels that counts as edges: those with the steepest slopes


@dataclass(frozen=True)
class Errors:
    """Relative errors: L1 divided by the mean of the truth, L2 divided by its root mean square.

    Attributes
    ----------
    l1_bias, l2_bias : float
        Without noise.
    l1, l2 : float
        Of one picture, including its noise.
    """

    l1_bias: float
    l2_bias: float
    l1: float
    l2: float


def errors(pictures, truths, where=...):
    """The Errors of pictures, within a mask if one is given.

    The noise of means is estimated from the differences of seeds. It is subtracted exactly from squares, and from
    absolute values as if it were Gaussian.
    """
    pictures, truths = pictures[:, where], truths[:, where]
    truth, mean = truths.mean(axis=0), pictures.mean(axis=0)
    noise2 = variance_of_mean(truths)
    square = np.mean(truth**2 - noise2)
    bias2 = np.mean((mean - truth)**2 - variance_of_mean(pictures) - noise2)
    one2 = bias2 + np.mean(pictures.var(axis=0, ddof=1))
    noise1 = np.abs(halves(truths)).mean()
    bias1 = np.abs(mean - truth).mean()**2 - np.abs(halves(pictures)).mean()**2 - noise1**2
    one1 = np.mean([np.abs(picture - truth).mean()**2 for picture in pictures]) - noise1**2
    return Errors(*(float(root(each) / scale) for each, scale in (
        (bias1, truth.mean()), (bias2, np.sqrt(square)), (one1, truth.mean()), (one2, np.sqrt(square)))))


def variance_of_mean(pictures):
    return pictures.var(axis=0, ddof=1) / len(pictures)


def halves(pictures):
    """Half the difference between the means of both halves of the seeds, with the same noise as the mean of all."""
    count = len(pictures) // 2
    return (pictures[:count].mean(axis=0) - pictures[count:2 * count].mean(axis=0)) / 2


def root(square):
    """The square root; for a square that is negative because of noise, minus the root of its absolute value."""
    return np.sign(square) * np.sqrt(np.abs(square))


def lamps_of(truth):
    """Mask (row, column) of lamps and glints, including the rims of their blur."""
    return maximum_filter(truth > LAMPS * truth.mean(), REACH_PX)


def edges_of(truth):
    """Mask (row, column) of a picture's edges, except lamps and their rims."""
    bright = lamps_of(truth)
    smooth = gaussian_filter(truth, 1.0)
    steep = np.hypot(*np.gradient(smooth)) / np.maximum(gaussian_filter(truth, 6.0), 1e-3 * truth.mean())
    return (steep > np.quantile(steep[~bright], 1 - EDGES)) & ~bright


def means_of_blocks(pictures, side_px):
    """Means of square blocks: array (..., row, column) of blocks."""
    *others, rows, columns = pictures.shape
    rows, columns = rows // side_px, columns // side_px
    cut = pictures[..., :rows * side_px, :columns * side_px]
    return cut.reshape(*others, rows, side_px, columns, side_px).mean(axis=(-3, -1))
