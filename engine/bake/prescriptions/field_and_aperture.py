"""Field and aperture of other programs' files: the field ends at its farthest point; vignetting factors stay aside."""

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ...errors import LensError
from ..prescription import Surface


def field_end(path: Path, kind: str | None, x: Sequence[float], y: Sequence[float],
              unit_mm: float = 1.0) -> tuple[str, float]:
    """`Prescription.field` of a file's field points.

    Parameters
    ----------
    path : Path
        For the error.
    kind : str or None
        One of `FIELDS`; None for what none of them means.
    x, y : sequences of float
        In degrees, or in the file's unit of length; where one is shorter the rest is 0.
    unit_mm : float

    Raises
    ------
    LensError
        The file does not say where the field ends, or not in a way that we know.
    """
    x, y = np.abs(np.reshape(list(zip_longest(x, y, fillvalue=0.0)), (-1, 2))).T
    values = np.hypot(x, y)
    if kind == "angle_deg":  # of the projections on two planes
        slant = np.degrees(np.arctan(np.hypot(np.tan(np.radians(x)), np.tan(np.radians(y)))))
        values = np.where(np.minimum(x, y) > 0, slant, values)
    value = float(np.max(values, initial=0.0))
    if kind is None or not value > 0:
        raise LensError(path, "field", "on the axis alone" if kind else "of no kind that we know",
                        "give --field-angle or --field-height")
    return kind, in_mm(kind, value, unit_mm)


def in_mm(kind: str, value: float, unit_mm: float) -> float:
    """The value of one of `FIELDS` or `APERTURES`, of a file's unit of length where it is a length."""
    return value * unit_mm if kind.endswith("_mm") else value


def vignetting_note(factors: Iterable[float], surfaces: Sequence[Surface]) -> str:
    """What a lens's notes say of vignetting factors, where any of them is not 0: apertures vignette, these do not."""
    if not any(factors):
        return ""
    stopping = any(np.isfinite(surface.semi_aperture_mm) for surface in surfaces if not surface.stop)
    return ("The file's vignetting factors are not used: " +
            ("its apertures vignette." if stopping else "without apertures nothing vignettes."))
