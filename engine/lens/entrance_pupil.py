"""The entrance pupil of a lens and the depth in focus as seen from it, to first order."""

import numpy as np

from .lens import Lens


def entrance_pupil_diameter_mm(lens: Lens) -> float:
    """Diameter of the entrance pupil, from the lens's f-number and magnification.

    By the sine condition the marginal ray leaves an object on the axis at the angle u with sin u = |m| sin u', where
    sin u' = 0.5 / f_number_effective; it meets the pupil's rim, S tan u off the axis at the distance S. For an object
    at infinity the ray enters at the height f sin u'. For the bundled lenses that is within 5 % of the diameter by
    paraxial rays: the f-number is that of real ones.
    """
    sine = 0.5 / lens.f_number_effective
    if np.isinf(lens.object_distance_mm):
        return 2 * lens.efl_mm * sine
    object_sine = min(abs(lens.magnification) * sine, 1 - 1e-9)
    return 2 * (lens.object_distance_mm + lens.entrance_pupil_mm) * object_sine / np.sqrt(1 - object_sine**2)


def focus_nearness(lens: Lens) -> float:
    """The inverse of the depth in focus, per mm; 0 for a lens focused at infinity."""
    return 1 / (lens.object_distance_mm + lens.entrance_pupil_mm)
