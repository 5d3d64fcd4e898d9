"""Planes of a lens image's frame for compositing: relative illumination, and the scene's depth with distortion."""


import numpy as np

from ..image.pixel_grid import PixelGrid
from ..lens.lens import Lens
from .field_map import field_map


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
    x_mm, y_mm = field_map(lens).at_wavelength(wavelength_nm).source_mm(x_mm[None, :], y_mm[:, None], capture)
    pitch_mm = capture.pitch_um * 1e-3
    row, column = (np.clip(np.rint(at), 0, n - 1).astype(np.intp) for at, n in zip(
        (capture.centre_px[0] - y_mm / pitch_mm, capture.centre_px[1] + x_mm / pitch_mm), capture.shape_px,
        strict=True))
    return plane[row, column]
