"""The entrance pupil of a lens and the depth in focus as seen from it, to first order."""

import numpy as np
from numpy.typing import ArrayLike

from .lens import Lens


def entrance_pupil_diameter_mm(lens: Lens) -> float:
    """Diameter of the entrance pupil, from the lens's f-number and magnification; its height, for a squeezed picture.

    By the sine condition the marginal ray leaves an object on the axis at the angle u with sin u = |m| sin u', where
    sin u' = 0.5 / rim_f_number; it meets the pupil's rim, S tan u off the axis at the distance S. For an object
    at infinity the ray enters at the height f sin u'. For the bundled lenses that is within 5 % of the diameter by
    paraxial rays: the f-number is that of real ones.
    """
    return entrance_pupil_size_mm(lens)[1]


def entrance_pupil_size_mm(lens: Lens) -> tuple[float, float]:
    """Width and height of the light of an in-focus point on the axis in the plane of the entrance pupil.

    The image-side cone of a round stop is round: u' is the same in both sections. The magnification along the width is
    that of the height over the squeeze, and by the sine condition in this section, so is sin u. The pupil of a 2x
    anamorphic lens is half as wide as high.
    """
    sine = 0.5 / lens.rim_f_number
    if np.isinf(lens.object_distance_mm):
        return 2 * lens.efl_mm * sine / lens.squeeze, 2 * lens.efl_mm * sine
    across, upwards = (min(abs(lens.magnification) * sine / squeeze, 1 - 1e-9) for squeeze in (lens.squeeze, 1.0))
    distance_mm = lens.object_distance_mm + lens.entrance_pupil_mm
    return (2 * distance_mm * across / np.sqrt(1 - across**2), 2 * distance_mm * upwards / np.sqrt(1 - upwards**2))


def entrance_pupil_area_mm2(lens: Lens) -> float:
    """Cross section of that light, without the hole of a central obstruction."""
    return float(np.pi / 4 * np.prod(entrance_pupil_size_mm(lens)) * (1 - lens.central_obstruction**2))


def focus_nearness(lens: Lens, x_mm: ArrayLike = 0.0, y_mm: ArrayLike = 0.0) -> float | np.ndarray:
    """The inverse of the depth in focus, per mm; 0 for a lens focused at infinity.

    Parameters
    ----------
    lens : Lens
    x_mm, y_mm : arrays, optional
        Positions in the ideal image; by default on the axis.

    Returns
    -------
    float, or array if the plane of focus leans
    """
    nearness, (slope_x, slope_y) = 1 / (lens.object_distance_mm + lens.entrance_pupil_mm), lens.focus_slope
    if not (slope_x or slope_y):
        return nearness
    return nearness + slope_x * np.asarray(x_mm) + slope_y * np.asarray(y_mm)


def focus_rise(lens: Lens) -> np.ndarray:
    """Rise of the inverse depth in focus, per mm, with the tangents of angles to the right and up: array (2,)."""
    return lens.capture_focal_length_mm * np.divide(lens.focus_slope, (lens.squeeze, 1.0))
