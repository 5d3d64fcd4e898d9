"""Zemax .zmx, sequential: operands that tell of the system, and after each SURF those of a surface."""

import re
from collections import defaultdict
from pathlib import Path

import numpy as np

from ...errors import LensError
from ...lens.readers.assembly import object_distance
from ...lens.readers.text import read_text
from ..glasses import best_name
from ..prescription import Prescription, Surface
from .field_and_aperture import field_end, in_mm, vignetting_note
from .lines import numbered

UNITS_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "INCH": 25.4, "METER": 1000.0, "M": 1000.0}
APERTURES = {("ENPD", 0): "entrance_pupil_diameter_mm", ("FNUM", 0): "f_number", ("FNUM", 1): "working_f_number",
             ("OBNA", 0): "object_na"}
FIELDS = {0: "angle_deg", 1: "object_height_mm", 2: "image_height_mm", 3: "image_height_mm"}
REAL_IMAGE_HEIGHT = 3
SHAPES = ("STANDARD", "EVENASPH", "ODDASPHE")
OTHER_APERTURES = ("SQAP", "ELAP", "USAP", "OBSC", "SQOB", "ELOB", "SPID")
SURFACE_OPERANDS = ("TYPE", "CURV", "CONI", "PARM", "DISZ", "GLAS", "STOP", "DIAM", "CLAP", "FLAP", "OBDC",
                    *OTHER_APERTURES)
COEFFICIENTS = 8
PLACEHOLDER = (1.5, 40.0)  # what Zemax writes beside the name of a glass, whatever its index and Abbe number


def read_zemax(path: Path, field: tuple[str, float] | None = None) -> Prescription:
    """Read a sequential .zmx. Circular apertures stop light; vignetting factors are left aside."""
    system, rows = _operands(path)
    if "MODE" in system and system["MODE"][-1].words[1:2] != ("SEQ",):
        raise system["MODE"][-1].refusal("expected a sequential lens, MODE SEQ")
    unit_mm = _unit_mm(system)
    makers = system["GCAT"][-1].words[1:] if "GCAT" in system else ()
    _check_ends(path, rows)
    surfaces = tuple(_surface(path, number, row, makers).scaled(unit_mm) for number, row in enumerate(rows[1:-1], 1))
    name = " ".join(system["NAME"][-1].words[1:]) if "NAME" in system else ""
    return Prescription(
        name=name or path.stem, surfaces=surfaces, aperture=_aperture(path, system, rows, unit_mm),
        field=field or _field(path, system, unit_mm),
        object_distance_mm=object_distance(rows[0]["DISZ"][-1].figure(1) * unit_mm),
        reference_wavelength_nm=_reference_nm(path, system), source=f"{path.name} (Zemax)",
        notes=_notes(system, surfaces, field))


def _operands(path):
    """{operand: its lines} of the system, and of each surface."""
    system, rows = defaultdict(list), []
    for line in numbered(path, read_text(path).splitlines()):
        operand = line.words[0]
        if operand != "NAME":  # some systems write decimal commas
            line = line._replace(words=tuple(re.sub(r"(?<=\d),(?=\d)", ".", word) for word in line.words))
        if operand == "SURF":
            rows.append(defaultdict(list))
        elif rows and operand in SURFACE_OPERANDS:
            rows[-1][operand].append(line)
        elif operand not in SURFACE_OPERANDS:
            system[operand].append(line)
    return system, rows


def _unit_mm(system):
    if "UNIT" not in system:
        return 1.0
    line = system["UNIT"][-1]
    unit = line.words[1].upper() if len(line.words) > 1 else ""
    if unit not in UNITS_MM:
        raise LensError(line.path, "UNIT", unit, f"expected one of {', '.join(UNITS_MM)}")
    return UNITS_MM[unit]


def _check_ends(path, rows):
    """Object and image are planes in air, and the image is the last surface: a file that is cut off has another."""
    if len(rows) < 3:
        raise LensError(path, "surfaces", f"{len(rows)}", "expected an object, a lens and an image")
    for number, row in enumerate(rows):
        if not {"CURV", "DISZ"} <= row.keys():
            raise LensError(path, f"surface {number}", "without CURV or DISZ", "the file may be cut off")
    for name, row in (("object", rows[0]), ("image", rows[-1])):
        if row["CURV"][-1].figure(1) != 0 or _shape(row) != "STANDARD":
            raise LensError(path, name, "no plane", "expected a flat object and a flat image")
        if "GLAS" in row:
            raise LensError(path, name, f"in {' '.join(row['GLAS'][-1].words[1:2])}",
                            "expected air before and behind the lens")
    if rows[-1]["DISZ"][-1].figure(1) != 0:
        raise LensError(path, "image", "not there", "expected a last surface of thickness 0: the file may be cut off")


def _shape(row):
    return " ".join(row["TYPE"][-1].words[1:2]) if "TYPE" in row else "STANDARD"


def _surface(path, number, row, makers):
    shape = _shape(row)
    if shape not in SHAPES:
        raise LensError(path, f"surface {number}", shape, f"expected one of {', '.join(SHAPES)}")
    curvature = row["CURV"][-1].figure(1)
    terms = {line.figure(1): line.figure(2) for line in row["PARM"]}
    terms = [terms.get(index, 0.0) for index in range(1, COEFFICIENTS + 1)] if shape != "STANDARD" else []
    odd, even = (terms[::2], terms[1::2]) if shape == "ODDASPHE" else ([], terms)
    glass, figures = _glass(path, number, row, makers)
    return Surface(1 / curvature if curvature else np.inf, row["DISZ"][-1].figure(1), glass,
                   _semi_aperture(path, number, row), row["CONI"][-1].figure(1) if "CONI" in row else 0.0,
                   tuple(even) if any(even) else (), "STOP" in row, tuple(odd) if any(odd) else (), figures)


def _glass(path, number, row, makers):
    """Name of a surface's glass, and what its line tells of index and Abbe number."""
    if "GLAS" not in row:
        return "", ""
    line = row["GLAS"][-1]
    name = " ".join(line.words[1:2])
    if name.upper() == "MIRROR":
        raise LensError(path, f"surface {number}", "a mirror", "expected refracting surfaces")
    told = (line.figure(4), line.figure(5)) if len(line.words) > 5 else PLACEHOLDER
    figures = f"{told[0]:.9g}/{told[1]:.9g}" if told != PLACEHOLDER and told[0] > 1 else ""
    if name.startswith("___") and line.words[2:3] == ("1",):  # a model glass, which is these figures
        return f"{told[0]:.9g}/{told[1]:.9g}", ""
    return best_name(name, makers), figures


def _semi_aperture(path, number, row):
    for operand in OTHER_APERTURES:
        if operand in row:
            raise LensError(path, f"surface {number}, aperture", operand, "expected a circle, as CLAP or FLAP")
    circles = [*row["CLAP"], *row["FLAP"]]
    if not circles:
        return np.inf
    least, most = circles[-1].figure(1), circles[-1].figure(2)
    if least or any(line.figure(1) or line.figure(2, 0.0) for line in row["OBDC"]):
        raise LensError(path, f"surface {number}, aperture", "decentred or annular", "expected a centred circle")
    return most


def _aperture(path, system, rows, unit_mm):
    if "FLOA" in system:
        sizes = [row["DIAM"] for row in rows if "STOP" in row]
        if len(sizes) != 1 or not sizes[0]:
            raise LensError(path, "FLOA", "without the size of a stop", "expected DIAM at the surface with STOP")
        return "stop", sizes[0][-1].figure(1) * unit_mm  # what is called DIAM is the semi-diameter
    told = next((system[operand][-1] for operand in system if operand in ("ENPD", "FNUM", "OBNA")), None)
    if told is None:
        raise LensError(path, "aperture", "missing", "expected ENPD, FNUM, OBNA or FLOA")
    operand = told.words[0]
    kind = APERTURES.get((operand, 0 if operand == "ENPD" else told.figure(2, 0.0)))
    if kind is None:
        raise told.refusal("expected ENPD, FNUM, OBNA with 0 or FLOA")
    return kind, in_mm(kind, told.figure(1), unit_mm)


def _kind_of_field(system):
    return system["FTYP"][-1].figure(1, 0.0) if "FTYP" in system else 0.0


def _columns(system, *operands):
    """Numbers of the last line with one of these operands: one for each field, of so many as FTYP tells."""
    lines = [line for operand in operands for line in system.get(operand, ())]
    count = system["FTYP"][-1].figure(3, np.inf) if "FTYP" in system else np.inf
    return [value for at, value in enumerate(lines[-1].figures() if lines else ()) if at < count]


def _field(path, system, unit_mm):
    if "FTYP" in system and system["FTYP"][-1].figure(2, 0.0):
        raise LensError(path, "FTYP", "telecentric in object space", "expected rays to be aimed at the stop")
    x, y = _columns(system, "XFLD", "XFLN"), _columns(system, "YFLD", "YFLN")
    return field_end(path, FIELDS.get(_kind_of_field(system)), x, y, unit_mm)


def _reference_nm(path, system):
    """The primary one of the wavelengths, which are told by number, or in old files in a row."""
    slots = {line.figure(1): line.figure(2) for line in system.get("WAVM", ())}
    for operand in ("WAVL", "WAVN"):
        if operand in system:
            slots |= dict(enumerate(system[operand][-1].figures(), 1))
    primary = system["PWAV"][-1].figure(1) if "PWAV" in system else 1
    if primary not in slots:
        raise LensError(path, "PWAV", f"{primary:g}", "expected the number of one of the file's wavelengths, WAVM")
    return 1e3 * slots[primary]


def _notes(system, surfaces, field):
    """What the file says and we do otherwise, or of which it says more than one thing."""
    factors = [value for operand in ("VDXN", "VDYN", "VCXN", "VCYN", "VANN") for value in _columns(system, operand)]
    real = field is None and _kind_of_field(system) == REAL_IMAGE_HEIGHT
    configurations = system["MNUM"][-1].figure(1, 1.0) if "MNUM" in system else 1.0
    current = system["MNUM"][-1].figure(2, 1.0) if configurations > 1 else 1.0
    return " ".join(filter(None, (
        vignetting_note(factors, surfaces), real and "The file's real image height is taken as a paraxial one.",
        configurations > 1 and f"Of the file's {configurations:g} configurations number {current:g} is taken, in which "
                               "it was saved.")))
