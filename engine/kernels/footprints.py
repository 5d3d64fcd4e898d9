"""The ideal picture: each pixel the average of a capture over its footprint there."""

from ctypes import Structure, byref
from dataclasses import dataclass

import numpy as np

from .library import GEOMETRY, address, check, chosen, picture

LARGEST_FOOTPRINT_PX = 16  # that of kernels.h


@dataclass(frozen=True, eq=False)
class RadialGeometry:
    """What `footprints` has to know of a lens, over the distance from the axis on the pixel grid."""

    _curves: np.ndarray
    _structure: Structure

    @classmethod
    def of(cls, centre_px: tuple[float, float], samples_per_px: float, tangential: np.ndarray, radial: np.ndarray,
           factor: np.ndarray) -> "RadialGeometry":
        """Of curves (sample,), evenly spaced from the axis on; the last sample is held.

        Parameters
        ----------
        centre_px : (row, column)
            Of the axis.
        samples_per_px : float
        tangential, radial : arrays
            Ideal distance per real one, and the slope of the ideal distance over the real one.
        factor : array
            What the averages are multiplied with.
        """
        curves = np.stack([tangential, radial, factor], axis=1).astype(np.float64, order="C")
        return cls(curves, GEOMETRY(*centre_px, samples_per_px, address(curves, np.float64), len(curves) - 1))


def footprints(geometry: RadialGeometry, capture: np.ndarray, capture_centre_px: tuple[float, float], rows: slice,
               out: np.ndarray) -> None:
    """Write these rows of a picture, by index of `out`.

    Parameters
    ----------
    geometry : RadialGeometry
    capture : float32 array (plane, row, column)
        With a black rim, which is read for all that lies outside.
    capture_centre_px : (row, column)
        Of the axis in it.
    rows : slice
    out : float32 array (plane, row, column)
    """
    loops, variant = chosen()
    first, end, _ = rows.indices(out.shape[1])
    check(loops.lf_footprints(variant, byref(geometry._structure), byref(picture(capture)), *capture_centre_px, first,
                              end, byref(picture(out))))
