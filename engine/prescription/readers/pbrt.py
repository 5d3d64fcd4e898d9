"""pbrt's lens files: radius, distance, index and diameter of each surface in mm, with 0 for the stop's radius.

In most files, the distance is to the next surface. In older ones, whose header calls it `axpos`, it is from the
previous surface: their first row has 0, and the last does not. The header alone is not sufficient, because both kinds
use it.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ..prescription import Prescription, Surface
from .lines import Line
from .reading import Reading, ReadingOptions, with_stop


def read_pbrt(path: Path, text: str, options: ReadingOptions) -> Reading:
    """Read a pbrt .dat. It lacks Abbe numbers: glasses are named by their index, for the user to replace."""
    if options.field is None:
        raise LensError(path, "field", "missing", "a pbrt file does not state the end of the field: give --field-angle")
    lines = {number: words for number, line in enumerate(text.splitlines(), 1) if (words := line.split("#")[0].split())}
    focal_mm = None
    if lines and len(lines[min(lines)]) == 1:  # ISET's files start with the focal length
        focal_mm = Line(path, f"line {min(lines)}", tuple(lines.pop(min(lines)))).figure(0)
    surfaces = with_stop(path, [_surface(path, number, words) for number, words in lines.items()], options)
    stops = [surface for surface in surfaces if surface.stop]
    if len(stops) != 1:
        raise LensError(path, "stop", f"{len(stops)} rows", "expected one row of radius 0 and index 0 or 1, or --stop"
                        )
    notes = ""
    if _distances_precede(surfaces, "axpos" in text):
        distances = [*(surface.thickness_mm for surface in surfaces[1:]), 0.0]
        surfaces = tuple(replace(surface, thickness_mm=distance)
                         for surface, distance in zip(surfaces, distances, strict=True))
        notes = "The file's distances are read as distances from the previous surface."
    return Reading(Prescription(
        name=path.stem, surfaces=surfaces, aperture=("stop", stops[0].semi_aperture_mm), field=options.field,
        focus=options.image_plane or ("as given" if surfaces[-1].thickness_mm > 0 else "best"),
        focal_length_mm=focal_mm, source=f"{path.name} (pbrt)", notes=notes))


def _distances_precede(surfaces, axpos):
    """Whether distances are from the previous surface.

    A first distance of 0 is not the thickness of a glass, and with `axpos` not a distance to the next surface.
    """
    first, last = surfaces[0], surfaces[-1]
    return first.thickness_mm == 0 and bool(axpos and last.thickness_mm or first.glass)


def _surface(path, number, words):
    try:
        radius, thickness, index, diameter = map(float, words)
    except ValueError:
        raise LensError(path, f"line {number}", " ".join(words), "expected radius, thickness, index, diameter"
                        ) from None
    if index not in (0, 1) and not 1 < index < 4:
        raise LensError(path, f"line {number}, index", index, "expected the index of a glass, or 0 or 1 for air")
    return Surface(radius or np.inf, thickness, f"{index:.9g}" if index > 1 else "", diameter / 2,
                   stop=radius == 0 and index in (0, 1))
