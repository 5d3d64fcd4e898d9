""".lens: a name, a focal length, and rows of radius, thickness, index, Abbe number, aperture and coating.

The column `semi_ap` contains diameters in all known files of spheres, which a program converted, and is halved. The
authors of the files dropped the designs' aspheric terms. The column `coating` is a number of layers. Newer files have
a seventh column, the type of the surface: a cylinder is named after its axis, so that `cyl_y` is curved along x. A
toroid's radius along x is first, and its profile's, along y, in an eighth column. Files with these are written by hand,
with semi-diameters.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ...runtime.unread import unread_names
from ..coatings import of_layers
from ..prescription import LEAST_F_NUMBER, Prescription, Surface
from .lines import Line, numbered
from .reading import Reading, ReadingOptions, with_stop

ROW, COATING, KIND, COLUMNS = 5, 5, 6, 8  # required numbers, indices of coating and type, possible words
SPHERES = ("sph", "sphere", "spherical")
CYLINDERS_X, CYLINDERS_Y, TOROID = ("cyl_x", "cylinder_x"), ("cyl_y", "cylinder_y"), "toric"
KINDS = (*SPHERES, *CYLINDERS_X, *CYLINDERS_Y, TOROID)
KNOWN_HEADS = ("name", "focal_length", "surfaces")
F_NUMBER = re.compile(r"(?<![\w-])f/?\s?(\d+(?:\.\d+)?)(?![\d.]*\s*(?:mm|cm))", re.IGNORECASE)
HEADER_F_NUMBER = re.compile(r"^#.*\bsurfaces\b.*\bf/(\d+(?:\.\d+)?)", re.MULTILINE)
HEADER_ROUNDING = 0.1  # one decimal, rounded up or down
ZOOM = re.compile(r"\d\s*-\s*\d[\d.]*\s*mm|\bzoom\b|\bvario", re.IGNORECASE)
NOTE = "Apertures are read as {}, and surfaces without aspheric terms: the file does not contain them."
DIAMETERS, SEMI_DIAMETERS = "diameters", "semi-diameters"
NO_APERTURE_MM = 1e5  # wider apertures mean none: files state 1e6


def read_dot_lens(path: Path, text: str, options: ReadingOptions) -> Reading:
    """Read a .lens. The image plane is at the best focus, because patents round thicknesses."""
    if options.field is None:
        raise LensError(path, "field", "missing",
                        "a .lens does not state the end of the field: give --field-angle or --field-height")
    heads = {name.strip(): " ".join(value.split()) for name, value in
             (line.split("#")[0].split(":", 1) for line in text.splitlines() if ":" in line.split("#")[0])}
    rows = numbered(path, (line.split("#")[0] for line in text.splitlines()))
    halved = [_surface(line) for line in rows if ":" not in " ".join(line.words)]
    sizes = DIAMETERS if all(surface.radius_x_mm is None for surface in halved) else SEMI_DIAMETERS
    surfaces = with_stop(path, halved if sizes == DIAMETERS else [
        replace(surface, semi_aperture_mm=2 * surface.semi_aperture_mm) for surface in halved], options)
    stops = [surface for surface in surfaces if surface.stop]
    if len(stops) != 1:
        raise LensError(path, "stop", f"{len(stops)} rows", "expected one row that begins with stop, or --stop")
    name, focal_mm = heads.get("name", path.stem), _focal_length_mm(path, heads)
    f_number, f_number_note = _f_number(name, text)
    zooms = focal_mm and ZOOM.search(f"{name} {path.stem}")
    zoom = f"The file has one position of a zoom lens: {focal_mm:g} mm." if zooms else ""
    patent = re.search(r"#\s*(.*\d.*)", text)
    return Reading(Prescription(
        name=name, surfaces=surfaces, field=options.field, focal_length_mm=focal_mm,
        focus=options.image_plane or "best",
        aperture=("f_number", f_number) if f_number else ("stop", stops[0].semi_aperture_mm),
        notes=" ".join(filter(None, (NOTE.format(sizes), zoom, f_number_note))),
        source=" ".join(f"{patent[1] if patent else ''} ({path.name})".split())),
        f_number, unread_names(heads, KNOWN_HEADS))


def _focal_length_mm(path, heads):
    """Focal length in the header, or None."""
    if not heads.get("focal_length"):
        return None
    line = Line(path, "focal_length", (heads["focal_length"],))
    if not 0 < line.figure(0) < np.inf:
        raise line.refusal("expected a lens with a positive focal length, not an attachment")
    return line.figure(0)


def _f_number(name, text):
    """The f-number and a note: from the header, which rounds it, or the more precise one in the name if it agrees.

    In "Pentax-F 85mm", the letter is part of a series' name.
    """
    header = HEADER_F_NUMBER.search(text)
    engraved = F_NUMBER.search(name)
    values = [float(match[1]) if match else None for match in (header, engraved)]
    of_header, of_name = (value if value and value >= LEAST_F_NUMBER else None for value in values)
    if of_header is None or of_name is None:
        return of_header or of_name, ""
    used = of_name if abs(of_header - of_name) <= HEADER_ROUNDING + 1e-9 else of_header
    if of_header == of_name:
        return used, ""
    return used, f"The name says f/{of_name:g}, the header f/{of_header:g}: f/{used:g} is used."


def _surface(line):
    if len(line.words) < ROW:
        raise line.refusal("expected radius or stop, thickness, index, Abbe number, aperture")
    kind = line.words[KIND].lower() if len(line.words) > KIND else SPHERES[0]
    if kind not in KINDS or len(line.words) > (COLUMNS if kind == TOROID else KIND + 1):
        raise line.refusal(f"expected one of {', '.join(KINDS)} as the last word, except for the second radius of "
                           f"{TOROID}")
    stop = line.words[0].lower() == "stop"
    radius_mm = np.inf if stop else line.figure(0) or np.inf
    index, abbe = line.figure(2), line.figure(3)
    diameter_mm = line.figure(4)
    semi_mm = np.inf if not diameter_mm or diameter_mm >= NO_APERTURE_MM else diameter_mm / 2
    glass = "" if index <= 1 else f"{index:.9g}/{abbe:.9g}" if abbe else f"{index:.9g}"
    if line.figure(1) < 0:
        raise LensError(line.path, f"{line.place}, thickness", line.words[1], "this is a mirror lens, and rows of "
                        "a .lens do not state which surfaces are mirrors: type it as a .toml")
    surface = Surface(radius_mm, line.figure(1), glass, semi_mm, stop=stop, coating=_coating(line))
    if kind in CYLINDERS_X:
        return replace(surface, radius_x_mm=np.inf)
    if kind in CYLINDERS_Y:
        return replace(surface, radius_mm=np.inf, radius_x_mm=radius_mm)
    if kind == TOROID:
        return replace(surface, radius_mm=line.figure(KIND + 1), radius_x_mm=line.figure(0), profile="y")
    return surface


def _coating(line):
    """The coating of a row, if it states the number of its layers."""
    if len(line.words) <= COATING:
        return ""
    if not line.words[COATING].isdecimal():
        raise line.refusal("expected the number of a coating's layers after the aperture")
    return of_layers(int(line.words[COATING]))
