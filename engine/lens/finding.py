"""Finding: something in lens data that is allowed, yet suspicious or harmful."""

from dataclasses import dataclass

import numpy as np

SEVERITIES = ("error", "warning", "note")


@dataclass(frozen=True)
class Finding:
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


def graded(measure, note_above, warning_above):
    """Severity of a measure that is the worse the larger it is, or None."""
    return "warning" if measure > warning_above else "note" if measure > note_above else None


def place(lens, wave, height):
    """Wavelength and paraxial height at these indices, in words."""
    return f"at {lens.wavelengths_nm[wave]:g} nm and a height of {lens.heights_mm[height]:g} mm"


def greatest(table):
    """Indices of the greatest value."""
    return np.unravel_index(np.argmax(table), table.shape)
