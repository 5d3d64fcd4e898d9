"""Zemax .zmx, by Optiland's parser; glasses go by their names, for its own lookup makes up what it lacks."""

import re
from pathlib import Path

import numpy as np
from optiland.fileio.zemax.reader.parser import ZemaxDataParser

from ...errors import LensError
from ...lens.readers.assembly import object_distance
from ...lens.readers.text import read_text, shown
from ..glasses import best_name
from ..prescription import Prescription, Surface
from .field_and_aperture import field_end, known_aperture, vignetting_note

UNITS_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "INCH": 25.4, "METER": 1000.0, "M": 1000.0}
APERTURES = {"EPD": "entrance_pupil_diameter_mm", "imageFNO": "f_number", "paraxialImageFNO": "working_f_number",
             "objectNA": "object_na"}
FIELDS = {"angle": "angle_deg", "object_height": "object_height_mm", "paraxial_image_height": "image_height_mm",
          "real_image_height": "image_height_mm"}
SHAPES = ("standard", "even_asphere")
OTHER_APERTURES = ("SQAP", "ELAP", "USAP", "OBSC", "SQOB", "ELOB", "SPID")
COEFFICIENTS = 8


class _Parser(ZemaxDataParser):
    """Optiland's parser, with units, and with glasses by name."""

    def __init__(self, filename):
        super().__init__(filename)
        self.unit_mm = 1.0
        self._operand_table |= {"UNIT": self._read_unit, "GLAS": self._read_glass, "WAVL": self._read_wavelengths,
                                "WAVN": self._read_wavelengths}
        self._operand_table |= dict.fromkeys(OTHER_APERTURES, self._refuse_aperture)

    def parse(self):
        """The model of the whole file; Optiland's own way would take what it can read and begin again after that."""
        for number, line in enumerate(read_text(self.filename).splitlines(), 1):
            words = line.split()
            if words and words[0] in self._operand_table:
                self._read_line(number, words)
        self._finalize_surface()
        return self.data_model

    def _read_line(self, number, words):
        if words[0] != "NAME":
            words = [re.sub(r"(?<=\d),(?=\d)", ".", word) for word in words]
        try:
            self._operand_table[words[0]](words)
        except LensError:
            raise
        except (ValueError, IndexError, OverflowError) as error:
            raise LensError(self.filename, f"line {number}", shown(" ".join(words)), f"not readable: {error}") from None

    def _refuse(self, what, value, remedy):
        raise LensError(self.filename, f"surface {self._current_surf}{what}", value, remedy)

    def _read_unit(self, data):
        if data[1].upper() not in UNITS_MM:
            raise LensError(self.filename, "UNIT", data[1], f"expected one of {', '.join(UNITS_MM)}")
        self.unit_mm = UNITS_MM[data[1].upper()]

    def _read_wavelengths(self, data):
        for slot, micrometres in enumerate(data[1:], 1):
            self._read_wavelength(["WAVM", str(slot), micrometres])

    def _read_glass(self, data):
        name = data[1]
        if name.upper() == "MIRROR":
            self._refuse("", "a mirror", "expected refracting surfaces")
        if name.startswith("___") and data[2] == "1":  # a model glass: its index and Abbe number follow
            name = f"{float(data[4]):.9g}/{float(data[5]):.9g}"
        self._current_surf_data["material"] = name

    def _refuse_aperture(self, data):
        self._refuse(", aperture", data[0], "expected a circle, as CLAP or FLAP")


def read_zemax(path: Path, field: tuple[str, float] | None = None) -> Prescription:
    """Read a sequential .zmx. Circular apertures stop light; vignetting factors are left aside."""
    parser = _Parser(str(path))
    model = parser.parse()
    scale, catalogues = parser.unit_mm, model.glass_catalogs or []
    rows = [model.surfaces[index] for index in sorted(model.surfaces)]
    _check_ends(path, rows)
    surfaces = tuple(_surface(path, number, row, scale, catalogues) for number, row in enumerate(rows[1:-1], 1))
    distance_mm = rows[0]["thickness"] * scale
    return Prescription(
        name=model.name or path.stem, surfaces=surfaces, aperture=_aperture(path, model, scale),
        field=field or _field(path, model, scale), object_distance_mm=object_distance(distance_mm),
        reference_wavelength_nm=_reference_nm(path, model), source=f"{path.name} (Zemax)",
        notes=_notes(model, surfaces, field))


def _check_ends(path, rows):
    """Object and image are planes in air, and the image is the last surface: a file that is cut off has another."""
    if len(rows) < 3:
        raise LensError(path, "surfaces", f"{len(rows)}", "expected an object, a lens and an image")
    for number, row in enumerate(rows):
        if not {"radius", "thickness"} <= row.keys():
            raise LensError(path, f"surface {number}", "without CURV or DISZ", "the file may be cut off")
    for name, row in (("object", rows[0]), ("image", rows[-1])):
        if np.isfinite(row["radius"]) or row["type"] != "standard":
            raise LensError(path, name, "no plane", "expected a flat object and a flat image")
        if row["material"] != "air":
            raise LensError(path, name, f"in {row['material']}", "expected air before and behind the lens")
    if rows[-1]["thickness"] != 0:
        raise LensError(path, "image", "not there", "expected a last surface of thickness 0: the file may be cut off")


def _surface(path, number, row, scale, catalogues):
    if row["type"] not in SHAPES:
        raise LensError(path, f"surface {number}", row["type"], f"expected one of {', '.join(SHAPES)}")
    aperture, glass = row.get("aperture"), row["material"]
    if getattr(aperture, "offset_x", 0) or getattr(aperture, "offset_y", 0) or getattr(aperture, "r_min", 0):
        raise LensError(path, f"surface {number}, aperture", "decentred or annular", "expected a centred circle")
    terms = [row.get(f"param_{index}", 0.0) for index in range(COEFFICIENTS)] if row["type"] == "even_asphere" else []
    surface = Surface(row["radius"], row["thickness"], "" if glass == "air" else best_name(glass, catalogues),
                      aperture.r_max if aperture else np.inf, row["conic"], tuple(terms) if any(terms) else (),
                      row["is_stop"])
    return surface.scaled(scale)


def _aperture(path, model, scale):
    if model.fields.get("object_space_telecentric"):
        raise LensError(path, "FTYP", "telecentric in object space", "expected rays to be aimed at the stop")
    if model.aperture.get("floating_stop"):
        sizes = [row.get("diameter") for row in model.surfaces.values() if row["is_stop"]]
        if len(sizes) != 1 or sizes[0] is None:
            raise LensError(path, "FLOA", "without the size of a stop", "expected DIAM at the surface with STOP")
        return "stop", sizes[0] * scale  # what is called DIAM is the semi-diameter
    aperture = known_aperture(model.aperture, APERTURES, scale)
    if aperture is None:
        raise LensError(path, "aperture", ", ".join(model.aperture) or "missing", "expected ENPD, FNUM, OBNA or FLOA")
    return aperture


def _field(path, model, scale):
    fields = model.fields
    return field_end(path, FIELDS.get(fields["type"]), fields["x"], fields["y"], scale)


def _reference_nm(path, model):
    primary = model.wavelengths.get("primary_index", 0)
    if primary is None or primary >= len(model.wavelengths["data"]):
        raise LensError(path, "PWAV", "missing", "expected the number of one of the file's wavelengths, WAVM")
    return 1e3 * model.wavelengths["data"][primary]


def _notes(model, surfaces, field):
    """What the file says and we do otherwise."""
    factors = [value for key in model.fields if key.startswith("vignette") for value in model.fields[key]]
    real = field is None and model.fields["type"] == "real_image_height"
    return " ".join(filter(None, (vignetting_note(factors, surfaces),
                                  real and "The file's real image height is taken as a paraxial one.")))
