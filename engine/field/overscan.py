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
    margins = overscan_px(lens, replace(frame, projection=PLANE), wavelengths_nm, psf_radius_px)
    sides = [(n + 2 * margin) / (n + 2 * psf_radius_px) for n, margin in zip(frame.frame_px, margins, strict=True)]
    if sides[0] * sides[1] <= LARGEST_PLANE:
        return PixelGrid.around_frame(frame.frame_px, frame.pitch_um, margins)
    fisheye = replace(frame, projection=FISHEYE)
    return PixelGrid.around_frame(frame.frame_px, frame.pitch_um,
                                  overscan_px(lens, fisheye, wavelengths_nm, psf_radius_px), FISHEYE)


def reach_px(lens: Lens, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray, psf_radius_px: int) -> int:
    """Largest distance in pixels between light in a capture and on the sensor, for light in the frame.

    Parameters
    ----------
    lens, capture, wavelengths_nm, psf_radius_px
        As for `overscan_px`.
    """
    return field_map(lens).reach_px(capture, wavelengths_nm, psf_radius_px)


def overscan_px(lens: Lens, capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                psf_radius_px: int) -> tuple[int, int]:
    """Rows and columns that a capture needs beyond the frame, for distortion and the reach of the PSFs.

    Parameters
    ----------
    lens, wavelengths_nm, psf_radius_px
        As for `choose_capture`.
    capture : PixelGrid
        Only its frame, pitch and projection count; the axis is assumed to be in the middle.

    Returns
    -------
    (int, int), at least psf_radius_px + 1 each
    """
    return field_map(lens).overscan_px(capture, wavelengths_nm, psf_radius_px)
