"""STMaps: where each pixel of a picture takes its light from in another, for compositors that warp by such a picture.

A map has, at each pixel, the place in its source: s from 0 at the left edge of the frame to 1 at the right, t from 0 at
the *lower* edge to 1 at the upper. The middle of the upper left pixel of W x H is s = 0.5 / W, t = 1 - 0.5 / H. Places
outside the frame are below 0 or above 1, where a source with overscan has light.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..image.pixel_grid import PixelGrid
from .distortion import FieldGeometry

if TYPE_CHECKING:
    from ..lens.lens import Lens


def distort_map(lens: "Lens", frame: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """Makes the lens's picture of a pinhole's: where each pixel of the lens's frame lies in the pinhole's.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        Of both pictures, without overscan.
    wavelength_nm : float

    Returns
    -------
    float32 array (row, column, 3)
        s, t, and 1 where the place is inside the frame, else 0.
    """
    field = FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name)
    return _map(frame, lambda real_mm: field.paraxial_per_real(real_mm, field.paraxial_height_mm(real_mm)))


def undistort_map(lens: "Lens", frame: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """Makes a pinhole's picture of the lens's: the inverse of `distort_map`, and like it."""
    field = FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name)

    def ratio(paraxial_mm):
        real_mm = field.real_height_mm(paraxial_mm)
        return 1 / field.paraxial_per_real(real_mm, paraxial_mm)

    return _map(frame, ratio)


def _map(frame, ratio):
    """The map by which a place at some height about the axis takes its light from `ratio(height_mm)` times that."""
    x_mm, y_mm = frame.axes_mm()
    scale = ratio(np.hypot(x_mm[None, :], y_mm[:, None]))
    (rows, columns), (row, column) = frame.shape_px, frame.centre_px
    s = (column + scale * x_mm[None, :] / (frame.pitch_um * 1e-3) + 0.5) / columns
    t = 1 - (row - scale * y_mm[:, None] / (frame.pitch_um * 1e-3) + 0.5) / rows
    inside = (np.abs(s - 0.5) <= 0.5) & (np.abs(t - 0.5) <= 0.5)
    return np.stack([s, t, inside], axis=-1).astype(np.float32)
