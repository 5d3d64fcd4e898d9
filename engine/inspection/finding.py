"""LensFinding: a valid but suspicious or harmful value in lens data."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..lens import Lens, RadialLens

SEVERITIES = ("error", "warning", "note")
UNIT_FACTOR = 5  # below the smallest mistake in units, a factor of 10
AXIS_SCALE_TOLERANCE = 0.05  # the image scale of real lenses varies by less than 2 % with colour; wrong units by more
FIELD_ANGLES_DEG = (0.1, 88)  # less than a telescope's field; f tan(88 degrees) is 29 focal lengths


@dataclass(frozen=True)
class LensFinding:
    """A finding to report about lens data.

    Attributes
    ----------
    severity : str
        error: pictures are wrong or impossible; warning: they may be, check the data; note: a limit of the data.
    field : str
        The field of the lens at fault.
    value : str
        The value, with its wavelength and its place in the field.
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


def place(lens: Lens, wave: int, *at: int) -> str:
    """Wavelength and place in the field at these indices, as text."""
    nm = f"at {lens.wavelengths_nm[wave]:g} nm"
    if isinstance(lens, RadialLens):
        return f"{nm} and a height of {lens.heights_mm[at[0]]:g} mm"
    y_mm, x_mm = (getattr(lens, axis)[index] for axis, index in zip(lens.AXES, at, strict=True))
    return f"{nm}, x = {x_mm:g} and y = {y_mm:g} mm"


def greatest(table: np.ndarray) -> tuple[int, ...]:
    """Indices of the greatest value."""
    return tuple(map(int, np.unravel_index(np.argmax(table), table.shape)))
