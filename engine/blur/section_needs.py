"""What a picture requires, section by section: black ones nothing, flat ones no filter, most single precision."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

SINGLE_NUMBERS = 1e-28, 1e30  # between which sums and products of spectra keep their digits


@dataclass(frozen=True, eq=False)
class Content:
    """What the sections of a picture need: boolean arrays (section row, section column).

    Attributes
    ----------
    lit : its light has to be spread.
    double : in double precision.
    flat : its pixels see even light all around, and are written down.
    """

    lit: np.ndarray
    double: np.ndarray
    flat: np.ndarray


def judge_content(planes, section_size, reach_px, single_range, flat_slope, folded):
    """What the sections of these planes need. The planes share the judgement.

    Parameters
    ----------
    planes : array (plane, row, column)
    section_size : int
    reach_px : int
        How far the light of a section comes.
    single_range : float
        Single precision serves where a section's brightest pixel is up to this times the dimmest one, black aside,
        that its light can reach: rounding goes with the brightest, and must not drown the dimmest.
    flat_slope : float
        Light is flat where it changes by no more than this from pixel to pixel, relative to the dimmest in reach.
    folded : bool
        The planes are quadrants, which go on across their upper and left edges; elsewhere all around is black.
    """
    shape = tuple(-(-n // section_size) for n in planes.shape[1:])
    brightest, dimmest, least, slope = (np.empty(shape) for _ in range(4))

    def measure(i):
        rows = np.abs(planes[:, i * section_size:(i + 1) * section_size + 1])
        band = rows[:, :section_size]
        brightest[i] = _by_section(np.maximum, band.max(axis=(0, 1)), section_size)
        lowest = band.min(axis=(0, 1))
        least[i] = _by_section(np.minimum, lowest, section_size)
        if lowest.min() == 0:
            lowest = np.where(band > 0, band, np.inf).min(axis=(0, 1))
        dimmest[i] = _by_section(np.minimum, lowest, section_size)
        if flat_slope:
            slope[i] = _by_section(np.maximum, _steepest(rows, folded, first=i == 0), section_size)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(measure, range(shape[0])))

    for axis, n in enumerate(planes.shape[1:]):
        if n % section_size:  # black begins inside the last section, and so in reach of the one before it
            last = (slice(None),) * axis + (-1,)
            slope[last], least[last] = np.inf, 0

    def around(statistic, extreme, outside):
        return _around(statistic, extreme, -(-reach_px // section_size), outside, folded)

    lit, flat = brightest > 0, np.zeros(shape, dtype=bool)
    double = _beyond_single(brightest, around(dimmest, minimum_filter, np.inf), single_range)
    if flat_slope:
        flat = lit & (around(slope, maximum_filter, np.inf) <= flat_slope * around(least, minimum_filter, 0))
        lit = lit & ~around(flat, minimum_filter, False)
    return Content(lit, lit & double, flat)


def _beyond_single(brightest, dimmest, single_range):
    """Where single precision does not serve: for the range of the light, or for that of its numbers."""
    if single_range == np.inf:
        return np.zeros(brightest.shape, dtype=bool)
    if single_range == 0:
        return np.ones(brightest.shape, dtype=bool)
    faintest, largest = SINGLE_NUMBERS
    return (brightest / single_range > dimmest) | (brightest < faintest) | (brightest > largest)


def _by_section(extreme, values, section_size):
    return extreme.reduceat(values, np.arange(0, values.size, section_size))


def _steepest(rows, folded, first):
    """The largest step from each column's pixels to the next ones: array (column,). The last row is the next band's."""
    step = np.zeros(rows.shape[2])
    step[:-1] = np.abs(np.diff(rows, axis=2)).max(axis=(0, 1))
    if rows.shape[1] > 1:
        np.maximum(step, np.abs(np.diff(rows, axis=1)).max(axis=(0, 1)), out=step)
    if folded:  # across the axis lies the mirrored quadrant
        step[0] = max(step[0], np.abs(rows[:2, :, 0] - rows[2:, :, 0]).max())
        if first:
            np.maximum(step, np.abs(rows[::2, 0] - rows[1::2, 0]).max(axis=0), out=step)
    return step


def _around(statistic, extreme, sections, outside, folded):
    """The extreme of a statistic over all sections as near as this."""
    if folded:
        padded = np.pad(np.pad(statistic, ((sections, 0), (sections, 0)), mode="symmetric"),
                        ((0, sections), (0, sections)), constant_values=outside)
    else:
        padded = np.pad(statistic, sections, constant_values=outside)
    inside = tuple(slice(sections, sections + n) for n in statistic.shape)
    return extreme(padded, 2 * sections + 1)[inside]
