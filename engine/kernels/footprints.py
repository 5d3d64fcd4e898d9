"""The ideal picture: each pixel is the average of a capture over the pixel's footprint."""

from collections.abc import Sequence
from ctypes import Structure, byref
from dataclasses import dataclass

import numpy as np

from .arrays import address, picture
from .declarations import STRUCTURES
from .library import check, chosen

CAPTURE, GEOMETRY = STRUCTURES["capture"], STRUCTURES["geometry"]


@dataclass(frozen=True, eq=False)
class RadialGeometry:
    """The lens data for `footprints`, as curves over the distance from the axis on the pixel grid."""

    _curves: np.ndarray
    _structure: Structure

    @classmethod
    def of(cls, centre_px: tuple[float, float], samples_per_px: float, tangential: np.ndarray, radial: np.ndarray,
           factor: np.ndarray, last_px: float = np.inf) -> "RadialGeometry":
        """From curves (sample,), evenly spaced from the axis outwards, and constant beyond the last sample.

        Parameters
        ----------
        centre_px : (row, column)
            Position of the axis.
        samples_per_px : float
        tangential, radial : arrays
            Ratio of ideal to real distance, and derivative of the ideal by the real distance.
        factor : array
            Factor on the averages.
        last_px : float
            The distance beyond which the picture is black.
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
        The capture for each plane: views of the same shape, whose rows or columns may be reversed. The area outside is
        black.
    centre_px : (row, column)
        Position of the axis in each of them.
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
    """Views of a capture as a structure for the loop."""
    if len(captures) > 4 or any(view.dtype != np.float32 or view.ndim != 2 or view.shape != captures[0].shape
                                or any(step % 4 for step in view.strides) for view in captures):
        raise ValueError(f"captures are {[(str(view.dtype), view.shape) for view in captures]}: expected up to four "
                         "float32 arrays (row, column) of the same shape")
    addresses = (view.ctypes.data for view in captures)
    rows, columns = ([view.strides[axis] // 4 for view in captures] for axis in (0, 1))
    structure = CAPTURE(planes=len(captures), rows=captures[0].shape[0], columns=captures[0].shape[1],
                        centre_row=centre_px[0], centre_column=centre_px[1])
    for plane, values in enumerate(zip(addresses, rows, columns, strict=True)):
        structure.first[plane], structure.row_step[plane], structure.step[plane] = values
    return structure
