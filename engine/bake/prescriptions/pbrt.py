"""pbrt's lens files: radius, thickness, index and diameter of each surface in mm, with 0 for the stop's radius."""

from pathlib import Path

import numpy as np

from ...errors import LensError
from ...lens.readers.text import read_text, shown
from ..prescription import Prescription, Surface


def read_pbrt(path: Path, field: tuple[str, float] | None = None) -> Prescription:
    """Read a pbrt .dat. It has no Abbe numbers: each glass is called by its index, for the user to say what it is."""
    if field is None:
        raise LensError(path, "field", "missing", "a pbrt file does not say where the field ends: give --field-angle")
    rows = [_row(path, number, line.split("#")[0])
            for number, line in enumerate(read_text(path).splitlines(), 1)]
    surfaces = [surface for surface in rows if surface]
    stops = [surface for surface in surfaces if surface.stop]
    if len(stops) != 1:
        raise LensError(path, "stop", f"{len(stops)} rows", "expected one row of radius 0 and index 0 or 1")
    return Prescription(name=path.stem, surfaces=tuple(surfaces), aperture=("stop", stops[0].semi_aperture_mm),
                        field=field, focus="as given" if surfaces[-1].thickness_mm > 0 else "best",
                        source=f"{path.name} (pbrt)")


def _row(path, number, text):
    if not text.strip():
        return None
    try:
        radius, thickness, index, diameter = (float(word) for word in text.split())
    except ValueError:
        raise LensError(path, f"line {number}", shown(text.strip()), "expected radius, thickness, index, diameter"
                        ) from None
    if index not in (0, 1) and not 1 < index < 4:
        raise LensError(path, f"line {number}, index", index, "expected that of a glass, or 0 or 1 for air")
    return Surface(radius or np.inf, thickness, f"{index:.9g}" if index > 1 else "", diameter / 2,
                   stop=radius == 0 and index in (0, 1))
