""".lens: a name, a focal length, and rows of radius, thickness, index, Abbe number, aperture and coating.

What its header calls `semi_ap` holds diameters in the files that there are, and is halved; aspheric terms of the
designs were dropped by who made them.
"""

import re
from pathlib import Path

import numpy as np

from ...errors import LensError
from ...lens.readers.text import read_text
from ..prescription import Prescription, Surface
from .lines import numbered

ROW = 5
F_NUMBER = re.compile(r"\bf/?\s?(\d+(?:\.\d+)?)", re.IGNORECASE)
NOTE = "Apertures are taken as diameters, and surfaces as spheres: the file tells no others."


def read_dot_lens(path: Path, field: tuple[str, float] | None = None) -> Prescription:
    """Read a .lens. The image plane lies at the best focus: thicknesses of patents are rounded."""
    if field is None:
        raise LensError(path, "field", "missing",
                        "a .lens does not say where the field ends: give --field-angle or --field-height")
    text = read_text(path)
    heads = dict(line.split(":", 1) for line in text.splitlines() if ":" in line and not line.startswith("#"))
    surfaces = tuple(_surface(line) for line in numbered(path, (line.split("#")[0] for line in text.splitlines()))
                     if ":" not in " ".join(line.words))
    stops = [surface for surface in surfaces if surface.stop]
    if len(stops) != 1:
        raise LensError(path, "stop", f"{len(stops)} rows", "expected one row that begins with stop")
    name = " ".join(heads.get("name", path.stem).split())
    f_number = F_NUMBER.search(name)
    patent = re.search(r"#\s*(.*\d.*)", text)
    return Prescription(
        name=name, surfaces=surfaces, field=field, focus="best", notes=NOTE,
        aperture=("f_number", float(f_number[1])) if f_number else ("stop", stops[0].semi_aperture_mm),
        source=" ".join(f"{patent[1] if patent else ''} ({path.name})".split()))


def _surface(line):
    if len(line.words) < ROW:
        raise line.refusal("expected radius or stop, thickness, index, Abbe number, aperture")
    stop = line.words[0].lower() == "stop"
    radius_mm = np.inf if stop else line.figure(0) or np.inf
    index, abbe, diameter_mm = (line.figure(at) for at in (2, 3, 4))
    glass = "" if index <= 1 else f"{index:.9g}/{abbe:.9g}" if abbe else f"{index:.9g}"
    return Surface(radius_mm, line.figure(1), glass, diameter_mm / 2 or np.inf, stop=stop)
