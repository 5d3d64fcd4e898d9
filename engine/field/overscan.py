"""Captures: what camera shows the scene to the lens, and how much more than the frame it must see.

A radiance picture is the scene as an ideal lens would lay it on a plane. A lens with strong barrel distortion sees so
much of that plane that a fisheye camera, whose mapping is known, is the better capture.
"""

import numpy as np

from ..image.spectral_image import FISHEYE, PLANE
from .distortion import FieldGeometry

LARGEST_PLANE = 2.0  # times the pixels of the frame; a fisheye shows the same field in fewer


def image_radius(projection, lens):
    """How a projection shows paraxial heights: None for a plane, else a function.

    A fisheye capture is equidistant: a ray at the angle t from the axis, as seen from the entrance pupil, lies at
    f t from the middle, f being the lens's `capture_focal_length_mm`. So both have the same scale on the axis.

    Returns
    -------
    callable (paraxial_height_mm) -> (radius_mm, slope), or None
    """
    if projection == PLANE:
        return None
    focal_mm = lens.capture_focal_length_mm

    def radius(paraxial_height_mm):
        tangent = paraxial_height_mm / focal_mm
        return focal_mm * np.arctan(tangent), 1 / (1 + tangent**2)

    return radius


def choose_capture(lens, frame_px, pitch_um, wavelengths_nm, psf_radius_px):
    """The projection and overscan that a capture for this lens needs: a plane, or a fisheye beyond LARGEST_PLANE.

    Parameters as for `overscan_px`.

    Returns
    -------
    projection : "plane" or "equidistant"
    overscan_px : (int, int)
    """
    margins = overscan_px(lens, frame_px, pitch_um, wavelengths_nm, psf_radius_px)
    sides = [(n + 2 * margin) / (n + 2 * psf_radius_px) for n, margin in zip(frame_px, margins)]
    if sides[0] * sides[1] <= LARGEST_PLANE:
        return PLANE, margins
    return FISHEYE, overscan_px(lens, frame_px, pitch_um, wavelengths_nm, psf_radius_px, FISHEYE)


def overscan_px(lens, frame_px, pitch_um, wavelengths_nm, psf_radius_px, projection=PLANE):
    """Rows and columns that a capture needs beyond the frame, for distortion and the reach of the PSFs.

    Parameters
    ----------
    lens : Lens
    frame_px : (int, int)
        Rows and columns of the sensor's frame, the axis in its middle.
    pitch_um : float
    wavelengths_nm : sequence of float
    psf_radius_px : int
        Pixels that a PSF reaches from its centre.
    projection : "plane" or "equidistant"

    Returns
    -------
    (int, int), at least psf_radius_px + 1 each
    """
    radius = image_radius(projection, lens)
    half = np.array(frame_px) / 2 + psf_radius_px
    side_mm = [np.linspace(0, extent, 65) * pitch_um * 1e-3 for extent in half]
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
    return tuple(int(np.ceil(needed[axis] - frame_px[axis] / 2)) + 1 for axis in (0, 1))
