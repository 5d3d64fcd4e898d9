"""The work that each section requires: none if black, no filter if flat, and single precision for most."""

from dataclasses import dataclass

import numpy as np
import scipy

from ..field.mirror_symmetry import Planes
from ..kernels.extremes import extremes
from ..runtime.threads import in_bands

BAND_PIXELS = 1 << 18  # measured together
SINGLE_NUMBERS = 1e-28, 1e30  # sums and products of spectra retain their precision in this range


@dataclass(frozen=True, eq=False)
class SectionNeeds:
    """The needs of a picture's sections: boolean arrays (section row, section column).

    Attributes
    ----------
    lit : the section's light must be spread.
    double : this requires double precision.
    flat : light is uniform in reach of the section, so its pixels are computed without a filter.
    """

    lit: np.ndarray
    double: np.ndarray
    flat: np.ndarray


@dataclass(frozen=True, eq=False)
class _Extremes:
    """Extremes of the light of each section: arrays (section row, section column).

    `dimmest` is the minimum of its lit pixels, `least` of all pixels; `slope` is the largest step between adjacent
    pixels.
    """

    brightest: np.ndarray
    dimmest: np.ndarray
    least: np.ndarray
    slope: np.ndarray


def section_needs(light: np.ndarray, planes: Planes, section_size: int, reach_px: int, single_range: float,
                  flat_slope: float) -> SectionNeeds:
    """The needs of the sections of a picture's planes, common to all planes.

    Parameters
    ----------
    light : array (plane, row, column)
    planes : Planes
    section_size : int
    reach_px : int
        Reach of a section's light.
    single_range : float
        Single precision is sufficient if a section's brightest pixel is at most this times the dimmest pixel, except
        black, that its light can reach: rounding errors are proportional to the brightest and must not mask the
        dimmest.
    flat_slope : float
        Light is flat if it changes by at most this between adjacent pixels, relative to the dimmest pixel in reach.
    """
    extremes = _extremes(light, planes, section_size)
    sections = -(-reach_px // section_size)

    def around(table, extreme, outside):
        padded = planes.around(table, sections, outside)
        inside = tuple(slice(sections, sections + n) for n in table.shape)
        return extreme(padded, 2 * sections + 1)[inside]

    smallest, largest = scipy.ndimage.minimum_filter, scipy.ndimage.maximum_filter
    lit, flat = extremes.brightest > 0, np.zeros(extremes.brightest.shape, dtype=bool)
    double = _beyond_single(extremes.brightest, around(extremes.dimmest, smallest, np.inf), single_range)
    if flat_slope:
        steepest, dimmest = around(extremes.slope, largest, np.inf), around(extremes.least, smallest, 0)
        flat = lit & (steepest <= flat_slope * dimmest)
        lit = lit & ~around(flat, smallest, False)
    return SectionNeeds(lit, lit & double, flat)


def _extremes(light, planes, section_size):
    """The extremes of every section."""
    measured = np.empty((4, *(-(-n // section_size) for n in light.shape[1:])), light.dtype)
    in_bands(lambda rows: extremes(light, section_size, rows, measured), measured.shape[1],
             BAND_PIXELS // light[:, :section_size].size)
    result = _Extremes(*measured)
    across, down = planes.steps_across_axis(np.abs(light[:, :, 0]), np.abs(light[:, 0]))
    np.maximum(result.slope[:, 0], _by_section(np.maximum, across, section_size), out=result.slope[:, 0])
    np.maximum(result.slope[0], _by_section(np.maximum, down, section_size), out=result.slope[0])
    for axis, n in enumerate(light.shape[1:]):
        if n % section_size:  # the last section is partly black, also in reach of the one before it
            last = (slice(None),) * axis + (-1,)
            result.slope[last], result.least[last] = np.inf, 0
    return result


def _beyond_single(brightest, dimmest, single_range):
    """Where single precision is insufficient, because of the range of the light or of the numbers."""
    if single_range == np.inf:
        return np.zeros(brightest.shape, dtype=bool)
    if single_range == 0:
        return np.ones(brightest.shape, dtype=bool)
    faintest, largest = SINGLE_NUMBERS
    return (brightest / single_range > dimmest) | (brightest < faintest) | (brightest > largest)


def _by_section(extreme, values, section_size):
    return extreme.reduceat(values, np.arange(0, values.size, section_size))
