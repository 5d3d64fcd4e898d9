"""Captures: the camera that renders the scene for the lens, and its overscan beyond the frame.

A radiance picture is the scene as an ideal lens would image it on a plane. A lens with barrel distortion sees a larger
part of that plane than its frame. A panorama with the lens's own distortion shows little more than the frame.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..image.projection import PLANE, Projection, fitted_projection
from ..lens import Lens
from .field_map import field_map

VIEWS = LENS_VIEW, CAMERA_VIEW = "lens", "camera"  # the field of view on the lens's own sensor, or the scene's camera's
MOST_PLANE = 1.15  # times the pixels of a panorama, whose samples take Cycles about 1.15 times as long
FIT_SAMPLES = 257
MOST_DOUBLINGS = 2  # of columns: a 2x lens has four
FARTHEST = 4.0  # half diagonals of the frame: no capture extends farther


def choose_capture(lens: Lens, frame: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                   psf_radius_px: int) -> PixelGrid:
    """The grid of a capture for this lens: a plane with its squeeze; or, for a lens that does not squeeze, a panorama
    with its distortion if the plane would exceed MOST_PLANE.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        The sensor's frame.
    wavelengths_nm : sequence of float
    psf_radius_px : int
        Pixels that a PSF reaches from its centre.

    Returns
    -------
    PixelGrid
        The frame with its overscan.
    """
    def capture(projection):
        grid = replace(frame, projection=projection, squeeze=lens.squeeze)
        return grid.with_overscan(field_map(lens).overscan_px(grid, wavelengths_nm, psf_radius_px))

    plane = capture(PLANE)
    if lens.squeeze != 1:
        return plane
    panorama = capture(lens_projection(lens, frame.framed(psf_radius_px)))
    return plane if np.prod(plane.shape_px) <= MOST_PLANE * np.prod(panorama.shape_px) else panorama


def columns_for_blur(lens: Lens) -> int:
    """The columns of layers of depth in a column of the sensor, a power of two: blur is then about as many of their
    columns wide as rows tall.

    The blur of a squeezed picture is its height over the square of the squeeze wide: often less than a pixel of the
    sensor, which would hide where in it one surface ends in front of another.
    """
    return 2 ** round(np.clip(2 * np.log2(lens.squeeze), 0, MOST_DOUBLINGS))


def lens_projection(lens: Lens, grid: PixelGrid) -> Projection:
    """The panorama that is closest to a lens's distortion over a grid, at the reference wavelength."""
    focal_mm = lens.capture_focal_length_mm
    last_mm = min(grid.farthest_px * grid.pitch_um * 1e-3, field_map(lens).light_extent_mm)
    real_mm = np.linspace(0, last_mm, FIT_SAMPLES)
    nm = float(lens.nearest_nm(lens.reference_wavelength_nm))
    ideal_mm, _ = field_map(lens).at_wavelength(nm).source_mm(real_mm, np.zeros_like(real_mm))
    return fitted_projection(real_mm / focal_mm, ideal_mm / focal_mm, FARTHEST * last_mm / focal_mm)
