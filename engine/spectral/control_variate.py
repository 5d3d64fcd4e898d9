"""Light at further wavelengths from few samples, with the help of a picture that has many.

Pictures of one scene with the same seed share their paths, so their noise is correlated. Of a picture B, only the
first few samples are rendered; of A, at other wavelengths, also the rest. A is then a control variate of B: the
estimate B_few + α (A - A_few) has nearly the noise of many samples of B. The gains α come from a regression around each
pixel (Rousselle et al. 2016, "Image-space control variates for rendering").

Gains from the same samples that they correct would bias the estimate. Therefore each half of the few samples takes its
gains from the other half, and A without that half: gains and corrections are independent.
"""

from collections.abc import Sequence

import numpy as np
import scipy

WINDOW_PX = 11  # side of the regression's window
RIDGE = 0.001  # of the mean square of A in the window: weight of the pictures' mean ratio
LEAST_RIDGE = 1e-4  # the least, in units of normalised light: a few dark pixels determine no gains
DARK = 1e-2  # of the mean brightness: below it, errors weigh no more
BLOCK_PX = 8  # side of the blocks over which noise is averaged
JUDGED_PERCENT = 75  # of the blocks; bright, rare paths leave the noise of some uncertain


def estimate(halves: Sequence[np.ndarray], control_halves: Sequence[np.ndarray], control_rest: np.ndarray,
             weight: float | np.ndarray) -> list[np.ndarray]:
    """The light of a picture, from two halves of its few samples and a control variate.

    Parameters
    ----------
    halves : two float32 arrays (channel, row, column)
        B after each half of the few samples.
    control_halves : two float32 arrays (channel, row, column)
        A after the same samples.
    control_rest : float32 array (channel, row, column)
        A after the rest of its samples.
    weight : float or array (row, column)
        Share of the rest in the samples of A without one half.

    Returns
    -------
    estimates : two float32 arrays (channel, row, column)
        Their mean is the estimate, and their difference shows its noise.
    """
    return [half + np.einsum("icyx,iyx->cyx", _gains(other, control_other), weight * (control_rest - control_half))
            for half, control_half, other, control_other in zip(halves, control_halves, halves[::-1],
                                                                control_halves[::-1], strict=True)]


def _gains(picture, control):
    """Linear combinations of the control's channels that predict the picture's: array (control channel, channel, row,
    column).

    They have the least squared relative errors in a window; without light in it, they are the ratios of the pictures'
    means.
    """
    brightness = np.abs(control).mean(axis=0)
    level = brightness + _window_mean(brightness) + DARK * brightness.mean()
    scale = np.divide(1, level, out=np.zeros_like(level), where=level > 0)
    picture, control = picture * scale, control * scale
    normal = _window_mean(control[:, None] * control)
    right = _window_mean(control[:, None] * picture)
    means, control_means = picture.mean(axis=(1, 2)), control.mean(axis=(1, 2))
    ratios = np.divide(means, control_means, out=np.ones_like(means), where=control_means > 0)
    channels = range(len(control))
    ridge = RIDGE * sum(normal[one, one] for one in channels) / len(channels) + np.float32(LEAST_RIDGE)
    for one in channels:
        normal[one, one] += ridge
        right[one, one] += ridge * ratios[one]
    return _solve(normal, right)


def _window_mean(planes):
    """Means over square windows of planes (..., row, column)."""
    for axis in (-2, -1):
        planes = scipy.ndimage.uniform_filter1d(planes, WINDOW_PX, axis=axis, mode="nearest")
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


def remaining_shares(difference: np.ndarray, unhelped: np.ndarray) -> np.ndarray:
    """Shares of the few samples' variance that a control variate leaves, in blocks of pixels: array (block,).

    Parameters
    ----------
    difference, unhelped : arrays (channel, row, column)
        Between the two halves of the few samples, with and without the control variate.
    """
    remaining, total = (block_means((plane**2).sum(axis=0)) for plane in (difference, unhelped))
    lit = total > 0
    return np.minimum(remaining[lit] / total[lit], 1)


def noise_growth(shares: np.ndarray, few: float, samples: float) -> float:
    """Noise of the estimate relative to that of all samples without a control variate: the most in JUDGED_PERCENT of
    the blocks.

    It consists of the noise that the control variate leaves and, by its `weight`, the control variate's own.

    Parameters
    ----------
    shares : array (block,)
        From `remaining_shares`.
    few, samples : float
        Numbers of samples.
    """
    rest = samples - few
    own = (rest / (rest + few / 2))**2 * samples / rest
    return float(np.sqrt(own + np.percentile(shares, JUDGED_PERCENT) * samples / few)) if shares.size else 1.0


def block_means(plane: np.ndarray) -> np.ndarray:
    """Means of square blocks of a plane; incomplete blocks at its edges are ignored."""
    rows, columns = (max(n // BLOCK_PX, 1) for n in plane.shape)
    height, width = (min(n, BLOCK_PX) for n in plane.shape)
    blocks = plane[:rows * height, :columns * width].reshape(rows, height, columns, width)
    return blocks.mean(axis=(1, 3), dtype=np.float64)
