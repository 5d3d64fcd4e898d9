"""Code V .seq, by Optiland's parser; glasses go by their names, for its own lookup makes up what it lacks."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from optiland.fileio.codev.reader.parser import CodeVDataParser

from ...errors import LensError
from ...lens.readers.assembly import object_distance
from ...lens.readers.text import read_text, shown
from ..glasses import best_name
from ..prescription import Prescription, Surface
from .field_and_aperture import field_end, known_aperture, vignetting_note

UNITS_MM = {"M": 1.0, "C": 10.0, "I": 25.4}
APERTURES = {"EPD": "entrance_pupil_diameter_mm", "FNO": "working_f_number", "NAO": "object_na", "NA": "image_na"}
FIELDS = {"angle": "angle_deg", "object_height": "object_height_mm", "paraxial_image_height": "image_height_mm"}
TILTS = ("xde", "yde", "zde", "ade", "bde", "cde")
SHAPES = ("SPS", "CYL", "XTO", "YTO", "AAS", "DIF", "GRT", "MFL")
OTHER_APERTURES = ("REX", "REY", "ELX", "ELY", "ADX", "ADY", "REG", "ELG", "CIG")
VIGNETTING = ("VUX", "VLX", "VUY", "VLY")
LATER = ("CUY", "CUX", "RDY", "RDX", "THI", "GLA", "RMD", "SCA")  # what changes surfaces of lines before
QUOTED = re.compile(r"""('[^'\n]*')|"[^"\n]*"|![^\n]*""")


class _Parser(CodeVDataParser):
    """Optiland's parser, with glasses by name, and with errors for what it would pass over."""

    def __init__(self, filename):
        super().__init__(filename)
        self.data_model.radius_mode = None  # until the file says which it has
        self.vignetting_factors = []
        self._global_table |= dict.fromkeys(VIGNETTING, self._read_vignetting)
        refused = (dict.fromkeys(SHAPES, "expected a conic or an asphere (ASP)")
                   | dict.fromkeys(OTHER_APERTURES, "expected circular apertures (CIR)")
                   | dict.fromkeys(LATER, "expected radius, thickness and glass on the line of their surface"))
        for command, remedy in refused.items():
            self._surf_modifier_table[command] = lambda words, remedy=remedy: self._refuse(words, remedy)

    def _refuse(self, words, remedy):
        raise LensError(self.filename, f"surface {self._current_surf}", shown(" ".join(words)), remedy)

    def _load_and_preprocess(self):
        """Commands as lists of words: without comments, lines with & joined, parted at ; that stand in no title."""
        text = "\n".join(read_text(self.filename).splitlines())
        text = QUOTED.sub(lambda match: (match[1] or "").replace(";", ","), text)
        lines = re.sub(r"&[ \t]*\n", " ", text).split("\n")
        return [words for line in lines for words in map(str.split, line.split(";")) if words]

    def _dispatch(self, words):
        command = words[0].upper()
        try:
            if command in ("SO", "S", "SI") and not self._in_prv_block:
                self._check_surface(words)
            if self._current_surf < 0 and command == "STO":  # Optiland would begin a surface
                self._read_sto(words)
            else:
                super()._dispatch(words)
        except LensError:
            raise
        except (ValueError, IndexError, OverflowError) as error:
            raise LensError(self.filename, "command", shown(" ".join(words)), f"not readable: {error}") from None

    def _check_surface(self, words):
        if not all(map(_is_number, words[1:3])):
            raise LensError(self.filename, f"surface {self._current_surf + 1}", shown(" ".join(words)),
                            "expected a radius or curvature, a thickness, and a glass")
        if self.data_model.radius_mode is None and len(words) > 1 and float(words[1]):
            raise LensError(self.filename, "RDM", "missing", "expected RDM, for radii, or RDM N, for curvatures, first")

    def _read_dim(self, words):
        unit = words[1][:1].upper()
        if unit not in UNITS_MM:
            raise LensError(self.filename, "DIM", words[1], f"expected one of {', '.join(UNITS_MM)}")
        self.data_model.units = unit

    def _read_rdm(self, words):
        self.data_model.radius_mode = not (len(words) > 1 and words[1].upper().startswith("N"))

    def _read_prv(self, words):
        self._in_prv_block = True  # its glasses are in no catalogue, and an error says so

    def _read_cir(self, words):
        kind = words[1].upper() if len(words) == 3 else "CLR"
        if len(words) not in (2, 3) or kind not in ("CLR", "EDG") or not _is_number(words[-1]):
            self._refuse(words, "expected CIR and the radius of a clear aperture")
        if kind == "CLR":  # EDG is where the glass ends, and stops no light
            super()._read_cir(words)

    def _read_vignetting(self, words):
        self.vignetting_factors += map(float, words[1:])

    def _parse_glass(self, token):
        return token.strip("'\"")


def read_codev(path: Path, field: tuple[str, float] | None = None) -> Prescription:
    """Read a .seq. CIR apertures stop light; vignetting factors are left aside."""
    parser = _Parser(str(path))
    model = parser.parse()
    scale = UNITS_MM.get(model.units, 1.0)
    rows = [model.surfaces[index] for index in sorted(model.surfaces)]
    _check_ends(path, rows)
    stop = model.sto_surface_index
    surfaces = [_surface(path, number, row, stop) for number, row in enumerate(rows[1:-1], 1)]
    defocus = rows[-1]["thickness"]  # of SI: the image plane lies that much behind the paraxial one
    surfaces[-1] = replace(surfaces[-1], thickness_mm=surfaces[-1].thickness_mm + defocus)
    distance_mm = rows[0]["thickness"] * scale
    return Prescription(
        name=model.name or path.stem, surfaces=tuple(surface.scaled(scale) for surface in surfaces),
        aperture=_aperture(path, model, scale), field=field or _field(path, model, scale),
        object_distance_mm=object_distance(distance_mm),
        reference_wavelength_nm=_reference_nm(path, model), source=f"{path.name} (Code V)",
        notes=vignetting_note(parser.vignetting_factors, surfaces))


def _check_ends(path, rows):
    """Object and image are there, and are planes in air."""
    if [row["type"] for row in rows] != ["object", *["standard"] * (len(rows) - 2), "image"] or len(rows) < 3:
        raise LensError(path, "surfaces", f"{len(rows)}", "expected SO, S ... and SI")
    for name, row in (("SO", rows[0]), ("SI", rows[-1])):
        if np.isfinite(row["radius"]) or _glass_name(row["material"] or ""):
            raise LensError(path, name, "no plane in air", "expected a flat object and a flat image")


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
    name, _, catalogue = token.partition("_")
    return best_name(name, [catalogue] if catalogue else [])


def _aperture(path, model, scale):
    aperture = known_aperture(model.aperture, APERTURES, scale)
    if aperture is None:
        raise LensError(path, "aperture", "missing", f"expected one of {', '.join(APERTURES)}")
    kind, value = aperture
    return aperture if kind != "image_na" else ("working_f_number", 0.5 / value if value else 0.0)


def _field(path, model, scale):
    fields = model.fields
    return field_end(path, FIELDS.get(fields.get("type")), fields.get("x", ()), fields.get("y", ()), scale)


def _reference_nm(path, model):
    wavelengths, reference = model.wavelengths["data"], model.wavelengths.get("primary_index", 0)
    if not 0 <= reference < len(wavelengths):
        raise LensError(path, "REF", reference + 1, "expected the number of one of the file's wavelengths, WL")
    return 1e3 * wavelengths[reference]


def _is_number(word):
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
