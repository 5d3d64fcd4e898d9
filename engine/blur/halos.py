"""Halos: the trimmed part of PSFs, added around highlights, where it would visibly be missing.

A thousandth of most pixels' light is invisible, at any distance from them. But a lamp ten thousand times as bright as
its surroundings has a halo, and PSFs trimmed to a circle would cut it off there.
"""

import numpy as np

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
    starts = [np.arange(0, n, section_size) for n in light.shape[1:]]
    sums = np.add.reduceat(np.add.reduceat(light, starts[0], axis=1, dtype=np.float64), starts[1], axis=2)
    if not (sums > 0).any():
        return None
    pixels = np.outer(*(np.diff(start, append=n) for start, n in zip(starts, light.shape[1:], strict=True)))
    typical = np.median((sums / pixels)[sums > 0])
    bright, halo_light = np.zeros(sums.shape[1:], dtype=bool), None
    for plane, i, j in np.argwhere(sums * density > VISIBLE * typical):
        inside = (plane, slice(starts[0][i], starts[0][i] + section_size),
                  slice(starts[1][j], starts[1][j] + section_size))
        excess = np.maximum(light[inside] - light.dtype.type(HIGHLIGHT * typical), 0)
        if excess.sum(dtype=np.float64) * density > VISIBLE * typical:
            halo_light = np.zeros_like(light) if halo_light is None else halo_light
            halo_light[inside], bright[i, j] = excess, True
    return None if halo_light is None else (halo_light, bright)
