"""Captures for a rotationally symmetric lens: their radius for each field height, and their overscan."""

from collections.abc import Sequence

import numpy as np

from ...image.pixel_grid import PixelGrid
from ...lens import RadialLens
from ...runtime.errors import ImageError
from .distortion import CaptureRadius, FieldGeometry


def capture_radius(capture: PixelGrid, lens: RadialLens) -> CaptureRadius | None:
    """The radius of paraxial heights in a capture, as a function; None for a plane with the sensor's scale.

    A capture shows a ray by its angle from the axis at the entrance pupil, in focal lengths of its pinhole.

    Returns
    -------
    callable (paraxial_height_mm) -> (radius_mm, slope), or None

    Raises
    ------
    ImageError
        The capture is squeezed.
    """
    if capture.squeeze != lens.squeeze:
        raise ImageError("image", "squeeze", capture.squeeze, f"expected {lens.squeeze:g}, as of {lens.name}")
    lens_focal_mm = lens.capture_focal_length_mm
    focal_mm = capture.focal_mm or lens_focal_mm

    def radius(paraxial_height_mm):
        shown, slope = capture.projection.radius(paraxial_height_mm / lens_focal_mm)
        return focal_mm * shown, focal_mm / lens_focal_mm * slope

    return None if capture.projection.is_plane and focal_mm == lens_focal_mm else radius


def reach_px(lens: RadialLens, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
             psf_radius_px: int) -> int:
    """See `overscan.reach_px`."""
    radius = capture_radius(capture, lens)
    real_mm = np.linspace(0, np.hypot(*capture.frame_px) / 2 * capture.pitch_um * 1e-3, 257)
    moved_mm = 0.0
    for wavelength_nm in wavelengths_nm:
        shown_mm = FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name).paraxial_height_mm(real_mm)
        if radius:
            shown_mm = radius(shown_mm)[0]
        moved_mm = max(moved_mm, float(np.abs(shown_mm - real_mm).max()))
    return int(np.ceil(moved_mm / (capture.pitch_um * 1e-3))) + psf_radius_px + 1


def overscan_px(lens: RadialLens, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                psf_radius_px: int) -> tuple[int, int]:
    """See `overscan.overscan_px`."""
    radius = capture_radius(capture, lens)
    half = np.array(capture.frame_px) / 2 + psf_radius_px
    side_mm = [np.linspace(0, extent, 65) * capture.pitch_um * 1e-3 for extent in half]
    needed = half.copy()
    for wavelength_nm in wavelengths_nm:
        field = FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name)
        for axis in (0, 1):
            edge_mm, along_mm = side_mm[axis][-1], side_mm[1 - axis]
            real_mm = np.hypot(edge_mm, along_mm)
            paraxial_mm = field.paraxial_height_mm(real_mm)
            ratio = field.paraxial_per_real(real_mm, paraxial_mm)
            if radius:
                ratio = ratio * radius(paraxial_mm)[0] / np.maximum(paraxial_mm, np.finfo(float).tiny)
            needed[axis] = max(needed[axis], half[axis] * ratio.max())
    rows, columns = (int(np.ceil(needed[axis] - capture.frame_px[axis] / 2)) + 1 for axis in (0, 1))
    return rows, columns
