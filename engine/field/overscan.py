"""Captures: the camera that renders the scene for the lens, and its overscan beyond the frame.

A radiance picture is the scene as an ideal lens would image it on a plane. A lens with strong barrel distortion sees
such a large part of that plane that a fisheye camera, whose mapping is known, is the better capture.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..image.pixel_grid import FISHEYE, PLANE, PixelGrid
from ..lens import Lens
from .field_map import field_map

VIEWS = "lens", "camera"  # a capture shows the lens's view, or the view of the scene's camera
LARGEST_PLANE = 2.0  # times the pixels of the frame; a fisheye shows the same field in fewer


def choose_capture(lens: Lens, frame: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                   psf_radius_px: int) -> PixelGrid:
    """The grid of a capture for this lens: a plane, or a fisheye if the plane would exceed LARGEST_PLANE.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        The sensor's frame, with the axis in its middle.
    wavelengths_nm : sequence of float
    psf_radius_px : int
        Pixels that a PSF reaches from its centre.

    Returns
    -------
    PixelGrid
        The frame with its overscan.
    """
    places = field_map(lens)
    margins = places.overscan_px(replace(frame, projection=PLANE), wavelengths_nm, psf_radius_px)
    sides = [(n + 2 * margin) / (n + 2 * psf_radius_px) for n, margin in zip(frame.frame_px, margins, strict=True)]
    if sides[0] * sides[1] <= LARGEST_PLANE:
        return PixelGrid.around_frame(frame.frame_px, frame.pitch_um, margins)
    fisheye = replace(frame, projection=FISHEYE)
    return PixelGrid.around_frame(frame.frame_px, frame.pitch_um,
                                  places.overscan_px(fisheye, wavelengths_nm, psf_radius_px), FISHEYE)
