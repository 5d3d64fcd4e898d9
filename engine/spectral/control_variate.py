"""Light at further wavelengths from few samples, with the help of a picture that has many.

Pictures of one scene with the same seed share their paths, so their noise is correlated. Of a picture B, only a few
samples are rendered; of A, at other wavelengths, also the rest. A is then a control variate of B: the estimate
B_few + α (A - A_few) has nearly the noise of many samples of B. The gains α come from a regression around each pixel
(Rousselle et al. 2016, "Image-space control variates for rendering").

Gains from the same samples that they correct would bias the estimate. Therefore each pixel takes its gains from its
neighbours alone: pixels have independent samples, and so gains and corrections are independent.
"""

from collections.abc import Sequence

import numpy as np

from ..kernels.control import control
from ..kernels.numpy_control import window_mean

RIDGE = 0.001  # of the mean square of A in the window: weight of the pictures' mean ratio
LEAST_RIDGE = 1e-4  # the least, in units of normalised light: a few dark pixels determine no gains
BLOCK_PX = 8  # side of the blocks over which noise is averaged
JUDGED_PERCENT = 75  # of the blocks; bright, rare paths leave the noise of some uncertain


def estimate(halves: Sequence[np.ndarray], control_halves: Sequence[np.ndarray], control_rest: np.ndarray,
             weight: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The light of a picture, from the two halves of its few samples and a control variate.

    Parameters
    ----------
    halves : two float32 arrays (channel, row, column)
        B after each half of the few samples.
    control_halves : two float32 arrays (channel, row, column)
        A after the same samples.
    control_rest : float32 array (channel, row, column)
        A after the rest of its samples.
    weight : float or array (row, column)
        Share of the rest in the samples of A.

    Returns
    -------
    estimate : float32 array (channel, row, column)
    difference : float32 array (channel, row, column)
        Between the two halves, each corrected by the control variate; it shows the noise that remains.
    """
    picture, helper = ((one + other) / 2 for one, other in (halves, control_halves))
    means, helper_means = picture.mean(axis=(1, 2)), helper.mean(axis=(1, 2))
    ratios = np.divide(means, helper_means, out=np.ones_like(means), where=helper_means > 0)
    return control(halves, control_halves, control_rest, _scale(helper), ratios, weight, RIDGE, LEAST_RIDGE)


def _scale(helper):
    """Of the errors of a regression, by a control (channel, row, column): array (row, column).

    The gains have the least squared relative errors in a window around each pixel, without the pixel itself. Errors of
    single pixels weigh little in the dark. Their weights depend on no other pixel's light: a bright sample would
    otherwise affect its own gains.
    """
    brightness = np.abs(helper).mean(axis=0)
    level = brightness + np.sqrt(brightness).mean()**2  # in the middle between dark and bright pixels
    return np.divide(1, level, out=np.zeros_like(level), where=level > 0)


def balance(plane: np.ndarray) -> None:
    """Set negative light to 0, in place, and darken the light around it by as much.

    Noise makes some estimates negative. Without the balance, setting them to 0 would brighten dim light.

    Parameters
    ----------
    plane : float32 array (row, column)
    """
    deficit = np.maximum(-plane, 0)
    if not deficit.any():
        return
    np.maximum(plane, 0, out=plane)
    around = window_mean(plane)
    shares = np.divide(deficit, around, out=np.zeros_like(plane), where=around > 0)
    plane *= np.maximum(1 - window_mean(shares), 0)


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
    """Noise of the estimate relative to all samples without a control variate: the most in JUDGED_PERCENT of
    the blocks.

    The remaining share of the variance is from few samples, and the other share from all samples.

    Parameters
    ----------
    shares : array (block,)
        From `remaining_shares`.
    few, samples : float
        Numbers of samples.
    """
    if not shares.size:
        return 1.0
    return float(np.sqrt(1 + np.percentile(shares, JUDGED_PERCENT) * (samples / few - 1)))


def block_means(plane: np.ndarray) -> np.ndarray:
    """Means of square blocks of a plane; incomplete blocks at its edges are ignored."""
    rows, columns = (max(n // BLOCK_PX, 1) for n in plane.shape)
    height, width = (min(n, BLOCK_PX) for n in plane.shape)
    blocks = plane[:rows * height, :columns * width].reshape(rows, height, columns, width)
    return blocks.mean(axis=(1, 3), dtype=np.float64)
