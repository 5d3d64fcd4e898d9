"""Views: calibrated cameras, and their places in a scene."""

from dataclasses import dataclass

import numpy as np

from ..runtime.build_identity import MARK
from .fit import Calibration


@dataclass(frozen=True, eq=False)
class View:
    """A calibrated camera.

    Attributes
    ----------
    calibration : Calibration
    pose : array (4, 4) or None
        From the camera's axes, x to the right, y upwards, z backwards, to the scene's, in metres; None without a scene.
    picture : str
        Path of the camera's picture, relative to the calibration's file; "" without a scene.
    """

    calibration: Calibration
    pose: np.ndarray | None = None
    picture: str = ""


def summary(calibration: Calibration) -> str:
    """What was calibrated, and how closely, in one line."""
    focus = "infinity" if np.isinf(calibration.focus_mm) else f"{calibration.focus_mm / 1e3:.4g} m"
    name = " ".join(calibration.lens.split())  # one line, whatever a user's file contains
    return (f"{name}, f/{calibration.f_number:.3g}, focused at {focus}, {calibration.wavelength_nm:g} nm: "
            f"{calibration.model.name}, RMS {calibration.rms_px:.3f} px, largest {calibration.largest_px:.3f} px")


def origin(calibration: Calibration) -> str:
    """The line of a file about its origin."""
    return f"{MARK}: {summary(calibration)}"
