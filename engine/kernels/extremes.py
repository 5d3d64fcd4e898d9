"""The extremes of the light of square sections."""

from ctypes import byref

import numpy as np

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import NUMPY, check, chosen, running
from .numpy_sections import numpy_extremes

EXTREMES = STRUCTURES["extremes_of"]


def extremes(light: np.ndarray, section_px: int, rows: slice, out: np.ndarray) -> None:
    """Write the extremes of some rows of sections.

    Parameters
    ----------
    light : array (plane, row, column)
    section_px : int
    rows : slice
        Of the sections.
    out : array (4, section row, section column), of the type of light
        Of the sizes of a section's pixels in all planes, without their signs: the largest, the smallest above 0 (or
        infinity), the smallest, and the largest step from a pixel to the next one to the right or below.

    Raises
    ------
    ValueError
    """
    if running() == NUMPY or light.dtype != np.float32:
        numpy_extremes(light, section_px, rows, out)
        return
    loops, variant = chosen()
    first, end, _ = rows.indices(out.shape[1])
    address(out, np.float32, (4, *out.shape[1:]))
    structure = EXTREMES(*(each.ctypes.data for each in out), *out.shape[1:], section_px)
    check(loops.lf_extremes(variant, byref(picture(light)), byref(structure), first, end))
