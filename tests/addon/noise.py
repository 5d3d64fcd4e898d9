"""Monte Carlo noise, measured in the very pictures that have it: tests allow for that and for no more.

Cycles draws the random numbers of each pixel on their own, where it is not told to spread its noise over neighbours:
pixels that should be alike are as many measurements of the same, and their spread tells how far their mean may be off.
`test_noise.py` holds it to that, against pictures of other seeds.
"""

import numpy as np
from scipy.stats import norm, t

SIGMAS = 5
ROUNDING = 1e-4  # without noise: 2^-24 for each of up to 1024 samples, and of 600 operations more, were all to add up


def five_sigma(pictures):
    """How far the means of pictures (…, row, column) may be off, as rarely as 5 standard deviations are exceeded.

    The standard deviation is itself measured, so that by Student it takes a few more than 5 of few pixels.
    """
    pixels = np.prod(pictures.shape[-2:])
    sigmas = t.isf(norm.sf(SIGMAS), pixels - 1)
    return sigmas * pictures.std(axis=(-2, -1), ddof=1) / np.sqrt(pixels)


def surely_apart(first, second):
    """How far apart the means of two pictures are, beyond 5 sigma of the noise that they do not share."""
    apart = np.subtract(first, second, dtype=np.float64)
    return np.abs(apart.mean(axis=(-2, -1))) - five_sigma(apart)


def assert_means(pictures, expected, rtol=ROUNDING, noise=None, other_seed=None):
    """Hold the means of pictures to those expected: within rtol of them, and 5 sigma of noise.

    Parameters
    ----------
    pictures : array (…, row, column)
    expected : array (…), or pictures of the same noise, or of less
    rtol : float
        How far off the expected values themselves may be, as a part of them.
    noise : float, optional
        The most that 5 sigma of noise may be, as a part of what is expected: more would hide what is looked for. By
        default as much as `rtol`, so that thrice this is never missed.
    other_seed : array (…, row, column), optional
        The same of another seed, where pixels differ by more than noise; what both have in the mean is judged.
    """
    pictures, expected = np.asarray(pictures, np.float64), np.asarray(expected, np.float64)
    apart = pictures - (expected if expected.ndim == pictures.ndim else expected[..., None, None])
    scale = np.abs(pictures - apart).mean(axis=(-2, -1))
    half = 0 if other_seed is None else (pictures - other_seed) / 2
    off = np.abs((apart - half).mean(axis=(-2, -1)))
    allowance = five_sigma(apart if other_seed is None else half)
    most = (rtol if noise is None else noise) * scale
    assert np.all(allowance <= most), f"5 sigma of noise: {allowance}: expected {most} at most"
    assert np.all(off <= rtol * scale + allowance), f"off by {off}: expected {rtol * scale} and {allowance} at most"
