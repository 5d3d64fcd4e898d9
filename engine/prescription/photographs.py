"""Agreement: how closely a design agrees with photographs through real copies of the lens."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..runtime.errors import LensError
from ..runtime.values import Value

FIGURES = {"illumination": "illumination ± {:.2f}", "distortion_um": "distortion ± {:.0f} µm",
           "lateral_colour_um": "lateral colour ± {:.0f} µm"}
"""The figures of an Agreement, and their text."""
NOT_COMPARED = "not compared with photographs"
MM_PER_M = 1e3
MOST_LIGHT = 1.2  # relative to the axis
SAME_STOP = 2 ** (1 / 12)  # ratio of f-numbers: half a third of a stop


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
    light : tuple of Vignetting
        The light in photographs that the user took. Empty for others', which have licences of their own.

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
    light: tuple[Vignetting, ...] = ()

    def __post_init__(self) -> None:
        for name, value in self.figures.items():
            if not (np.isfinite(value) and value >= 0):
                raise LensError("photographs", name, value, "expected a number from 0")

    @property
    def figures(self) -> dict[str, float]:
        """The figures that were compared, by name."""
        return {name: value for name in FIGURES if (value := getattr(self, name)) is not None}

    def at(self, f_number: float, focus_mm: float) -> Self:
        """This with a single curve of light or none: at this f-number, and at the nearest focus distance."""
        same_stop = [curve for curve in self.light if 1 / SAME_STOP < curve.f_number / f_number < SAME_STOP]
        nearest = sorted(same_stop, key=lambda curve: (abs(1 / curve.focus_mm - 1 / focus_mm),
                                                       abs(curve.f_number - f_number)))
        return replace(self, light=tuple(nearest[:1]))

    @property
    def differences(self) -> str:
        """The figures as text."""
        return ", ".join(FIGURES[name].format(value) for name, value in self.figures.items())

    def __str__(self):
        return f"compared with photographs of this lens: {self.differences} ({self.source})"
