"""Errors of noisy pictures against a noisy truth, with the noise taken out: pictures are arrays (seed, row, column)."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

LAMPS, REACH_PX = 4.0, 13  # times the mean light: what is so bright, and a square's side around it that counts as that
EDGES = 0.2  # of the rest: where the picture is steepest


@dataclass(frozen=True)
class Errors:
    """Relative errors: L1 over the mean of the truth, L2 over its root mean square.

    Attributes
    ----------
    l1_bias, l2_bias : float
        That would be left, were there no noise.
    l1, l2 : float
        Of one picture with its noise.
    """

    l1_bias: float
    l2_bias: float
    l1: float
    l2: float


def errors(pictures, truths, where=...):
    """The Errors of pictures; where a mask is given, of what is in it.

    The noise of means comes from what seeds differ by. Squares lose it exactly; absolute values as if it were Gaussian.
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
    """Half the difference of the means of half the seeds and the others: noise like that of the mean of all."""
    count = len(pictures) // 2
    return (pictures[:count].mean(axis=0) - pictures[count:2 * count].mean(axis=0)) / 2


def root(square):
    """Its root; of what noise has made negative the root with a minus."""
    return np.sign(square) * np.sqrt(np.abs(square))


def lamps_of(truth):
    """Where lamps and glints are, and the rims of their blur: mask (row, column)."""
    return maximum_filter(truth > LAMPS * truth.mean(), REACH_PX)


def edges_of(truth):
    """Where a picture is steep, but for lamps and their rims: mask (row, column)."""
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
