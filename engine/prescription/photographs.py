"""Agreement: how closely a design agrees with photographs through real copies of the lens."""

from dataclasses import dataclass

import numpy as np

from ..runtime.errors import LensError
from ..runtime.values import Value

FIGURES = {"illumination": "illumination ± {:.2f}", "distortion_um": "distortion ± {:.0f} µm",
           "lateral_colour_um": "lateral colour ± {:.0f} µm"}
"""The figures of an Agreement, and their text."""
NOT_COMPARED = "not compared with photographs"
MM_PER_M = 1e3


@dataclass(frozen=True, eq=False, repr=False)
class Vignetting(Value):
    """The light of an even field at one f-number and focus.

    Attributes
    ----------
    f_number : float
    focus_mm : float
        From the entrance pupil; inf for infinity.
    heights_mm : array (height,)
        Ascending distances from the axis, more than 0.
    light : array (height,)
        Relative to the axis.
    """

    f_number: float
    focus_mm: float
    heights_mm: np.ndarray
    light: np.ndarray

    def __str__(self):
        at = "infinity" if np.isinf(self.focus_mm) else f"{self.focus_mm / MM_PER_M:.3g} m"
        return f"f/{self.f_number:g} at {at}"


@dataclass(frozen=True)
class Agreement:
    """Largest differences from photographs, up to 0.95 of the half diagonal.

    Attributes
    ----------
    source : str
        Of the photographs.
    date : str
        Of the comparison, such as 2026-11-29.
    illumination : float or None
        Of light relative to the axis: of rims fitted to photographs, at the f-stops and distances that were left out.
        None if it was not compared; so also the others.
    distortion_um, lateral_colour_um : float or None
        Of chief rays' distances from the axis, with the focal length free, and of the distances between red or blue and
        green.

    Raises
    ------
    LensError
        A figure is negative or not finite.
    """

    source: str
    date: str = ""
    illumination: float | None = None
    distortion_um: float | None = None
    lateral_colour_um: float | None = None

    def __post_init__(self) -> None:
        for name, value in self.figures.items():
            if not (np.isfinite(value) and value >= 0):
                raise LensError("photographs", name, value, "expected a number from 0")

    @property
    def figures(self) -> dict[str, float]:
        """The figures that were compared, by name."""
        return {name: value for name in FIGURES if (value := getattr(self, name)) is not None}

    def __str__(self):
        texts = [FIGURES[name].format(value) for name, value in self.figures.items()]
        return f"compared with photographs of this lens: {', '.join(texts)} ({self.source})"
