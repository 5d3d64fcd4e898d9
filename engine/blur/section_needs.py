"""What a picture requires, section by section: black ones nothing, flat ones no filter, most single precision."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from ..field.mirror_symmetry import Planes
from ..threads import thread_pool

SINGLE_NUMBERS = 1e-28, 1e30  # between which sums and products of spectra keep their digits


@dataclass(frozen=True, eq=False)
class SectionNeeds:
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


@dataclass(frozen=True, eq=False)
class _Extremes:
    """Extremes of the light of each section: arrays (section row, section column).

    `dimmest` is of its lit pixels, `least` of all of them; `slope` is the largest step from pixel to pixel.
    """

    brightest: np.ndarray
    dimmest: np.ndarray
    least: np.ndarray
    slope: np.ndarray


def section_needs(light: np.ndarray, planes: Planes, section_size: int, reach_px: int, single_range: float,
                  flat_slope: float) -> SectionNeeds:
    """What the sections of the planes of a picture need, which the planes share.

    Parameters
    ----------
    light : array (plane, row, column)
    planes : Planes
    section_size : int
    reach_px : int
        How far the light of a section comes.
    single_range : float
        Single precision serves where a section's brightest pixel is up to this times the dimmest one, black aside,
        that its light can reach: rounding goes with the brightest, and must not drown the dimmest.
    flat_slope : float
        Light is flat where it changes by no more than this from pixel to pixel, relative to the dimmest in reach.
    """
    found = _extremes(light, planes, section_size, steps=flat_slope > 0)
    sections = -(-reach_px // section_size)

    def around(table, extreme, outside):
        padded = planes.around(table, sections, outside)
        inside = tuple(slice(sections, sections + n) for n in table.shape)
        return extreme(padded, 2 * sections + 1)[inside]

    lit, flat = found.brightest > 0, np.zeros(found.brightest.shape, dtype=bool)
    double = _beyond_single(found.brightest, around(found.dimmest, minimum_filter, np.inf), single_range)
    if flat_slope:
        steepest, dimmest = around(found.slope, maximum_filter, np.inf), around(found.least, minimum_filter, 0)
        flat = lit & (steepest <= flat_slope * dimmest)
        lit = lit & ~around(flat, minimum_filter, False)
    return SectionNeeds(lit, lit & double, flat)


def _extremes(light, planes, section_size, steps):
    """The extremes of every section; slopes only where steps are asked for."""
    shape = tuple(-(-n // section_size) for n in light.shape[1:])
    found = _Extremes(*(np.empty(shape) for _ in range(4)))

    def measure(i):
        rows = np.abs(light[:, i * section_size:(i + 1) * section_size + 1])
        band = rows[:, :section_size]
        found.brightest[i] = _by_section(np.maximum, band.max(axis=(0, 1)), section_size)
        lowest = band.min(axis=(0, 1))
        found.least[i] = _by_section(np.minimum, lowest, section_size)
        if lowest.min() == 0:
            lowest = np.where(band > 0, band, np.inf).min(axis=(0, 1))
        found.dimmest[i] = _by_section(np.minimum, lowest, section_size)
        if steps:
            found.slope[i] = _by_section(np.maximum, _steepest(rows, planes, first=i == 0), section_size)

    with thread_pool() as pool:
        list(pool.map(measure, range(shape[0])))
    for axis, n in enumerate(light.shape[1:]):
        if n % section_size:  # black begins inside the last section, and so in reach of the one before it
            last = (slice(None),) * axis + (-1,)
            found.slope[last], found.least[last] = np.inf, 0
    return found


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


def _steepest(rows, planes, first):
    """The largest step from each column's pixels to the next ones: array (column,). The last row is the next band's."""
    step = np.zeros(rows.shape[2])
    step[:-1] = np.abs(np.diff(rows, axis=2)).max(axis=(0, 1))
    np.maximum(step, np.abs(np.diff(rows, axis=1)).max(axis=(0, 1), initial=0), out=step)
    across, down = planes.steps_across_axis(rows, first)
    step[0] = max(step[0], np.abs(across).max(initial=0))
    return np.maximum(step, np.abs(down).max(axis=0, initial=0), out=step)
