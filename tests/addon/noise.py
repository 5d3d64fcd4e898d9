"""Monte Carlo noise, measured in the tested pictures themselves: tests allow for exactly that noise.

Cycles draws independent random numbers for each pixel, unless it is set to spread noise over neighbours. Pixels that
should be equal are therefore repeated measurements, and their spread gives the error of their mean. `test_noise.py`
verifies this against pictures with other seeds.
"""

import numpy as np
from scipy.special import ndtr, stdtrit

SIGMAS = 5
ROUNDING = 1e-4  # without noise: 2^-24 for each of up to 1024 samples and 600 more operations, all in one direction


def five_sigma(pictures):
    """Limit of the error of the means of pictures (…, row, column), exceeded as rarely as 5 standard deviations.

    The standard deviation is measured, too, so by Student's distribution the limit is above 5 sigma for few pixels.
    """
    pixels = np.prod(pictures.shape[-2:])
    sigmas = -stdtrit(pixels - 1, ndtr(-SIGMAS))
    return sigmas * pictures.std(axis=(-2, -1), ddof=1) / np.sqrt(pixels)


def surely_apart(first, second):
    """Difference between the means of two pictures, minus 5 sigma of their independent noise."""
    apart = np.subtract(first, second, dtype=np.float64)
    return np.abs(apart.mean(axis=(-2, -1))) - five_sigma(apart)


def assert_means(pictures, expected, rtol=ROUNDING, noise=None, other_seed=None):
    """Assert that the means of pictures are as expected: within rtol, plus 5 sigma of noise.

    Parameters
    ----------
    pictures : array (…, row, column)
    expected : array (…), or pictures with the same noise or less
    rtol : float
        Relative error of the expected values themselves.
    noise : float, optional
        Upper limit of 5 sigma of noise, relative to the expected values: more would hide errors. The default is `rtol`,
        with which an error of three times `rtol` is always detected.
    other_seed : array (…, row, column), optional
        The same with another seed, if pixels differ by more than noise; the mean of the two is compared.
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
