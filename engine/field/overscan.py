"""Captures: what camera shows the scene to the lens, and how much more than the frame it must see.

A radiance picture is the scene as an ideal lens would lay it on a plane. A lens with strong barrel distortion sees so
much of that plane that a fisheye camera, whose mapping is known, is the better capture.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..image.pixel_grid import FISHEYE, PLANE, PixelGrid
from .distortion import CaptureRadius, FieldGeometry

if TYPE_CHECKING:
    from ..lens import Lens

VIEWS = "lens", "camera"  # what a capture shows: the lens's own view, or that of the scene's camera
LARGEST_PLANE = 2.0  # times the pixels of the frame; a fisheye shows the same field in fewer


def capture_radius(capture: PixelGrid, lens: "Lens") -> CaptureRadius | None:
    """How a capture shows paraxial heights: None for a plane as large as the sensor's own, else a function.

    A fisheye capture is equidistant: a ray at the angle t from the axis, as seen from the entrance pupil, lies at
    f t from the middle, f being that of its pinhole; a plane shows it at f tan t. So both have the same scale on the
    axis.

    Returns
    -------
    callable (paraxial_height_mm) -> (radius_mm, slope), or None
    """
    own_mm = lens.capture_focal_length_mm
    scale = (capture.focal_mm or own_mm) / own_mm

    def on_plane(paraxial_height_mm):
        return scale * paraxial_height_mm, np.full_like(paraxial_height_mm, scale)

    def on_fisheye(paraxial_height_mm):
        tangent = paraxial_height_mm / own_mm
        return scale * own_mm * np.arctan(tangent), scale / (1 + tangent**2)

    if capture.projection != PLANE:
        return on_fisheye
    return None if scale == 1 else on_plane


def choose_capture(lens: "Lens", frame: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                   psf_radius_px: int) -> PixelGrid:
    """The grid of a capture for this lens: a plane, or a fisheye where that is beyond LARGEST_PLANE.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        The sensor's frame, the axis in its middle.
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


def reach_px(lens: "Lens", capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray, psf_radius_px: int) -> int:
    """Pixels that the frame's light may have come, from where a capture shows it to where it lands on the sensor.

    Parameters
    ----------
    lens, capture, wavelengths_nm, psf_radius_px
        As for `overscan_px`.
    """
    radius = capture_radius(capture, lens)
    real_mm = np.linspace(0, np.hypot(*capture.frame_px) / 2 * capture.pitch_um * 1e-3, 257)
    moved_mm = 0.0
    for wavelength_nm in wavelengths_nm:
        shown_mm = FieldGeometry(lens.at_wavelength(wavelength_nm), lens.name).paraxial_height_mm(real_mm)
        if radius:
            shown_mm = radius(shown_mm)[0]
        moved_mm = max(moved_mm, float(np.abs(shown_mm - real_mm).max()))
    return int(np.ceil(moved_mm / (capture.pitch_um * 1e-3))) + psf_radius_px + 1


def overscan_px(lens: "Lens", capture: PixelGrid, wavelengths_nm: Sequence[float] | np.ndarray,
                psf_radius_px: int) -> tuple[int, int]:
    """Rows and columns that a capture needs beyond the frame, for distortion and the reach of the PSFs.

    Parameters
    ----------
    lens, wavelengths_nm, psf_radius_px
        As for `choose_capture`.
    capture : PixelGrid
        Whose frame, pitch and projection count; its axis is taken to be in the middle.

    Returns
    -------
    (int, int), at least psf_radius_px + 1 each
    """
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
