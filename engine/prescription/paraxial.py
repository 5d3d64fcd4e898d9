"""First-order figures of a lens, by matrices of height and reduced angle (y, n u).

They describe the undisturbed design: poses, including turns about the axis, are ignored.
"""

from dataclasses import dataclass

import numpy as np

from ..runtime.errors import LensError
from .prescription import Prescription
from .surfaces import vertex_curvature


@dataclass(frozen=True, eq=False)
class FirstOrder:
    """Paraxial figures of a section of the lens at the reference wavelength.

    Attributes
    ----------
    efl_mm : float
    image_distance_mm : float
        From the last surface to the image of the object.
    magnification : float
        0 for an object at infinity.
    entrance_pupil_mm, exit_pupil_mm : float
        From the first surface, and from the last, towards the image.
    front_focus_mm : float
        From the first surface, away from the image.
    stop_semi_aperture_mm : float
        The size that gives the lens the prescription's aperture.
    marginal_heights_mm : array (surface,)
        Heights of the marginal ray, through the stop's rim.
    marginal_slope : float
        Slope of the marginal ray behind the lens.
    """

    efl_mm: float
    image_distance_mm: float
    magnification: float
    entrance_pupil_mm: float
    exit_pupil_mm: float
    front_focus_mm: float
    stop_semi_aperture_mm: float
    marginal_heights_mm: np.ndarray
    marginal_slope: float

    @property
    def f_number(self) -> float:
        """Focal length over the entrance pupil's diameter, for a lens focused at infinity."""
        return self.efl_mm / (2 * abs(self.marginal_heights_mm[0]))


def first_order(prescription: Prescription, indices: np.ndarray, section: str = "y") -> FirstOrder:
    """Paraxial figures of a prescription's section along "x" or "y".

    Parameters
    ----------
    prescription : Prescription
    indices : array (surface + 1,)
        In front of each surface, and behind the last.
    section : str

    Raises
    ------
    LensError
        A lens without positive power.
    """
    last, stop = len(prescription.surfaces) - 1, prescription.stop_index
    total = _matrix(prescription, indices, section, 0, last)
    if not total[1, 0] < 0:
        along = "" if prescription.radial else f" along {section}"
        raise LensError(prescription.name, f"focal length{along}",
                        "infinite" if total[1, 0] == 0 else f"{-1 / total[1, 0]:g} mm", "expected a lens of positive "
                                                                                        "power")
    marginal = np.array([1.0, 0.0] if np.isinf(prescription.object_distance_mm)
                        else [prescription.object_distance_mm, 1.0])
    height, slope = total @ marginal
    to_stop = _before(prescription, indices, section, stop)
    stop_mm = _stop_semi_aperture_mm(prescription, to_stop, total, marginal)
    scale = stop_mm / abs((to_stop @ marginal)[0])
    heights = [(_before(prescription, indices, section, number) @ marginal)[0] for number in range(last + 1)]
    exit_height, exit_slope = _matrix(prescription, indices, section, stop, last) @ (0.0, 1.0)
    return FirstOrder(
        efl_mm=-1 / total[1, 0], image_distance_mm=-height / slope if slope else np.inf,
        magnification=0.0 if np.isinf(prescription.object_distance_mm) else 1 / slope,
        entrance_pupil_mm=to_stop[0, 1] / to_stop[0, 0],
        exit_pupil_mm=-exit_height / exit_slope if exit_slope else np.inf,
        front_focus_mm=-total[1, 1] / total[1, 0], stop_semi_aperture_mm=stop_mm,
        marginal_heights_mm=scale * np.array(heights), marginal_slope=scale * slope)


def _matrix(prescription, indices, section, first, last):
    """Matrix from in front of surface `first` to behind surface `last`."""
    matrix = np.eye(2)
    for number in range(first, last + 1):
        surface = prescription.surfaces[number]
        power = (indices[number + 1] - indices[number]) * vertex_curvature(surface, section)
        matrix = np.array([[1.0, 0.0], [-power, 1.0]]) @ matrix
        if number < last:
            matrix = _gap(surface.thickness_mm, indices[number + 1]) @ matrix
    return matrix


def _before(prescription, indices, section, number):
    """Matrix from in front of the first surface to in front of another."""
    if number == 0:
        return np.eye(2)
    gap = _gap(prescription.surfaces[number - 1].thickness_mm, indices[number])
    return gap @ _matrix(prescription, indices, section, 0, number - 1)


def _gap(thickness_mm, index):
    return np.array([[1.0, thickness_mm / index], [0.0, 1.0]])


def _stop_semi_aperture_mm(prescription, to_stop, total, marginal):
    """The marginal ray's height at the stop for the prescription's aperture."""
    kind, value = prescription.aperture
    at_stop = abs((to_stop @ marginal)[0])
    if kind == "stop":
        return value
    if kind == "entrance_pupil_diameter_mm":
        return abs(to_stop[0, 0]) * value / 2
    if kind == "f_number":
        return abs(to_stop[0, 0]) / -total[1, 0] / value / 2
    if kind == "working_f_number":
        return at_stop * 0.5 / (abs((total @ marginal)[1]) * value)
    return at_stop / marginal[1] * np.tan(np.arcsin(value))
