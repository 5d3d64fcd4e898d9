"""The light of a bundle of rays in the samples of a window."""

from ctypes import byref

import numpy as np

from .arrays import address
from .declarations import STRUCTURES
from .library import NUMPY, check, chosen, running
from .numpy_spots import numpy_spots

BUNDLE = STRUCTURES["bundle"]
QUANTITIES = 7


def spots(corners: np.ndarray, parts: int, side: int) -> tuple[np.ndarray, float]:
    """Light of the tubes between rays, in square samples.

    A tube whose ends are the parts of a cell covers a box, and gives each sample light by area. Diffraction deflects
    rays that pass the edge of the aperture at the distance t to both sides, across the edge.

    Parameters
    ----------
    corners : float64 array (7, radius, azimuth)
        Rays at the corners of cells: x and y, in samples from the window's first corner; two coordinates over whose
        area the light is even; direction cosines along x and y, scaled so that the deflection is 1 / t samples; and the
        tightest limit of the apertures, which passes light up to 1.
    parts : int
        Limit of the parts of a cell along each side, with rays interpolated between its corners. A cell that covers
        more samples has more parts.
    side : int
        Samples of the window along each side.

    Returns
    -------
    array (row, column)
    float
        All light, including the light outside the window.

    Raises
    ------
    ValueError
        Sizes are invalid.
    """
    if running() == NUMPY:
        return numpy_spots(corners, parts, side)
    loops, variant = chosen()
    corners = np.ascontiguousarray(corners, dtype=np.float64)
    out, light = np.zeros((side, side)), np.zeros(1)
    bundle = BUNDLE(address(corners, np.float64, (QUANTITIES, *corners.shape[1:])), *corners.shape[1:], parts, side)
    check(loops.lf_spots(variant, byref(bundle), address(out, np.float64), address(light, np.float64)))
    return out, float(light[0])
