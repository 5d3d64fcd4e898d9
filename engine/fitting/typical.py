"""The light of a typical lens wide open, and rims for a lens whose own are not known.

Photographs show that makers choose rims alike, whatever the focal length: wide open, half of the light that the
stopped-down lens passes arrives near the corner, and faster lenses lose a little more. The numbers of this rule are
fitted to the lenses for full frame in Lensfun's database (`validation/typical_light.py`), whose place of half the light
varies by a sixth. Estimates by other means, such as the drawings in patents, miss the light by twice as much.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..prescription.photographs import Vignetting
from ..prescription.prescription import TYPICAL, Prescription
from ..rays.rings import turned
from ..runtime.errors import LensError
from .even_light import EvenField
from .fit import with_rim_pair
from .lensfun import SHARES

STOPPED_DOWN = 4.0  # times the widest f-number: rims block no more light
DIAGONALS_MM, F_NUMBERS = (43.0, 80.0), (0.9, 5.7)  # of lenses like the measured ones: full frame to 6 x 6 cm


class TypicalLight(NamedTuple):
    """Light wide open relative to the light stopped down, both relative to the axis: 1 / (1 + (r / half)^steepness).

    Attributes
    ----------
    half : float
        The share r of the half diagonal at which it is a half, for f/2.
    by_f_number : float
        Power of the f-number with which this place grows.
    steepness : float
    """

    half: float
    by_f_number: float
    steepness: float

    def at(self, f_number: float, shares: np.ndarray) -> np.ndarray:
        """The relative light of a lens with this widest f-number at shares of the half diagonal: array (share,)."""
        return 1 / (1 + (shares / (self.half * (f_number / 2)**self.by_f_number))**self.steepness)


FULL_FRAME = TypicalLight(0.91, 0.26, 2.18)
"""Of lenses for full frame."""


def is_like_measured(prescription: Prescription) -> bool:
    """Whether the format and the widest f-number are about those of the lenses that the rule is fitted to."""
    diagonal_mm, f_number = np.hypot(*prescription.sensor_mm or (0.0, 0.0)), turned(prescription).f_number
    return bool(DIAGONALS_MM[0] < diagonal_mm < DIAGONALS_MM[1] and F_NUMBERS[0] < f_number < F_NUMBERS[1])


def with_typical_rims(prescription: Prescription, typical: TypicalLight = FULL_FRAME) -> Prescription:
    """A lens with rims that give it the light of a typical lens, and its origin in `provenance`.

    Raises
    ------
    LensError
        The lens states no sensor, or as `EvenField`.
    """
    if prescription.sensor_mm is None:
        raise LensError(prescription.name, "sensor_mm", "missing", "typical rims need the sensor of the lens: add it")
    heights_mm = SHARES * np.hypot(*prescription.sensor_mm) / 2
    field = EvenField(prescription, np.inf, np.array([0.0, *heights_mm]))
    stopped_down = field.through(STOPPED_DOWN * field.f_number).at([], np.zeros(0))[1:]
    light = stopped_down * typical.at(field.f_number, SHARES)
    sized = with_rim_pair(prescription, Vignetting(field.f_number, field.focus_mm, heights_mm, light))
    provenance = dict(prescription.provenance) | {"apertures": TYPICAL}
    return replace(sized, provenance=tuple(provenance.items()))
