"""What compositors want beside a lens image, pixel by pixel of its frame: relative illumination, and the scene's depth
where the lens puts it."""

from typing import TYPE_CHECKING

import numpy as np

from ..image.pixel_grid import PixelGrid
from .distortion import FieldGeometry, squeeze
from .overscan import capture_radius

if TYPE_CHECKING:
    from ..lens.lens import Lens


def relative_illumination(lens: "Lens", frame: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """Relative illumination of each pixel, held beyond the lens data: float32 array (row, column), 1 on the axis."""
    field, real_mm = _field_and_radius(lens, frame, wavelength_nm)
    return field.relative_illumination(field.paraxial_height_mm(real_mm)).astype(np.float32)


def nearest_samples(plane: np.ndarray, lens: "Lens", capture: PixelGrid, wavelength_nm: float) -> np.ndarray:
    """A plane of a capture through the lens's distortion, never mixed: each pixel takes the nearest one of the capture.

    Parameters
    ----------
    plane : array (row, column)
        Such as depths, whose means would lie between two objects, where nothing is.
    lens : Lens
    capture : PixelGrid
        Of the plane.
    wavelength_nm : float

    Returns
    -------
    array (row, column) of the frame
        Beyond the capture its nearest edge is held.
    """
    frame = capture.frame()
    field, real_mm = _field_and_radius(lens, frame, wavelength_nm)
    _, scale, _ = squeeze(real_mm, field, capture_radius(capture, lens))
    x_mm, y_mm = frame.axes_mm()
    pitch_mm = capture.pitch_um * 1e-3
    row, column = (np.clip(np.rint(at), 0, n - 1).astype(np.intp) for at, n in zip(
        (capture.centre_px[0] - scale * y_mm[:, None] / pitch_mm,
         capture.centre_px[1] + scale * x_mm[None, :] / pitch_mm), capture.shape_px, strict=True))
    return plane[row, column]


def _field_and_radius(lens, frame, wavelength_nm):
    x_mm, y_mm = frame.axes_mm()
    return (FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name), np.hypot(x_mm[None, :], y_mm[:, None]))
