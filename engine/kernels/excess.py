"""The light of square sections above a level."""

from ctypes import byref

import numpy as np

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import NUMPY, check, chosen, running
from .numpy_sections import numpy_excess

EXCESS = STRUCTURES["excess_of"]


def excess(light: np.ndarray, level: float, section_px: int, rows: slice, out: np.ndarray) -> None:
    """Write the sums over the pixels of some rows of sections: of their light minus the level, where it is larger.

    Parameters
    ----------
    light : array (plane, row, column)
    level : float
        Rounded to single precision.
    section_px : int
    rows : slice
        Of the sections.
    out : float64 array (plane, section row, section column)

    Raises
    ------
    ValueError
    """
    if running() == NUMPY or light.dtype != np.float32:
        numpy_excess(light, level, section_px, rows, out)
        return
    loops, variant = chosen()
    first, end, _ = rows.indices(out.shape[1])
    structure = EXCESS(address(out, np.float64, (len(light), *out.shape[1:])), *out.shape[1:], section_px)
    check(loops.lf_excess(variant, byref(picture(light)), level, byref(structure), first, end))
