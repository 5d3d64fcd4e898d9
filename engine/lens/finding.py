"""LensFinding: something in lens data that is allowed, yet suspicious or harmful."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .lens import Lens

SEVERITIES = ("error", "warning", "note")


@dataclass(frozen=True)
class LensFinding:
    """One thing to tell the maker of lens data.

    Attributes
    ----------
    severity : str
        error: pictures come out wrong or not at all; warning: they may, and someone should look; note: a limit of
        the data that is good to know.
    field : str
        The field of `Lens` at fault.
    value : str
        What was found, and where: at which wavelength and paraxial height.
    remedy : str
        What is expected or what to do.
    """

    severity: str
    field: str
    value: str
    remedy: str

    def __str__(self):
        return f"{self.severity}: {self.field}: {self.value}: {self.remedy}"


def graded(measure: float, note_above: float, warning_above: float, field: str, value: str,
           remedy: str) -> Iterator[LensFinding]:
    """The finding, if there is one, of a measure that is the worse the larger it is."""
    if measure > note_above:
        yield LensFinding("warning" if measure > warning_above else "note", field, value, remedy)


def place(lens: Lens, wave: int, height: int) -> str:
    """Wavelength and paraxial height at these indices, in words."""
    return f"at {lens.wavelengths_nm[wave]:g} nm and a height of {lens.heights_mm[height]:g} mm"


def greatest(table: np.ndarray) -> tuple[int, ...]:
    """Indices of the greatest value."""
    return tuple(map(int, np.unravel_index(np.argmax(table), table.shape)))
