"""The ideal picture: each pixel is the average of a capture over the pixel's footprint."""

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


@dataclass(frozen=True, eq=False)
class MeshGeometry:
    """The lens data for `footprints`, on a coarse mesh over the pixels of the picture."""

    _mesh: np.ndarray
    _structure: Structure

    @classmethod
    def of(cls, mesh: np.ndarray, step_px: int) -> "MeshGeometry":
        """From values (row, column, 6) at every `step_px`th pixel, and up to one beyond the last.

        They are the rows and columns from the axis to the middle of the pixel's footprint in the capture; the height
        and width of the footprint; the factor on the average; and a number above 1 where the picture is black.
        """
        mesh = np.ascontiguousarray(mesh, np.float64)
        return cls(mesh, GEOMETRY(mesh=address(mesh, np.float64), mesh_rows=mesh.shape[0], mesh_columns=mesh.shape[1],
                                  mesh_step=step_px))

    @property
    def nbytes(self) -> int:
        return self._mesh.nbytes


def footprints(geometry: RadialGeometry | MeshGeometry, capture: np.ndarray, centre_px: tuple[float, float],
               rows: slice, out: np.ndarray) -> None:
    """Write these rows of a picture, by index of `out`.

    Parameters
    ----------
    geometry : RadialGeometry or MeshGeometry
    capture : float32 array (row, column, plane)
        One plane, or four, flipped so that rows and columns run away from the axis. The area outside is black.
    centre_px : (row, column)
        Position of the axis in all planes.
    rows : slice
    out : float32 array (plane, row, column)

    Raises
    ------
    ValueError
    """
    loops, variant = chosen()
    first, end, _ = rows.indices(out.shape[1])
    check(loops.lf_footprints(variant, byref(geometry._structure), byref(_capture(capture, centre_px)), first, end,
                              byref(picture(out))))


def _capture(capture, centre_px):
    """The structure for the loop. Only rows may be apart."""
    if capture.dtype != np.float32 or capture.ndim != 3 or not capture[:1].flags.c_contiguous:
        raise ValueError(f"capture is {capture.dtype} of shape {capture.shape} and strides {capture.strides}: expected "
                         "float32 (row, column, plane) with contiguous rows")
    rows, columns, planes = capture.shape
    return CAPTURE(capture.ctypes.data, planes, rows, columns, capture.strides[0] // 4, *centre_px)
