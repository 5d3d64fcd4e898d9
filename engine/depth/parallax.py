"""Parallax: how far an out-of-focus image moves from where the same direction's light lands in focus.

The pinhole of a capture is in the middle of the entrance pupil on the axis. The pupil of oblique light is elsewhere: a
fisheye's moves by several diameters. Near things are then seen in other directions than things in focus.
"""

import numpy as np

from ..field.field_map import RaySample, field_map
from ..field.in_capture import from_capture
from ..image.pixel_grid import PixelGrid
from ..lens import Lens

NODES = 33  # along each side of a capture, with linear interpolation between them
STEP_PX = 0.1  # in the capture, for the change on the sensor


def parallax_per_nearness_px(lens: Lens, rays: RaySample, capture: PixelGrid, place: tuple[slice, slice],
                             wavelength_nm: float) -> np.ndarray:
    """Movement of an image on the sensor with its inverse depth.

    Parameters
    ----------
    lens : Lens
    rays : RaySample
        Of the pixels of the capture's frame.
    capture : PixelGrid
    place : (slice, slice)
        Rows and columns of the capture.
    wavelength_nm : float

    Returns
    -------
    float32 array (row, column)
        In rows of the sensor times mm.
    """
    rows, columns = (np.linspace(side.start, side.stop - 1, NODES) for side in place)
    nodes = _at_places(lens, rays, capture, rows[:, None], columns, wavelength_nm)
    down, across = (_linear(side.stop - side.start) for side in place)
    return down @ nodes @ across.T


def _at_places(lens, rays, capture, rows, columns, wavelength_nm):
    """The same at rows and columns of the capture; 0 beyond 90 degrees from the axis."""
    field, pitch_mm = field_map(lens).at_wavelength(wavelength_nm), capture.pitch_um * 1e-3
    ideal_mm = np.nan_to_num(np.stack(np.broadcast_arrays(
        *from_capture(*capture.position_mm(rows, columns), lens, capture))))
    landed_mm = np.stack(field.landing_mm(*ideal_mm))
    _, moved_px, light, _ = rays.bundles(*(landed_mm / pitch_mm * _columns(capture)))
    middle_px = np.moveaxis((light[..., None] * moved_px).sum(axis=-2), -1, 0) / np.maximum(light.sum(axis=-1), 1e-30)
    step = STEP_PX / max(float(np.abs(middle_px).max()), 1e-30)
    focal_mm = capture.focal_mm or lens.capture_focal_length_mm
    per_px = pitch_mm * lens.capture_focal_length_mm / focal_mm * np.array([capture.squeeze / lens.squeeze, 1.0])
    moved_mm = np.stack(field.landing_mm(*(ideal_mm + step * per_px[:, None, None] * middle_px)))
    return (np.hypot(*(moved_mm - landed_mm)) / (step * pitch_mm)).astype(np.float32)


def _columns(capture):
    """Pixels of the capture along x and y in one of the sensor: array (2, 1, 1)."""
    return np.array([capture.across, 1.0]).reshape(2, 1, 1)


def _linear(count):
    """Weights of NODES even nodes at this number of places from the first to the last: float32 array (place, node)."""
    at = np.linspace(0, NODES - 1, count)[:, None]
    return np.maximum(1 - np.abs(at - np.arange(NODES)), 0).astype(np.float32)
