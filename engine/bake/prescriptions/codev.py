"""Code V .seq, by Optiland's parser; glasses go by their names, for its own lookup makes up what it lacks."""

import re
from dataclasses import replace

import numpy as np
from optiland.fileio.codev.reader.parser import CodeVDataParser

from ...errors import LensError
from ..glasses import best_name
from ..prescription import Prescription, Surface

UNITS_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4}
APERTURES = {"EPD": "entrance_pupil_diameter_mm", "FNO": "f_number", "NAO": "object_na"}
FIELDS = {"angle": "angle_deg", "object_height": "object_height_mm", "paraxial_image_height": "image_height_mm"}
LENGTHS = ("entrance_pupil_diameter_mm", "object_height_mm", "image_height_mm")
TILTS = ("xde", "yde", "ade", "bde", "cde")
FAR_MM = 1e9


class _Parser(CodeVDataParser):
    """Optiland's parser, with glasses by name."""

    def _parse_glass(self, token):
        return token.strip("'\"")


def read_codev(path, field=None):
    """Read a .seq. CIR apertures stop light; vignetting factors are left aside."""
    model = _Parser(str(path)).parse()
    scale = UNITS_MM[model.units]
    rows = [model.surfaces[index] for index in sorted(model.surfaces)]
    if len(rows) < 3:
        raise LensError(path, "surfaces", f"{len(rows)}", "expected SO, S ... and SI")
    stop = model.sto_surface_index
    surfaces = [_surface(path, number, row, stop) for number, row in enumerate(rows[1:-1], 1)]
    defocus = rows[-1]["thickness"]  # of SI: the image plane lies that much behind the paraxial one
    surfaces[-1] = replace(surfaces[-1], thickness_mm=surfaces[-1].thickness_mm + defocus)
    distance_mm = rows[0]["thickness"] * scale
    reference = model.wavelengths.get("primary_index") or 0
    return Prescription(
        name=model.name or path.stem, surfaces=tuple(surface.scaled(scale) for surface in surfaces),
        aperture=_aperture(path, model, scale), field=field or _field(path, model, scale),
        object_distance_mm=distance_mm if distance_mm < FAR_MM else np.inf,
        reference_wavelength_nm=1e3 * model.wavelengths["data"][reference], source=f"{path.name} (Code V)")


def _surface(path, number, row, stop):
    if any(row[tilt] for tilt in TILTS):
        raise LensError(path, f"surface {number}", "tilted or decentred", "expected a centred lens")
    glass = row["material"] or ""
    if glass.upper() == "REFL":
        raise LensError(path, f"surface {number}", "a mirror", "expected refracting surfaces")
    terms = (0.0, *row["coefficients"]) if any(row["coefficients"]) else ()  # Code V's A is that of r^4
    return Surface(row["radius"], row["thickness"], _glass_name(glass),
                   row["aperture"].r_max if row["aperture"] else np.inf, row["conic"], terms,
                   row["is_stop"] or stop == number)


def _glass_name(token):
    """Our name of a glass that Code V calls NBK7_SCHOTT, 1.5168:64.17, 517642 or 517.642."""
    if token.upper() in ("", "AIR"):
        return ""
    if ":" in token:
        return token.replace(":", "/")
    code = re.fullmatch(r"(\d{3})\.?(\d{3})", token)
    if code:
        return f"1.{code[1]}/{int(code[2]) / 10:g}"
    name, _, catalogue = token.partition("_")
    return best_name(name, [catalogue] if catalogue else [])


def _aperture(path, model, scale):
    for key, value in model.aperture.items():
        if key in APERTURES:
            kind = APERTURES[key]
            return kind, value * (scale if kind in LENGTHS else 1)
        if key == "NA":
            return "working_f_number", 0.5 / value
    raise LensError(path, "aperture", "missing", f"expected one of {', '.join(APERTURES)}, NA")


def _field(path, model, scale):
    kind = FIELDS.get(model.fields.get("type"))
    value = float(max(np.hypot(x, y) for x, y in zip(model.fields["x"], model.fields["y"]))) if kind else 0
    if not value:
        raise LensError(path, "field", model.fields.get("type", "missing"), "give --field-angle or --field-height")
    return kind, value * (scale if kind in LENGTHS else 1)
