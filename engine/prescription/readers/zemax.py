"""Sequential Zemax .zmx: operands for the system, and after each SURF for a surface."""

import re
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ...runtime.text import object_distance
from ...runtime.unread import unread_names
from ..glasses import best_name
from ..prescription import MOST_TERMS, Prescription, Surface, check_surface_count
from .field_and_aperture import field_end, in_mm, vignetting_note
from .frames import START, check_return, posed
from .lines import numbered
from .reading import SEMI_DIAMETERS, Reading, ReadingOptions, with_stop

UNITS_MM = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "INCH": 25.4, "METER": 1000.0, "M": 1000.0}
APERTURES = {("ENPD", 0): "entrance_pupil_diameter_mm", ("FNUM", 0): "f_number", ("FNUM", 1): "working_f_number",
             ("OBNA", 0): "object_na"}
FIELDS = {0: "angle_deg", 1: "object_height_mm", 2: "image_height_mm", 3: "image_height_mm"}
REAL_IMAGE_HEIGHT = 3
EXTENDED = {"XASPHERE": 2, "XOSPHERE": 1}  # steps between the powers of r; coefficients are extra data
TERMS, NORMALISATION, FIRST_TERM = 1, 2, 3  # numbers of an extended asphere's extra data
SHAPES = ("STANDARD", "EVENASPH", "ODDASPHE", *EXTENDED, "TOROIDAL", "BICONICX", "COORDBRK")
BREAK, COATING = "COORDBRK", "COAT"  # a coating is a name, which another file defines
RECTANGLE, OBSTRUCTION, OTHER_APERTURES = "SQAP", "OBSC", ("ELAP", "USAP", "SQOB", "ELOB", "SPID")
APERTURE_OPERANDS = ("CLAP", "FLAP", RECTANGLE, OBSTRUCTION, *OTHER_APERTURES)
SURFACE_OPERANDS = ("TYPE", "CURV", "CONI", "PARM", "DISZ", "GLAS", "STOP", "DIAM", "OBDC", "SCBD", "XDAT",
                    *APERTURE_OPERANDS)
WITH_EXTRA_DATA = ("TOROIDAL", *EXTENDED)
LAST_PARAMETERS = {**dict.fromkeys(EXTENDED, 0), "EVENASPH": 8, "ODDASPHE": 8, "TOROIDAL": 8, "BICONICX": 2}
ZERNIKE_TERMS = 13  # parameter of a toroid: their number; in older files the first of its extra data
AUTOMATIC, FIXED, PICKED_UP = 0, 1, 2  # source of a semi-diameter: rays, the user, or another surface
SYSTEM_OPERANDS = ("MODE", "UNIT", "GCAT", "NAME", "ENPD", "FNUM", "OBNA", "FLOA", "FTYP", "XFLD", "XFLN", "YFLD",
                   "YFLN", "WAVM", "WAVL", "WAVN", "PWAV", "VDXN", "VDYN", "VCXN", "VCYN", "VANN", "MNUM", "ENVD")
HARMLESS_OPERANDS = (  # remarks; how Zemax traces, draws, polishes and makes
    "VERS", "NOTE", "PFIL", "LANG", "AUTH", "LUID", "HYPR", "GFAC", "RAIM", "PUSH", "SDMA", "OMMA", "ROPD", "PICB",
    "FWGN", "FWGT", "WWGT", "WWGN", "POLS", "GLRS", "GSTD", "NSCD", "COFN", "EERA", "IWDP", "DBDT", "FSVY", "STUD",
    "FCOM", "COMM", "HIDE", "MIRR", "SLAB", "POPS", "FIMP", "MEMA", "SSID", "NSCS", "MAZH", "TOLE", "PZUP",
    "OEMA", "PPAR", "VPAR", "PIKU", "VDSZ", "CVVA", "ZVCX", "ZVCY", "ZVDX", "ZVDY", "ZVAN", "PROD")
TAIL = ("BLNK", "TOL", "MNUM", "MOFF")  # start of the merit function, tolerances and configurations
USUAL_AIR = (20.0, 1.0)  # degrees Celsius and atmospheres, the conditions of the catalogues' indices
PLACEHOLDER = (1.5, 40.0)  # written by Zemax after a glass name, regardless of its index and Abbe number


def read_zemax(path: Path, text: str, options: ReadingOptions) -> Reading:
    """Read a sequential .zmx. Circular and rectangular apertures, central obstructions and fixed semi-diameters block
    light; vignetting factors do not."""
    system, rows, unread = _operands(path, text)
    field = options.field
    if "MODE" in system and system["MODE"][-1].words[1:2] != ("SEQ",):
        raise system["MODE"][-1].refusal("expected a sequential lens, MODE SEQ")
    if "FTYP" in system and system["FTYP"][-1].figure(2, 0.0):
        raise LensError(path, "FTYP", "telecentric in object space", "expected rays to be aimed at the stop")
    unit_mm = _unit_mm(system)
    makers = system["GCAT"][-1].words[1:] if "GCAT" in system else ()
    _check_ends(path, rows)
    surfaces, image_pose = _lens(path, rows, makers)
    surfaces = [surface.scaled(unit_mm) for surface in surfaces]
    sizes = _semi_diameters(rows, surfaces, unit_mm)
    if (options.semi_diameters or SEMI_DIAMETERS[0]) == "aperture":
        surfaces = [replace(surface, semi_aperture_mm=sizes.get(number, surface.semi_aperture_mm))
                    for number, surface in enumerate(surfaces, 1)]
    name = " ".join(system["NAME"][-1].words[1:]) if "NAME" in system else ""
    return Reading(Prescription(
        name=name or path.stem, surfaces=with_stop(path, surfaces, options),
        aperture=_aperture(path, system, rows, unit_mm), focus=options.image_plane or "as given",
        field=field or _field(path, system, unit_mm),
        object_distance_mm=object_distance(rows[0]["DISZ"][-1].figure(1) * unit_mm),
        reference_wavelength_nm=_reference_nm(path, system), source=f"{path.name} (Zemax)",
        image_pose=image_pose and image_pose.scaled(unit_mm),
        notes=_notes(system, surfaces, options, sizes)), unread=(*unread, *_unread_of_surfaces(rows)))


def _operands(path, text):
    """{operand: its lines} of the system and of each surface; and the names of unused operands."""
    system, rows, names, ended = defaultdict(list), [], [], False
    for line in numbered(path, text.splitlines()):
        operand = line.words[0]
        if operand != "NAME":  # some systems write decimal commas
            line = line._replace(words=tuple(re.sub(r"(?<=\d),(?=\d)", ".", word) for word in line.words))
        ended = ended or bool(rows) and operand in TAIL
        names += () if ended else (" ".join(line.words[:2]) if operand == COATING else operand,)
        if operand == "SURF":
            rows.append(defaultdict(list))
        elif rows and operand in SURFACE_OPERANDS:
            rows[-1][operand].append(line)
        elif operand not in SURFACE_OPERANDS:
            system[operand].append(line)
    return system, rows, unread_names(names, ("SURF", *SURFACE_OPERANDS, *SYSTEM_OPERANDS, *HARMLESS_OPERANDS))


def _unread_of_surfaces(rows):
    """Names of the surfaces' figures that a surface of their type does not have, and of apertures at the ends."""
    for number, row in enumerate(rows):
        shape, at_end = _shape(row), number in (0, len(rows) - 1)
        last = {"PARM": 0 if shape == "STANDARD" else np.inf, "XDAT": _last_extra(row)}
        yield from (f"{operand} of surface {number}" for operand, most in last.items()
                    if any(line.figure(2) for line in row[operand] if line.figure(1) > most))
        yield from (f"{operand} of surface {number}" for operand in APERTURE_OPERANDS if at_end and row[operand])


def _last_extra(row):
    """Number of the last extra data that the surface's type uses."""
    if _shape(row) in EXTENDED:
        return FIRST_TERM + _numbered(row["XDAT"]).get(TERMS, 0) - 1
    return np.inf if _shape(row) in WITH_EXTRA_DATA else 0


def _numbered(lines):
    """{number: value} of a surface's parameters or extra data."""
    return {line.figure(1): line.figure(2) for line in lines}


def _unit_mm(system):
    if "UNIT" not in system:
        return 1.0
    line = system["UNIT"][-1]
    unit = line.words[1].upper() if len(line.words) > 1 else ""
    if unit not in UNITS_MM:
        raise LensError(line.path, "UNIT", unit, f"expected one of {', '.join(UNITS_MM)}")
    return UNITS_MM[unit]


def _check_ends(path, rows):
    """Check that object and image are planes in air, and that the last surface is the image: a truncated file ends with
    another."""
    check_surface_count(path, len(rows) - 2)  # without object and image
    if len(rows) < 3:
        raise LensError(path, "surfaces", f"{len(rows)}", "this file contains no lens")
    for number, row in enumerate(rows):
        if not {"CURV", "DISZ"} <= row.keys():
            raise LensError(path, f"surface {number}", "without CURV or DISZ", "the file may be cut off")
    for name, row in (("object", rows[0]), ("image", rows[-1])):
        if row["CURV"][-1].figure(1) != 0 or _shape(row) != "STANDARD":
            raise LensError(path, name, "not a plane", "expected a flat object and a flat image")
        if "GLAS" in row:
            raise LensError(path, name, f"in {' '.join(row['GLAS'][-1].words[1:2])}",
                            "expected air in front of and behind the lens")
    if rows[-1]["DISZ"][-1].figure(1) != 0:
        raise LensError(path, "image", "missing", "expected a last surface of thickness 0: the file may be cut off")


def _shape(row):
    return " ".join(row["TYPE"][-1].words[1:2]) if "TYPE" in row else "STANDARD"


def _lens(path, rows, makers):
    """The surfaces in the unit of the file, and the pose of the image plane."""
    surfaces = []
    for number, row in enumerate(rows[1:-1], 1):
        surfaces.append(_surface(path, number, row, makers, surfaces[-1].glass if surfaces else ""))
    surfaces, image_pose = posed(surfaces, list(_frames(rows[1:])))
    if _shape(rows[-2]) != BREAK:
        check_return(path, image_pose)
    return surfaces, image_pose


def _surface(path, number, row, makers, glass_before):
    shape = _shape(row)
    if shape not in SHAPES:
        raise LensError(path, f"surface {number}", shape, f"expected one of {', '.join(SHAPES)}")
    if any(value for line in row["SCBD"] for value in line.figures(4)[:4]):
        raise LensError(path, f"surface {number}", "tilted or decentred", "expected coordinate breaks before and after")
    if shape == BREAK:  # a plane on the axis, within the preceding medium
        return Surface(thickness_mm=row["DISZ"][-1].figure(1), glass=glass_before, stop="STOP" in row)
    curvature = row["CURV"][-1].figure(1)
    mirror = _is_mirror(row)
    glass, figures = (glass_before, "") if mirror else _glass(row, makers)
    conic = Surface(1 / curvature if curvature else np.inf, row["DISZ"][-1].figure(1), glass,
                    conic=row["CONI"][-1].figure(1) if "CONI" in row else 0.0, stop="STOP" in row, mirror=mirror,
                    glass_figures=figures, **_aperture_of(path, number, row))
    return replace(conic, **_form(path, number, row)) if shape != "STANDARD" else conic


def _form(path, number, row):
    """Fields of a surface from its parameters: aspheric terms, or a second section."""
    shape, parameters = _shape(row), _numbered(row["PARM"])
    unknown = [index for index, value in parameters.items() if value and index > LAST_PARAMETERS[shape]]
    extra = [line.figure(2) for line in row["XDAT"] if line.figure(1) == 1]
    if shape == "TOROIDAL":
        unknown = [ZERNIKE_TERMS] if any((*extra, parameters.get(ZERNIKE_TERMS))) else []
    if unknown:
        raise LensError(path, f"surface {number}, PARM", f"{max(unknown):g}",
                        f"expected at most {LAST_PARAMETERS[shape]} coefficients")
    if shape in EXTENDED:
        return _extended(path, number, _numbered(row["XDAT"]), EXTENDED[shape])
    terms = tuple(parameters.get(index, 0.0) for index in range(1, LAST_PARAMETERS[shape] + 1))
    if shape in ("TOROIDAL", "BICONICX"):
        return _sections(shape, *terms)
    return _powers(terms, 1 if shape == "ODDASPHE" else 2)


def _powers(terms, step):
    """Fields of a surface with these coefficients of r^step, r^(2 step) ..."""
    odd, even = (terms[::2], terms[1::2]) if step == 1 else ((), terms)
    return {"aspheric": even if any(even) else (), "odd_aspheric": odd if any(odd) else ()}


def _extended(path, number, extra, step):
    """Fields of an extended asphere: its coefficients are of powers of r over a normalisation radius."""
    count, radius = extra.get(TERMS, 0.0), extra.get(NORMALISATION, 0.0)
    if count not in range(MOST_TERMS + 1):
        raise LensError(path, f"surface {number}, XDAT {TERMS}", f"{count:g}", f"expected 0 to {MOST_TERMS} terms")
    if count and not radius > 0:
        raise LensError(path, f"surface {number}, XDAT {NORMALISATION}", f"{radius:g}",
                        "expected a positive normalisation radius")
    return _powers(tuple(extra.get(FIRST_TERM + at, 0.0) / radius**(step * (at + 1)) for at in range(int(count))), step)


def _sections(shape, radius_x, *others):
    """Fields of a toroid, whose profile is along y, or of a biconic surface; a radius of 0 is a plane section."""
    section = {"radius_x_mm": radius_x or np.inf}
    if shape == "BICONICX":
        return section | {"conic_x": others[0]}
    return section | {"profile": "y", "aspheric": others if any(others) else ()}


def _frames(rows):
    """Frame of each row behind the object; a coordinate break, without effect on rays, is on the axis."""
    frame = START
    for row in rows:
        frame = _broken(frame, row) if _shape(row) == BREAK else frame
        yield frame.centred() if _shape(row) == BREAK else frame
        frame = frame.moved(0.0, 0.0, row["DISZ"][-1].figure(1))


def _broken(frame, row):
    """The frame behind a coordinate break: moved and then turned, or turned in reverse order and then moved."""
    parameters = _numbered(row["PARM"])
    x, y = parameters.get(1, 0.0), parameters.get(2, 0.0)
    turns = [(axis, parameters.get(index, 0.0)) for index, axis in enumerate("xyz", 3)]
    if parameters.get(6, 0.0):  # the order
        return frame.turned(*reversed(turns)).moved(x, y, 0.0)
    return frame.moved(x, y, 0.0).turned(*turns)


def _semi_diameters(rows, surfaces, unit_mm):
    """{surface: semi-diameter in mm} of user-fixed semi-diameters, on surfaces without another aperture."""
    return {number: unit_mm * rows[number]["DIAM"][-1].figure(1) for number, surface in enumerate(surfaces, 1)
            if np.isinf(surface.semi_aperture_mm) and not surface.half_widths_mm and _is_fixed(rows, number, len(rows))}


def _is_fixed(rows, number, steps):
    """Whether a semi-diameter is fixed by the user, directly or by a pickup from another surface, and not 0.

    Without a flag, semi-diameters are fixed: programs that omit it do not have automatic ones.
    """
    if not steps or not 0 <= number < len(rows) or not rows[number]["DIAM"]:
        return False
    line = rows[number]["DIAM"][-1]
    origin = line.figure(2, FIXED)
    if origin == PICKED_UP:
        return line.figure(1) > 0 and _is_fixed(rows, int(line.figure(3, -1)), steps - 1)
    return line.figure(1) > 0 and origin == FIXED


def _is_mirror(row):
    return "GLAS" in row and " ".join(row["GLAS"][-1].words[1:2]).upper() == "MIRROR"


def _glass(row, makers):
    """Name of a surface's glass, and "n/V" from its line."""
    if "GLAS" not in row:
        return "", ""
    line = row["GLAS"][-1]
    name = " ".join(line.words[1:2])
    stated = (line.figure(4), line.figure(5)) if len(line.words) > 5 else PLACEHOLDER
    figures = f"{stated[0]:.9g}/{stated[1]:.9g}" if stated != PLACEHOLDER and stated[0] > 1 else ""
    if name.startswith("___") and line.words[2:3] == ("1",):  # a model glass, defined by these figures
        return f"{stated[0]:.9g}/{stated[1]:.9g}", ""
    return best_name(name, makers), figures


def _aperture_of(path, number, row):
    """Fields of a surface from its clear aperture and its central obstruction."""
    for operand in OTHER_APERTURES:
        if operand in row:
            raise LensError(path, f"surface {number}, aperture", operand, "expected a circle, CLAP or FLAP, a "
                            f"rectangle, {RECTANGLE}, or a central obstruction, {OBSTRUCTION}")
    circles, holes = [*row["CLAP"], *row["FLAP"]], row[OBSTRUCTION]
    if (circles or holes or row[RECTANGLE]) and any(line.figure(1) or line.figure(2, 0.0) for line in row["OBDC"]):
        raise LensError(path, f"surface {number}, aperture", "decentred", "expected a centred circle or rectangle")
    if holes and holes[-1].figure(1):
        raise LensError(path, f"surface {number}, aperture", "an obstruction in the shape of a ring",
                        "expected OBSC from a radius of 0")
    inner, outer = (circles[-1].figure(1), circles[-1].figure(2)) if circles else (0.0, np.inf)
    return {"semi_aperture_mm": outer, "semi_obstruction_mm": max(inner, *(line.figure(2) for line in holes[-1:]), 0.0),
            "half_widths_mm": tuple(row[RECTANGLE][-1].figures()[:2]) if row[RECTANGLE] else ()}


def _aperture(path, system, rows, unit_mm):
    if "FLOA" in system:
        sizes = [row["DIAM"] for row in rows if "STOP" in row]
        if len(sizes) != 1 or not sizes[0]:
            raise LensError(path, "FLOA", "without a stop size", "expected DIAM at the surface with STOP")
        return "stop", sizes[0][-1].figure(1) * unit_mm  # DIAM is the semi-diameter
    line = next((system[operand][-1] for operand in system if operand in ("ENPD", "FNUM", "OBNA")), None)
    if line is None:
        raise LensError(path, "aperture", "missing", "expected ENPD, FNUM, OBNA or FLOA")
    operand = line.words[0]
    kind = APERTURES.get((operand, 0 if operand == "ENPD" else line.figure(2, 0.0)))
    if kind is None:
        raise line.refusal("expected ENPD, FNUM, OBNA with 0 or FLOA")
    return kind, in_mm(kind, line.figure(1), unit_mm)


def _kind_of_field(system):
    return system["FTYP"][-1].figure(1, 0.0) if "FTYP" in system else 0.0


def _columns(system, *operands):
    """Numbers of the last line with one of these operands: one per field, limited to FTYP's number of fields."""
    lines = [line for operand in operands for line in system.get(operand, ())]
    count = system["FTYP"][-1].figure(3, np.inf) if "FTYP" in system else np.inf
    return [value for at, value in enumerate(lines[-1].figures() if lines else ()) if at < count]


def _field(path, system, unit_mm):
    x, y = _columns(system, "XFLD", "XFLN"), _columns(system, "YFLD", "YFLN")
    return field_end(path, FIELDS.get(_kind_of_field(system)), x, y, unit_mm)


def _reference_nm(path, system):
    """The primary wavelength, from numbered lines, or in old files from a list."""
    slots = {line.figure(1): line.figure(2) for line in system.get("WAVM", ())}
    for operand in ("WAVL", "WAVN"):
        if operand in system:
            slots |= dict(enumerate(system[operand][-1].figures(), 1))
    primary = system["PWAV"][-1].figure(1) if "PWAV" in system else 1
    if primary not in slots:
        raise LensError(path, "PWAV", f"{primary:g}", "expected the number of one of the file's wavelengths, WAVM")
    return 1e3 * slots[primary]


def _semi_diameter_note(options, sizes):
    if not sizes:
        return ""
    fixed = f"fixed semi-diameters, without CLAP or FLAP, of {len(sizes)} surface{'s' * (len(sizes) > 1)}"
    if options.semi_diameters == "ignore":
        return f"The {fixed} are ignored."
    return f"The {fixed} are used as clear apertures (to ignore them: --semi-diameters ignore)."


def _air_note(system):
    if "ENVD" not in system or system["ENVD"][-1].figures()[:2] in ([], list(USUAL_AIR[:1]), list(USUAL_AIR)):
        return ""
    figures = " ".join(system["ENVD"][-1].words[1:3])
    return f"The file's temperature and pressure, {figures}, are not used: indices are for 20 degrees and 1 atm."


def _notes(system, surfaces, options, sizes):
    """Notes on values of the file that are used differently, and on choices between several."""
    field = options.field
    factors = [value for operand in ("VDXN", "VDYN", "VCXN", "VCYN", "VANN") for value in _columns(system, operand)]
    real = field is None and _kind_of_field(system) == REAL_IMAGE_HEIGHT
    configurations = system["MNUM"][-1].figure(1, 1.0) if "MNUM" in system else 1.0
    current = system["MNUM"][-1].figure(2, 1.0) if configurations > 1 else 1.0
    return " ".join(filter(None, (
        _semi_diameter_note(options, sizes), _air_note(system), vignetting_note(factors, surfaces),
        real and "The file's real image height is used as a paraxial one.",
        configurations > 1 and f"Configuration {current:g} of {configurations:g} is used, the active one when the "
                               "file was saved.")))
