"""The rays of a lens that meet the pixels of a frame: the data that a calibration fits."""

from dataclasses import dataclass

import numpy as np

from ..field.field_map import field_map
from ..image.pixel_grid import PixelGrid
from ..lens import Lens
from ..runtime.errors import LensError

SAMPLES = 61  # places along the longer side of the frame, edges included
LEAST_SAMPLES = 13  # along the shorter side
FISHEYE_DISTORTION = -0.25  # stronger barrel distortion: a plane would show mostly the corners


@dataclass(frozen=True, eq=False)
class FrameRays:
    """Chief rays of places on a frame, at one wavelength.

    Attributes
    ----------
    directions : array (place, 3)
        From the entrance pupil: to the right, downwards and forwards, with z = 1.
    pixels : array (place, 2)
        Columns and rows, as indices: 0, 0 is the middle of the upper left pixel.
    covered : float
        The fraction of the frame that the lens data cover; places beyond it are left out.
    distortion : float
        At the place farthest from the axis, relative to the distance from the axis.
    symmetric : bool
        Whether the lens is rotationally symmetric.
    focal_px : (float, float)
        Along rows and columns, on the axis, of a lens without distortion.
    axis_px : (float, float)
        Column and row of the optical axis.
    """

    directions: np.ndarray
    pixels: np.ndarray
    covered: float
    distortion: float
    symmetric: bool
    focal_px: tuple[float, float]
    axis_px: tuple[float, float]

    @property
    def tangents(self) -> tuple[float, float, float, float]:
        """The largest to the left, upwards, to the right and downwards."""
        (left, up, _), (right, down, _) = -self.directions.min(axis=0), self.directions.max(axis=0)
        return float(left), float(up), float(right), float(down)

    @property
    def fisheye(self) -> bool:
        """Whether only models of fisheyes describe the rays well."""
        return self.distortion < FISHEYE_DISTORTION


def frame_rays(lens: Lens, frame: PixelGrid, wavelength_nm: float) -> FrameRays:
    """The rays of a frame, evenly spaced from edge to edge.

    Parameters
    ----------
    lens : Lens
    frame : PixelGrid
        Without overscan.
    wavelength_nm : float

    Raises
    ------
    LensError
        The wavelength is outside the lens data, or the frame is.
    """
    field = field_map(lens).at_wavelength(wavelength_nm)
    rows, columns = (np.linspace(-0.5, side - 0.5, max(LEAST_SAMPLES, round(SAMPLES * side / max(frame.shape_px))))
                     for side in frame.shape_px)
    column, row = (axis.ravel() for axis in np.meshgrid(columns, rows))
    x_mm, y_mm = frame.position_mm(row, column)
    inside = field.within(x_mm, y_mm)
    if not inside.any():
        raise LensError(lens.name, "frame", "outside the lens data", "move the sensor towards the optical axis")
    source_x_mm, source_y_mm = field.source_mm(x_mm[inside], y_mm[inside])
    focal_mm, pitch_mm = lens.capture_focal_length_mm, frame.pitch_um * 1e-3
    directions = np.stack([source_x_mm * lens.squeeze / focal_mm, -source_y_mm / focal_mm,
                           np.ones_like(source_x_mm)], axis=1)
    farthest = np.argmax(np.hypot(x_mm[inside], y_mm[inside]))
    ideal_mm, real_mm = (np.hypot(x[farthest], y[farthest]) for x, y in (
        (source_x_mm, source_y_mm), (x_mm[inside], y_mm[inside])))
    return FrameRays(directions, np.stack([column, row], axis=1)[inside], float(inside.mean()),
                     float(real_mm / ideal_mm - 1), field_map(lens).rotationally_symmetric,
                     (focal_mm / lens.squeeze / pitch_mm, focal_mm / pitch_mm), frame.centre_px[::-1])
