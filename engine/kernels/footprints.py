"""The ideal picture: each pixel the average of a capture over its footprint there."""

from collections.abc import Sequence
from ctypes import Structure, byref
from dataclasses import dataclass

import numpy as np

from .library import CAPTURE, GEOMETRY, address, check, chosen, picture


@dataclass(frozen=True, eq=False)
class RadialGeometry:
    """What `footprints` has to know of a lens, over the distance from the axis on the pixel grid."""

    _curves: np.ndarray
    _structure: Structure

    @classmethod
    def of(cls, centre_px: tuple[float, float], samples_per_px: float, tangential: np.ndarray, radial: np.ndarray,
           factor: np.ndarray, last_px: float = np.inf) -> "RadialGeometry":
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
        last_px : float
            The distance beyond which all is black.
        """
        curves = np.stack([tangential, radial, factor], axis=1).astype(np.float64, order="C")
        return cls(curves, GEOMETRY(*centre_px, samples_per_px, address(curves, np.float64), len(curves) - 1, last_px))

    @property
    def nbytes(self) -> int:
        return self._curves.nbytes


def footprints(geometry: RadialGeometry, captures: Sequence[np.ndarray], centre_px: tuple[float, float], rows: slice,
               out: np.ndarray) -> None:
    """Write these rows of a picture, by index of `out`.

    Parameters
    ----------
    geometry : RadialGeometry
    captures : 1 to 4 float32 arrays (row, column)
        What each plane averages: views of a capture, all of the same shape, whose rows or columns may run backwards.
        All that lies outside is black.
    centre_px : (row, column)
        Of the axis in each of them.
    rows : slice
    out : float32 array (plane, row, column)

    Raises
    ------
    ValueError
    """
    loops, variant = chosen()
    first, end, _ = rows.indices(out.shape[1])
    check(loops.lf_footprints(variant, byref(geometry._structure), byref(_capture(captures, centre_px)), first, end,
                              byref(picture(out))))


def _capture(captures, centre_px):
    """Views of a capture as the loop takes them."""
    if len(captures) > 4 or any(view.dtype != np.float32 or view.ndim != 2 or view.shape != captures[0].shape
                                or any(step % 4 for step in view.strides) for view in captures):
        raise ValueError(f"captures of {[(str(view.dtype), view.shape) for view in captures]}, where the loops want up "
                         "to four float32 (row, column) of one shape")
    addresses = (view.ctypes.data for view in captures)
    rows, columns = ([view.strides[axis] // 4 for view in captures] for axis in (0, 1))
    structure = CAPTURE(planes=len(captures), rows=captures[0].shape[0], columns=captures[0].shape[1],
                        centre_row=centre_px[0], centre_column=centre_px[1])
    for plane, values in enumerate(zip(addresses, rows, columns, strict=True)):
        structure.first[plane], structure.row_step[plane], structure.step[plane] = values
    return structure
