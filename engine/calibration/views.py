"""Views: calibrated cameras, and their places in a scene."""

import math
from dataclasses import dataclass

import numpy as np

from ..runtime.build_identity import MARK
from .fit import Calibration

MOST_ANGLE_DEG = 70.0


@dataclass(frozen=True, eq=False)
class View:
    """A calibrated camera.

    Attributes
    ----------
    calibration : Calibration
    pose : array (4, 4) or None
        From the camera's axes, x to the right, y upwards, z backwards, to the scene, in metres; None without a scene.
    picture : str
        Path of the camera's picture, relative to the calibration's file; "" without a scene.
    """

    calibration: Calibration
    pose: np.ndarray | None = None
    picture: str = ""


def summary(calibration: Calibration) -> str:
    """The lens, its settings, the model and its residual, in one line."""
    focus = "infinity" if np.isinf(calibration.focus_mm) else f"{calibration.focus_mm / 1e3:.4g} m"
    name = " ".join(calibration.lens.split())  # one line, whatever a user's file contains
    return (f"{name}, f/{calibration.f_number:.3g}, focused at {focus}, {calibration.wavelength_nm:g} nm: "
            f"{calibration.model.name}, RMS {calibration.rms_px:.3f} px, largest {calibration.largest_px:.3f} px")


def overscan_lines(calibration: Calibration) -> list[str]:
    """The line about the overscan of a picture that is undistorted without loss; none for very wide fisheyes, which a
    plane shows only in part."""
    if calibration.largest_angle_deg > MOST_ANGLE_DEG:
        return []
    return [overscan_line(calibration.overscan_px, calibration.size_px)]


def overscan_line(overscan_px: tuple[float, float, float, float], size_px: tuple[int, int]) -> str:
    """Overscan to the left, upwards, to the right and downwards, in pixels and as Nuke's format, in one line.

    Parameters
    ----------
    overscan_px : (float, float, float, float)
    size_px : (int, int)
        Columns and rows of the frame.
    """
    left, up, right, down = (max(0, math.ceil(side_px)) for side_px in overscan_px)
    columns, rows = size_px
    width, height = left + columns + right, up + rows + down
    return (f"undistorted: {left} px more on the left, {right} on the right, {up} above, {down} below; in Nuke, "
            f'nuke.addFormat("{width} {height} {left} {down} {left + columns} {down + rows} 1 undistorted")')


def origin(calibration: Calibration) -> str:
    """The line of a file about its origin."""
    return f"{MARK}: {summary(calibration)}"
