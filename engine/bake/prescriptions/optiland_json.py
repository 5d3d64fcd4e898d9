"""Optiland's own JSON."""

import json

import numpy as np

from ...errors import LensError
from ..prescription import Prescription, Surface

SHAPES = ("Plane", "StandardGeometry", "EvenAsphere")
APERTURES = {"EPD": "entrance_pupil_diameter_mm", "imageFNO": "f_number", "objectNA": "object_na"}
FIELDS = {"AngleField": "angle_deg", "ObjectHeightField": "object_height_mm",
          "ParaxialImageHeightField": "image_height_mm"}
FAR_MM = 1e9


def read_optiland(path, field=None):
    """Read what `optiland.fileio.save_optiland_file` wrote."""
    contents = json.loads(path.read_text(encoding="utf-8"))
    rows = contents["surface_group"]["surfaces"]
    places = [row["geometry"]["cs"]["z"] for row in rows]
    surfaces = tuple(_surface(path, number, row, places[number + 1] - places[number])
                     for number, row in enumerate(rows[1:-1], 1))
    distance_mm = places[1] - places[0]
    kind, value = contents["aperture"]["type"], contents["aperture"]["value"]
    if kind == "float_by_stop_size":
        aperture = ("stop", value / 2)
    elif kind in APERTURES:
        aperture = (APERTURES[kind], value)
    else:
        raise LensError(path, "aperture", kind, f"expected float_by_stop_size, {', '.join(APERTURES)}")
    wavelengths = contents["wavelengths"]["wavelengths"]
    primary = next((row for row in wavelengths if row["is_primary"]), wavelengths[0])
    return Prescription(name=contents.get("name") or path.stem, surfaces=surfaces, aperture=aperture,
                        field=field or _field(path, contents["fields"]),
                        object_distance_mm=distance_mm if distance_mm < FAR_MM else np.inf,
                        reference_wavelength_nm=1e3 * primary["value"], source=f"{path.name} (Optiland)")


def _surface(path, number, row, thickness_mm):
    shape, aperture = row["geometry"], row.get("aperture")
    if shape["type"] not in SHAPES:
        raise LensError(path, f"surface {number}", shape["type"], f"expected one of {', '.join(SHAPES)}")
    if any(shape["cs"][key] for key in ("x", "y", "rx", "ry", "rz")):
        raise LensError(path, f"surface {number}", "tilted or decentred", "expected a centred lens")
    if aperture and aperture["type"] != "RadialAperture":
        raise LensError(path, f"surface {number}, aperture", aperture["type"], "expected a RadialAperture")
    return Surface(shape.get("radius", np.inf), thickness_mm, _glass(path, number, row["material_post"]),
                   aperture["r_max"] if aperture else np.inf, shape.get("conic", 0.0),
                   tuple(shape.get("coefficients", ())), row["is_stop"])


def _glass(path, number, material):
    if material["type"] == "Material":
        maker = material.get("catalog") or material.get("reference") or ""
        return f"{maker.upper()} {material['name']}".strip()
    if material["type"] == "AbbeMaterial":
        return f"{material['index']:.6g}/{material['abbe']:.6g}"
    if material["type"] == "IdealMaterial" and material["index"] == 1:
        return ""
    raise LensError(path, f"surface {number}, glass", material["type"], "expected a catalogue glass or AbbeMaterial")


def _field(path, fields):
    kind = FIELDS.get(fields["field_definition"]["field_type"])
    value = float(max(np.hypot(field["x"], field["y"]) for field in fields["fields"])) if kind else 0
    if not value:
        raise LensError(path, "field", fields["field_definition"]["field_type"],
                        "give --field-angle or --field-height")
    return kind, value
