"""Light from few samples, corrected by a picture of many that shares their noise."""

from collections.abc import Sequence
from ctypes import byref

import numpy as np

from ..runtime.threads import in_bands
from .arrays import address
from .declarations import NUMBERS, STRUCTURES
from .library import NUMPY, check, chosen, running
from .numpy_control import numpy_control

CONTROLLED, CHANNELS = STRUCTURES["controlled"], NUMBERS["CHANNELS"]
BAND_ROWS = 32  # whatever the number of threads: the sums of a band begin anew


def control(halves: Sequence[np.ndarray], control_halves: Sequence[np.ndarray], control_rest: np.ndarray,
            scale: np.ndarray, ratios: np.ndarray, weight: float | np.ndarray, ridge: float, least_ridge: float
            ) -> tuple[np.ndarray, np.ndarray]:
    """A picture with the noise of a control variate, by a regression around each pixel.

    Parameters
    ----------
    halves : two float32 arrays (channel, row, column)
        The picture after each half of its few samples.
    control_halves : two float32 arrays (channel, row, column)
        The control after the same samples.
    control_rest : float32 array (channel, row, column)
        The control after the rest of its samples.
    scale : float32 array (row, column)
        Of errors, in the regression.
    ratios : array (channel,)
        Of the means of picture and control: the gains without light.
    weight : float or float32 array (row, column)
        Share of the rest in the samples of the control.
    ridge, least_ridge : float
        Weight of the ratios, relative to the mean square of the control in a window, and at least.

    Returns
    -------
    estimate, difference : float32 arrays (channel, row, column)
        Of the light; and between its two halves, each corrected by the control.

    Raises
    ------
    ValueError
    """
    shape = halves[0].shape
    if running() == NUMPY or shape[0] != CHANNELS:
        return numpy_control(halves, control_halves, control_rest, scale, ratios, weight, ridge, least_ridge)
    loops, variant = chosen()
    _, rows, columns = shape
    pictures = [np.ascontiguousarray(each) for each in (*halves, *control_halves, control_rest)]
    weights = np.ascontiguousarray(weight, np.float32) if np.ndim(weight) else None
    estimate, difference = np.empty(shape, np.float32), np.empty(shape, np.float32)
    structure = CONTROLLED(
        *(address(each, np.float32, shape) for each in pictures), address(scale, np.float32, shape[1:]),
        *((0, weight) if weights is None else (address(weights, np.float32, shape[1:]), 0.0)), tuple(ratios), ridge,
        least_ridge, rows, columns)

    def band(side):
        work = np.empty(loops.lf_control_work(columns))
        check(loops.lf_control(variant, byref(structure), side.start, side.stop, address(estimate, np.float32),
                               address(difference, np.float32), address(work, np.float64)))

    in_bands(band, rows, BAND_ROWS)
    return estimate, difference
