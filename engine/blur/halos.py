"""Halos: what trimming leaves out of PSFs, put back around what is so bright that it would be seen to be missing.

A thousandth of the light of most pixels is nothing to see, however far from them it falls. But a lamp ten thousand
times as bright as what is around it has a halo, and PSFs that end at a circle would have it end there.
"""

import numpy as np

HIGHLIGHT = 16  # times the light of a typical section: what is less has no halo of its own
VISIBLE = 0.02  # of that light


def highlights(light: np.ndarray, section_size: int, density: float) -> tuple[np.ndarray, np.ndarray] | None:
    """The light whose halo shows, and the sections that it is in.

    Parameters
    ----------
    light : array (plane, row, column)
    section_size : int
    density : float
        The fraction of a pixel's light that falls on each pixel of its halo.

    Returns
    -------
    array (plane, row, column), bool array (section row, section column); or None where there are no such sections
        Of each pixel there is what exceeds that of a highlight, so that halos do not begin at the edge of a section.
    """
    starts = [np.arange(0, n, section_size) for n in light.shape[1:]]
    sums = np.add.reduceat(np.add.reduceat(light, starts[0], axis=1, dtype=np.float64), starts[1], axis=2)
    if not (sums > 0).any():
        return None
    pixels = np.outer(*(np.diff(start, append=n) for start, n in zip(starts, light.shape[1:], strict=True)))
    typical = np.median((sums / pixels)[sums > 0])
    bright, own = np.zeros(sums.shape[1:], dtype=bool), None
    for plane, i, j in np.argwhere(sums * density > VISIBLE * typical):
        inside = (plane, slice(starts[0][i], starts[0][i] + section_size),
                  slice(starts[1][j], starts[1][j] + section_size))
        excess = np.maximum(light[inside] - light.dtype.type(HIGHLIGHT * typical), 0)
        if excess.sum(dtype=np.float64) * density > VISIBLE * typical:
            own = np.zeros_like(light) if own is None else own
            own[inside], bright[i, j] = excess, True
    return None if own is None else (own, bright)
