"""LensFinding: a valid but suspicious or harmful value in lens data."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..lens.radial_lens import RadialLens

SEVERITIES = ("error", "warning", "note")


@dataclass(frozen=True)
class LensFinding:
    """A finding to report about lens data.

    Attributes
    ----------
    severity : str
        error: pictures are wrong or impossible; warning: they may be, check the data; note: a limit of the data.
    field : str
        The field of `RadialLens` at fault.
    value : str
        The value, with its wavelength and paraxial height.
    remedy : str
        The expected value, or what to do.
    """

    severity: str
    field: str
    value: str
    remedy: str

    def __str__(self):
        return f"{self.severity}: {self.field}: {self.value}: {self.remedy}"


def graded(measure: float, note_above: float, warning_above: float, field: str, value: str,
           remedy: str) -> Iterator[LensFinding]:
    """A finding if a measure, for which larger is worse, exceeds a limit."""
    if measure > note_above:
        yield LensFinding("warning" if measure > warning_above else "note", field, value, remedy)


def place(lens: RadialLens, wave: int, height: int) -> str:
    """Wavelength and paraxial height at these indices, as text."""
    return f"at {lens.wavelengths_nm[wave]:g} nm and a height of {lens.heights_mm[height]:g} mm"


def greatest(table: np.ndarray) -> tuple[int, ...]:
    """Indices of the greatest value."""
    return tuple(map(int, np.unravel_index(np.argmax(table), table.shape)))
