"""The pinhole camera equivalent to a lens: the pixel pitch of its picture on the lens's sensor."""

from dataclasses import dataclass

import numpy as np

from .lens import Lens


@dataclass(frozen=True)
class Pinhole:
    """The first-order figures of a lens that its pinhole camera depends on, as in `Lens`."""

    sensor_mm: tuple[float, float]
    capture_focal_length_mm: float
    squeeze: float


def fitting_pitch_um(lens: Lens | Pinhole, frame_px: tuple[int, int]) -> float:
    """Pixel pitch at which the frame, in rows and columns, exactly fits in the lens's sensor.

    The sensor is turned with the frame: for a portrait picture, its longer side is upright. The sensor of an anamorphic
    lens is not, because its cylinders stay upright on the camera: a portrait picture is a crop of its sensor's width.
    """
    return 1e3 * float(np.divide(turned_sensor_mm(lens, frame_px)[::-1], frame_px).min())


def turned_sensor_mm(lens: Lens | Pinhole, frame_px: tuple[int, int]) -> tuple[float, float]:
    """Width and height of a lens's sensor, turned with the frame as `fitting_pitch_um` does."""
    width_mm, height_mm = lens.sensor_mm
    rows, columns = frame_px
    turned = lens.squeeze == 1 and (rows > columns) != (height_mm > width_mm)
    return (height_mm, width_mm) if turned else (width_mm, height_mm)


def field_of_view_deg(focal_mm: float, side_mm: float) -> float:
    """Field of view of a pinhole camera along a side of its sensor."""
    return 2 * np.degrees(np.arctan(side_mm / (2 * focal_mm)))


def fov_pitch_um(lens: Lens | Pinhole, columns: int, fov_deg: float) -> float:
    """Pixel pitch of a pinhole picture of this horizontal field of view, in the lens's image plane."""
    width_mm = 2 * np.tan(np.radians(fov_deg) / 2) * lens.capture_focal_length_mm
    return 1e3 * width_mm / columns
