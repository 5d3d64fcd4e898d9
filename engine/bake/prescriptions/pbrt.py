"""pbrt's lens files: radius, distance, index and diameter of each surface in mm, with 0 for the stop's radius.

Most files tell the distance to the next surface. Older ones, whose header calls it `axpos`, tell that from the surface
before: their first row has 0, and the last does not. The header alone decides nothing, for it stands above both kinds.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...errors import LensError
from ...lens.readers.text import read_text
from ..prescription import Prescription, Surface


def read_pbrt(path: Path, field: tuple[str, float] | None = None) -> Prescription:
    """Read a pbrt .dat. It has no Abbe numbers: each glass is called by its index, for the user to say what it is."""
    if field is None:
        raise LensError(path, "field", "missing", "a pbrt file does not say where the field ends: give --field-angle")
    text = read_text(path)
    lines = {number: words for number, line in enumerate(text.splitlines(), 1) if (words := line.split("#")[0].split())}
    if lines and len(lines[min(lines)]) == 1:  # ISET's files begin with the focal length
        del lines[min(lines)]
    surfaces = [_surface(path, number, words) for number, words in lines.items()]
    stops = [surface for surface in surfaces if surface.stop]
    if len(stops) != 1:
        raise LensError(path, "stop", f"{len(stops)} rows", "expected one row of radius 0 and index 0 or 1")
    notes = ""
    if _distances_stand_before(surfaces, "axpos" in text):
        distances = [*(surface.thickness_mm for surface in surfaces[1:]), 0.0]
        surfaces = [replace(surface, thickness_mm=distance)
                    for surface, distance in zip(surfaces, distances, strict=True)]
        notes = "The file's distances are taken to be those from the surface before."
    return Prescription(name=path.stem, surfaces=tuple(surfaces), aperture=("stop", stops[0].semi_aperture_mm),
                        field=field, focus="as given" if surfaces[-1].thickness_mm > 0 else "best",
                        source=f"{path.name} (pbrt)", notes=notes)


def _distances_stand_before(surfaces, axpos):
    """A first distance of 0 is none to the next surface: no glass is so thin, and `axpos` has a word for the other."""
    first, last = surfaces[0], surfaces[-1]
    return first.thickness_mm == 0 and bool(axpos and last.thickness_mm or first.glass)


def _surface(path, number, words):
    try:
        radius, thickness, index, diameter = map(float, words)
    except ValueError:
        raise LensError(path, f"line {number}", " ".join(words), "expected radius, thickness, index, diameter"
                        ) from None
    if index not in (0, 1) and not 1 < index < 4:
        raise LensError(path, f"line {number}, index", index, "expected that of a glass, or 0 or 1 for air")
    return Surface(radius or np.inf, thickness, f"{index:.9g}" if index > 1 else "", diameter / 2,
                   stop=radius == 0 and index in (0, 1))
