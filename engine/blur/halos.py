"""Halos: the trimmed part of PSFs, added around highlights, where it would visibly be missing.

A thousandth of most pixels' light is invisible, at any distance from them. But a lamp ten thousand times as bright as
its surroundings has a halo, and PSFs trimmed to a circle would cut it off there.
"""

import numpy as np

from ..kernels.excess import excess
from ..runtime.threads import in_bands

BAND_PIXELS = 1 << 18  # measured together
HIGHLIGHT = 16  # times the light of a typical section; dimmer pixels get no halo
VISIBLE = 0.02  # relative to that light


def highlights(light: np.ndarray, section_size: int, density: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The light whose halo is visible, and its sections.

    Parameters
    ----------
    light : array (plane, row, column)
    section_size : int
    density : float
        The fraction of a pixel's light that falls on each pixel of its halo.

    Returns
    -------
    array (plane, row, column), bool array (section row, section column); or None without such sections
        Each pixel's light above the threshold of a highlight, so halos do not start abruptly at the edge of a section.
    """
    sums = _light_above(0, light, section_size)
    if not sums.any():
        return None
    starts = (np.arange(0, n, section_size) for n in light.shape[1:])
    pixels = np.outer(*(np.diff(start, append=n) for start, n in zip(starts, light.shape[1:], strict=True)))
    typical = np.median((sums / pixels)[sums > 0])
    if sums.max() * density <= VISIBLE * typical:  # nor is the light above any level visible
        return None
    level = light.dtype.type(HIGHLIGHT * typical)
    visible = _light_above(level, light, section_size) * density > VISIBLE * typical
    if not visible.any():
        return None
    halo_light = np.zeros_like(light)
    for plane, i, j in np.argwhere(visible):
        inside = plane, *(slice(n * section_size, (n + 1) * section_size) for n in (i, j))
        halo_light[inside] = np.maximum(light[inside] - level, 0)
    return halo_light, visible.any(axis=0)


def _light_above(level, light, section_size):
    """The light of each section above a level: float64 array (plane, section row, section column)."""
    sums = np.empty((len(light), *(-(-n // section_size) for n in light.shape[1:])))
    in_bands(lambda rows: excess(light, level, section_size, rows, sums), sums.shape[1],
             BAND_PIXELS // light[:, :section_size].size)
    return sums
