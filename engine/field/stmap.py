"""STMaps, by which compositors warp a picture: each pixel contains the position of its light in the source.

s runs from 0 at the left edge of the frame to 1 at the right, t from 0 at the *lower* edge to 1 at the upper. The
middle of the upper left pixel of W x H is s = 0.5 / W, t = 1 - 0.5 / H. Positions outside the frame are below 0 or
above 1; a source with overscan has light there.
"""


import numpy as np

from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens
from .field_map import field_map


def distort_map(lens: Lens, frame: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """Map that warps a pinhole picture to the lens picture: for each pixel, its position in the pinhole picture.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        The frame of both pictures, without overscan.
    wavelength_nm : float

    Returns
    -------
    float32 array (row, column, 3)
        s, t, and 1 if the position is inside the frame, else 0.
    """
    return _map(frame, field_map(lens).at_wavelength(wavelength_nm).source_mm)


def pinhole_px(lens: Lens, frame: PixelGrid, wavelength_nm: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns, as indices in the frame, of each pixel's light in the pinhole picture: two arrays
    (row, column). Arguments as for `distort_map`."""
    return _places_px(frame, field_map(lens).at_wavelength(wavelength_nm).source_mm)


def undistort_map(lens: Lens, frame: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """Map that warps the lens picture to a pinhole picture: the inverse of `distort_map`, with the same arguments."""
    return _map(frame, field_map(lens).at_wavelength(wavelength_nm).landing_mm)


def map_overscan_px(distort: np.ndarray) -> tuple[float, float, float, float]:
    """How far the pinhole picture must reach beyond the frame for a `distort_map`: to the left, upwards, to the right
    and downwards, in pixels; negative if less than the frame is needed."""
    rows, columns = distort.shape[:2]
    s, t = distort[..., 0], distort[..., 1]
    return (float(-s.min()) * columns + 0.5, float(t.max() - 1) * rows + 0.5, float(s.max() - 1) * columns + 0.5,
            float(-t.min()) * rows + 0.5)


def _map(frame, source_mm):
    """The map with the positions `source_mm(x_mm, y_mm)`."""
    (rows, columns), (row, column) = frame.shape_px, _places_px(frame, source_mm)
    s, t = (column + 0.5) / columns, 1 - (row + 0.5) / rows
    inside = (np.abs(s - 0.5) <= 0.5) & (np.abs(t - 0.5) <= 0.5)
    return np.stack([s, t, inside], axis=-1).astype(np.float32)


def _places_px(frame, source_mm):
    """Rows and columns of the positions `source_mm(x_mm, y_mm)` of the frame's pixels."""
    x_mm, y_mm = frame.axes_mm()
    return frame.index_of(*source_mm(x_mm[None, :], y_mm[:, None]))
