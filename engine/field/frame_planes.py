"""Planes of a lens image's frame: relative illumination, depth with distortion, and the view of a pinhole."""


import numpy as np
import scipy

from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens
from .field_map import field_map
from .in_capture import in_capture


def relative_illumination(lens: Lens, frame: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """Relative illumination of pixels, constant beyond the lens data: float32 array (row, column), 1 on the axis."""
    x_mm, y_mm = frame.axes_mm()
    field = field_map(lens).at_wavelength(wavelength_nm)
    return field.relative_illumination(x_mm[None, :], y_mm[:, None]).astype(np.float32)


def nearest_samples(plane: np.ndarray, lens: Lens, capture: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """Distort a plane of a capture as the lens does, without interpolation: each pixel takes the nearest value.

    Parameters
    ----------
    plane : array (row, column)
        Values that must not be mixed, such as depths: a mean would be between two objects.
    lens : Lens
    capture : PixelGrid
        The plane's pixel grid.
    wavelength_nm : float

    Returns
    -------
    array (row, column) of the frame
        Beyond the capture, the values at its edge continue.
    """
    frame = capture.frame()
    x_mm, y_mm = frame.axes_mm()
    field = field_map(lens).at_wavelength(wavelength_nm)
    row, column = (np.clip(np.rint(at), 0, n - 1).astype(np.intp) for at, n in zip(
        capture.index_of(*field.source_mm(x_mm[None, :], y_mm[:, None], capture)), capture.shape_px, strict=True))
    return plane[row, column]


def pinhole_view(planes: np.ndarray, lens: Lens, capture: PixelGrid) -> np.ndarray:
    """The frame as an ideal lens images it, interpolated linearly.

    Parameters
    ----------
    planes : array (plane, row, column)
        Of a capture.
    lens : Lens
    capture : PixelGrid

    Returns
    -------
    array (plane, row, column) of the frame
        Beyond the capture, the values at its edge continue.
    """
    frame = capture.frame()
    shows_ideal_image = capture.focal_mm in (None, lens.capture_focal_length_mm) and capture.squeeze == lens.squeeze
    if capture.projection.is_plane and shows_ideal_image:
        (above, left), (rows, columns) = capture.overscan_px, frame.shape_px
        return planes[:, above:above + rows, left:left + columns]
    x_mm, y_mm = frame.axes_mm()
    (x_mm, y_mm), _ = in_capture(tuple(np.meshgrid(x_mm, y_mm)), lens, capture)
    place_px = capture.index_of(x_mm, y_mm)
    return np.stack([scipy.ndimage.map_coordinates(plane, place_px, order=1, mode="nearest") for plane in planes])
