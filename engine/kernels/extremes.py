"""The extremes of the light of square sections."""

from ctypes import byref

import numpy as np

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import check, chosen

EXTREMES = STRUCTURES["extremes_of"]


def extremes(light: np.ndarray, section_px: int, rows: slice, out: np.ndarray) -> None:
    """Write the extremes of some rows of sections.

    Parameters
    ----------
    light : float32 array (plane, row, column)
    section_px : int
    rows : slice
        Of the sections.
    out : float32 array (4, section row, section column)
        Of the sizes of a section's pixels in all planes, without their signs: the largest, the smallest above 0 (or
        infinity), the smallest, and the largest step from a pixel to the next one to the right or below.

    Raises
    ------
    ValueError
    """
    loops, variant = chosen()
    first, end, _ = rows.indices(out.shape[1])
    address(out, np.float32, (4, *out.shape[1:]))
    structure = EXTREMES(*(each.ctypes.data for each in out), *out.shape[1:], section_px)
    check(loops.lf_extremes(variant, byref(picture(light)), byref(structure), first, end))
