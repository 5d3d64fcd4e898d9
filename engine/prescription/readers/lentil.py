"""lentil's database of lenses: a JSON file with numbered lenses, as typed from their patents."""

from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ...runtime.unread import json_names, unread_names
from ..prescription import Prescription, Surface
from .reading import Reading, ReadingOptions, with_stop

ELEMENTS, ADJUSTED = "optical-elements-patent", "optical-elements-adjusted"
PLANE_MM = 99_000  # planes have a radius of 99999 or 100000
STOP = "iris"
CYLINDERS = {"cyl-x": ("radius_mm", "radius_x_mm"), "cyl-y": ("radius_x_mm", "radius_mm")}
"""The curved section and the plane one of a cylinder, which is named after its axis."""
SHAPES = ("spherical", "aspherical", *CYLINDERS)
KNOWN_NAMES = (ELEMENTS, ADJUSTED, "company", "product-name", "patent-number", "year", "focal-length-mm-patent",
               "radius", "thickness", "material", "ior", "abbe", "housing-radius", "lens-geometry",
               "aspherical-equation")
HARMLESS_NAMES = (  # remarks, and lentil's own results, whose f-stops are focal length over the iris
    "notes", "notes-to-self", "commercial", "patent-location", "prime", "production-ready", "polynomial-optics",
    "focal-length-mm-raytraced", "fstop", "max-fstop-aperture-radius", "lt-jacobian-fix-required")
FIRST_POWER = 4  # of r in the aspheric terms: 4, 6, 8 and 10


def is_lentil(contents: dict) -> bool:
    """Whether any of a file's entries is a lens of lentil's."""
    return any(isinstance(entry, dict) and ELEMENTS in entry for entry in contents.values())


def read_lentil(path: Path, contents: dict, options: ReadingOptions) -> Reading:
    """Read the lens with this number, with its adjusted elements, if any, instead of the elements of the patent."""
    entries = {key: entry for key, entry in contents.items() if isinstance(entry, dict) and ELEMENTS in entry}
    which, field = options.which, options.field
    if which is None and len(entries) == 1:
        which, = entries
    if which is None or which not in entries:
        known = ", ".join(f"{key} {entry.get('company')} {entry.get('product-name')}" for key, entry in entries.items())
        raise LensError(path, "--which", "missing" if which is None else which, f"expected one of {known}")
    entry = entries[which]
    rows = entry.get(ADJUSTED) or entry[ELEMENTS]
    if field is None:
        raise LensError(path, "field", "missing",
                        "lentil does not state the end of the field: give --field-angle or --field-height")
    elements: list[Surface] = []
    for number, row in enumerate(rows, 1):
        elements.append(_surface(path, number, row, elements[-1].glass if elements else ""))
    surfaces = with_stop(path, elements, options)
    stops = [surface for surface in surfaces if surface.stop]
    if len(stops) != 1:
        raise LensError(path, f"{which}, stop", f"{len(stops)} elements", f"expected one of material {STOP}, or --stop")
    zooms = any(isinstance(row["thickness"], list) for row in rows)
    labels = (entry.get("company"), entry.get("product-name"), entry.get("patent-number"), entry.get("year"))
    stated = entry.get("focal-length-mm-patent")
    return Reading(Prescription(
        name=f"{entry.get('company')} {entry.get('product-name')}", surfaces=surfaces,
        aperture=("stop", stops[0].semi_aperture_mm), field=field, focus=options.image_plane or "best",
        focal_length_mm=float(stated) if stated else None,
        source=" ".join(["lentil", which, *(str(word) for word in labels if word)]),
        notes="The shortest of its zoom positions is used." if zooms else ""),
        unread=unread_names(json_names(entry, HARMLESS_NAMES), KNOWN_NAMES))


def _surface(path, number, row, glass_before):
    shape, thickness = row["lens-geometry"], row["thickness"]
    if shape not in SHAPES:
        raise LensError(path, f"surface {number}", str(shape), f"expected one of {', '.join(SHAPES)}")
    radius_mm, terms = float(row["radius"]), tuple(map(float, row.get("aspherical-equation") or []))
    if shape in CYLINDERS and any(terms):
        raise LensError(path, f"surface {number}, aspherical-equation", terms, f"expected none for {shape}")
    radius_mm = np.inf if abs(radius_mm) > PLANE_MM else radius_mm
    curved, plane = CYLINDERS.get(shape, ("radius_mm", ""))
    stop = row["material"] == STOP
    return Surface(thickness_mm=float(thickness[0] if isinstance(thickness, list) else thickness),
                   glass=glass_before if stop else _glass(row), semi_aperture_mm=float(row["housing-radius"]),
                   aspheric=(0.0,) * (FIRST_POWER // 2 - 1) + terms if terms and not plane else (), stop=stop,
                   **{curved: radius_mm} | ({plane: np.inf} if plane else {}))


def _glass(row):
    if row["material"] == "air" or not row["ior"] or row["ior"] == 1:
        return ""
    return f"{row['ior']:.9g}/{row['abbe']:.6g}" if row["abbe"] else f"{row['ior']:.9g}"
