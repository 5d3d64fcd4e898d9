"""Zemax .zmx, by Optiland's parser; glasses go by their names, for its own lookup makes up what it lacks."""

import numpy as np
from optiland.fileio.zemax.reader.parser import ZemaxDataParser

from ...errors import LensError
from ..glasses import best_name
from ..prescription import Prescription, Surface

UNITS_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}
APERTURES = {"EPD": "entrance_pupil_diameter_mm", "imageFNO": "f_number", "paraxialImageFNO": "working_f_number",
             "objectNA": "object_na"}
FIELDS = {"angle": "angle_deg", "object_height": "object_height_mm", "paraxial_image_height": "image_height_mm",
          "real_image_height": "image_height_mm"}
LENGTHS = ("entrance_pupil_diameter_mm", "object_height_mm", "image_height_mm")
SHAPES = ("standard", "even_asphere")
COEFFICIENTS = 8
FAR_MM = 1e9


class _Parser(ZemaxDataParser):
    """Optiland's parser, with units, and with glasses by name."""

    def __init__(self, filename):
        super().__init__(filename)
        self.unit_mm = 1.0
        self.notes = []
        self._operand_table["UNIT"] = self._read_unit
        self._operand_table["GLAS"] = self._read_glass

    def _read_unit(self, data):
        self.unit_mm = UNITS_MM[data[1].upper()]

    def _read_glass(self, data):
        name = data[1]
        if name.upper() == "MIRROR":
            raise LensError(self.filename, f"surface {self._current_surf}", "a mirror", "expected refracting surfaces")
        if name.startswith("___") and len(data) > 5:  # a model glass: its index and Abbe number follow
            name = f"{float(data[4]):.6g}/{float(data[5]):.6g}"
        self._current_surf_data["material"] = name


def read_zemax(path, field=None):
    """Read a sequential .zmx. Circular apertures stop light; vignetting factors are left aside."""
    parser = _Parser(str(path))
    model = parser.parse()
    scale, catalogues = parser.unit_mm, model.glass_catalogs or []
    rows = [model.surfaces[index] for index in sorted(model.surfaces)]
    surfaces = tuple(_surface(path, number, row, scale, catalogues) for number, row in enumerate(rows[1:-1], 1))
    distance_mm = rows[0].get("thickness", np.inf) * scale
    reference = model.wavelengths.get("primary_index") or 0
    return Prescription(
        name=model.name or path.stem, surfaces=surfaces, aperture=_aperture(path, model, surfaces, scale),
        field=field or _field(path, model, scale), object_distance_mm=distance_mm if distance_mm < FAR_MM else np.inf,
        reference_wavelength_nm=1e3 * model.wavelengths["data"][reference], source=f"{path.name} (Zemax)",
        notes=_notes(model))


def _surface(path, number, row, scale, catalogues):
    if row["type"] not in SHAPES:
        raise LensError(path, f"surface {number}", row["type"], f"expected one of {', '.join(SHAPES)}")
    aperture, glass = row.get("aperture"), row["material"]
    if getattr(aperture, "offset_x", 0) or getattr(aperture, "offset_y", 0) or getattr(aperture, "r_min", 0):
        raise LensError(path, f"surface {number}, aperture", "decentred or annular", "expected a centred circle")
    terms = [row.get(f"param_{index}", 0.0) for index in range(COEFFICIENTS)] if row["type"] == "even_asphere" else []
    surface = Surface(row["radius"], row.get("thickness", 0.0), "" if glass == "air" else best_name(glass, catalogues),
                      aperture.r_max if aperture else np.inf, row["conic"], tuple(terms) if any(terms) else (),
                      row["is_stop"])
    return surface.scaled(scale)


def _aperture(path, model, surfaces, scale):
    if model.aperture.get("floating_stop"):
        index = [surface.stop for surface in surfaces].index(True)
        return "stop", model.surfaces[index + 1]["diameter"] * scale
    for key, value in model.aperture.items():
        if key in APERTURES:
            kind = APERTURES[key]
            return kind, value * (scale if kind in LENGTHS else 1)
    raise LensError(path, "aperture", str(model.aperture), f"expected one of {', '.join(APERTURES)}")


def _field(path, model, scale):
    kind = FIELDS.get(model.fields.get("type"))
    value = float(max(np.hypot(x, y) for x, y in zip(model.fields["x"], model.fields["y"]))) if kind else 0
    if not value:
        raise LensError(path, "field", model.fields.get("type", "missing"), "give --field-angle or --field-height")
    return kind, value * (scale if kind in LENGTHS else 1)


def _notes(model):
    factors = [value for key in model.fields if key.startswith("vignette") for value in model.fields[key]]
    return "The file's vignetting factors are not used: its apertures vignette." if any(factors) else ""
