"""Field and aperture of other programs' files: the farthest point ends the field; vignetting factors are ignored."""

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ..prescription import Surface


def field_end(path: Path, kind: str | None, x: Sequence[float], y: Sequence[float],
              unit_mm: float = 1.0) -> tuple[str, float]:
    """`Prescription.field` from a file's field points.

    Parameters
    ----------
    path : Path
        For the error.
    kind : str or None
        One of `FIELDS`; None for an unsupported kind.
    x, y : sequences of float
        In degrees, or in the file's unit of length; the shorter one is padded with 0.
    unit_mm : float

    Raises
    ------
    LensError
        The file does not state the end of the field in a supported way.
    """
    x, y = np.abs(np.reshape(list(zip_longest(x, y, fillvalue=0.0)), (-1, 2))).T
    values = np.hypot(x, y)
    if kind == "angle_deg":  # angles are projections on two planes
        slant = np.degrees(np.arctan(np.hypot(np.tan(np.radians(x)), np.tan(np.radians(y)))))
        values = np.where(np.minimum(x, y) > 0, slant, values)
    value = float(np.max(values, initial=0.0))
    if kind is None or not value > 0:
        raise LensError(path, "field", "only on the axis" if kind else "of an unknown kind",
                        "give --field-angle or --field-height")
    return kind, in_mm(kind, value, unit_mm)


def in_mm(kind: str, value: float, unit_mm: float) -> float:
    """The value of one of `FIELDS` or `APERTURES`, converted from the file's unit if it is a length."""
    return value * unit_mm if kind.endswith("_mm") else value


def vignetting_note(factors: Iterable[float], surfaces: Sequence[Surface]) -> str:
    """Note on ignored vignetting factors, if any of them is not 0: only apertures vignette."""
    if not any(factors):
        return ""
    stopping = any(np.isfinite(surface.semi_aperture_mm) for surface in surfaces if not surface.stop)
    return ("The file's vignetting factors are not used: " +
            ("its apertures vignette." if stopping else "without apertures, there is no vignetting."))
