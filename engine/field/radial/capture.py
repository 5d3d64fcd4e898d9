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
        raise ImageError("radiance", "squeeze", f"{capture.squeeze:.3g}",
                         f"{lens.name} is not anamorphic and needs an unsqueezed capture: render again through it")
    lens_focal_mm = lens.capture_focal_length_mm
    focal_mm = capture.focal_mm or lens_focal_mm

    def radius(paraxial_height_mm):
        shown, slope = capture.projection.radius(paraxial_height_mm / lens_focal_mm)
        return focal_mm * shown, focal_mm / lens_focal_mm * slope

    return None if capture.projection.is_plane and focal_mm == lens_focal_mm else radius


def light_extent_mm(lens: RadialLens) -> float:
    """Distance from the axis beyond which no light arrives; inf unless the lens data reach it."""
    return float(lens.real_height_mm[:, -1].max()) if lens.dark_beyond else np.inf


def reach_px(lens: RadialLens, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
             psf_radius_px: int) -> int:
    """See `overscan.reach_px`."""
    radius = capture_radius(capture, lens)
    real_mm = np.linspace(0, min(capture.frame().farthest_px * capture.pitch_um * 1e-3, light_extent_mm(lens)), 257)
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
    frame, pitch_mm = capture.frame(), capture.pitch_um * 1e-3
    edges = [[(centre + 0.5 + psf_radius_px, centre + 0.5), (n - 0.5 - centre + psf_radius_px, n - 0.5 - centre)]
             for n, centre in zip(frame.shape_px, frame.centre_px, strict=True)]
    along_mm = [np.concatenate([np.linspace(0, edge_px, 65) for edge_px, _ in pair]) * pitch_mm for pair in edges]
    beyond_px = [0.0, 0.0]
    for wavelength_nm in wavelengths_nm:
        field = FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name)
        for axis, (edge_px, end_px) in ((number, edge) for number, pair in enumerate(edges) for edge in pair):
            edge_mm = np.hypot(edge_px * pitch_mm, along_mm[1 - axis])
            real_mm = np.minimum(edge_mm, light_extent_mm(lens))
            paraxial_mm = field.paraxial_height_mm(real_mm)
            lit = np.divide(real_mm, edge_mm, out=np.ones_like(edge_mm), where=edge_mm > 0)
            ratio = lit * field.paraxial_per_real(real_mm, paraxial_mm)
            if radius:
                ratio = ratio * radius(paraxial_mm)[0] / np.maximum(paraxial_mm, np.finfo(float).tiny)
            beyond_px[axis] = max(beyond_px[axis], edge_px - end_px, (edge_px * ratio).max() - end_px)
    rows, columns = (int(np.ceil(beyond)) + 1 for beyond in beyond_px)
    return rows, columns
