"""Code V .seq: commands for the system, and after SO, S and SI for a surface."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ...runtime.text import object_distance
from ...runtime.unread import unread_names
from ..glasses import best_name, name_in
from ..prescription import Prescription, Surface, check_surface_count
from .field_and_aperture import field_end, in_mm, vignetting_note
from .frames import START, check_return, posed
from .lines import Line
from .private_glasses import private_glasses
from .reading import Reading, ReadingOptions, with_stop

UNITS_MM = {"M": 1.0, "C": 10.0, "I": 25.4}
APERTURES = {"EPD": "entrance_pupil_diameter_mm", "FNO": "working_f_number", "NAO": "object_na",
             "NA": "working_f_number"}
FIELDS = {"AN": "angle_deg", "OB": "object_height_mm", "IM": "image_height_mm"}
REAL_IMAGE_HEIGHT = "RI"
SURFACES, MIRROR = ("SO", "S", "SI"), "REFL"
POWERS = {letter: 4 + 2 * number for number, letter in enumerate("ABCDEFGHJ")}  # of r; there is no I
SHAPES = ("CYL", "YTO", "XTO", "AAS")  # with a second section, along x
SECTION = ("CUX", "RDX")
CONICS = ("K", "KX", "KY")
ANAMORPHIC = {"AR": "AP", "BR": "BP", "CR": "CP", "DR": "DP"}  # coefficient of r^4, r^6 ..., and its p
OF_SHAPE = {"": ("K", *POWERS), "CYL": SECTION, "YTO": ("K", *POWERS, *SECTION), "XTO": ("K", *POWERS, *SECTION),
            "AAS": ("K", "KY", "KX", *SECTION, *ANAMORPHIC, *ANAMORPHIC.values())}
OF_SHAPES = tuple(dict.fromkeys(command for commands in OF_SHAPE.values() for command in commands))
DECENTRES, TILTS, PIVOTS = ("XDE", "YDE", "ZDE"), ("ADE", "BDE", "CDE"), ("XOD", "YOD", "ZOD")
RETURNING, REVERSED = "DAR", "REV"  # tilts and decentres that apply to one surface, or in reverse behind it
VIGNETTING = ("VUX", "VLX", "VUY", "VLY")
REFUSED = (dict.fromkeys(("SPS", "SPL", "UDS", "DIF", "GRT", "MFL"),
                         f"expected a conic or an asphere (ASP), {', '.join(SHAPES)}")
           | dict.fromkeys(("ELX", "ELY", "ADX", "ADY", "REG", "ELG", "CIG"),
                           "expected centred circular (CIR) or rectangular apertures (REX, REY)")
           | dict.fromkeys(("CUY", "RDY", "THI", "GLA", "RMD", "SCA"),  # which change earlier lines
                           "expected radius, thickness and glass on the line of their surface")
           | dict.fromkeys(("BEN", "RET", "GLB"), "expected tilts and decentres that return (DAR), or in pairs (REV)"))
OF_A_NUMBER = (*OF_SHAPES, *DECENTRES, *TILTS, *PIVOTS)
SPHERE = "SPH"  # without conic, asphere and second section
FLAGS = ("STO", *SHAPES, RETURNING, REVERSED, SPHERE)
CIRCLE, RECTANGLE = "CIR", ("REX", "REY")  # radius; half-widths along x and y
OF_SURFACE = (*FLAGS, *OF_A_NUMBER, CIRCLE, *RECTANGLE, *REFUSED)
RETURN = "RET"  # followed by the surface to return to, not by its own
SURFACE_WORD = re.compile(r"S(?:(\d+)(?:\.\.(\d+))?|([OI]))", re.IGNORECASE)  # S3, S1..3, SO or SI
FIELD_COMMANDS = tuple(axis + kind for axis in "XY" for kind in (*FIELDS, REAL_IMAGE_HEIGHT))
KNOWN_COMMANDS = ("RDM", "TITLE", "TIT", "DIM", "WL", "REF", "ZOO", *APERTURES, *VIGNETTING, *FIELD_COMMANDS)
HARMLESS_COMMANDS = (  # remarks, weights, drawing, optimisation flags, and solves with saved results
    "LEN", "RDM;LEN", "GO", "INI", "WTW", "WTF", "WTX", "WTY", "CLS", "SLB", "CCY", "THC", "GLC", "KC", "AC", "BC",
    "CC", "DC", "CON", "ASP", "IC", "CUF", "PIM", "CCX", "TEM", "PRE", "XDC", "YDC", "ZDC", "ADC", "BDC", "CDC",
    "DER", "CUM", "THM")  # the last two are of a mirror's back
CLEAR, OBSTRUCTION, EDGE, HOLE = "CLR", "OBS", "EDG", "HOL"  # qualifiers of CIR; the last two are drawn only
LABEL = re.compile(r"[Ll]'.*'")
OBSTRUCTED = f"CIR {OBSTRUCTION}"
QUOTED = re.compile(r"""('[^'\n]*')|"[^"\n]*"|![^\n]*""")


def read_codev(path: Path, text: str, options: ReadingOptions) -> Reading:
    """Read a .seq. CIR apertures and obstructions block light; vignetting factors are ignored."""
    system, rows, private = _commands(path, text)
    glasses = {glass.glass.name: glass for glass in private_glasses(private)}
    _check_ends(path, rows)
    unit_mm, curvatures = _unit_mm(system), _has_curvatures(path, system, rows)
    surfaces = []
    for row in rows[1:-1]:
        surfaces.append(_surface(row, curvatures, glasses, surfaces[-1].glass if surfaces else ""))
    defocus = rows[-1]["SI"].figure(2, 0.0)  # from the paraxial image plane to the actual one
    surfaces[-1] = replace(surfaces[-1], thickness_mm=surfaces[-1].thickness_mm + defocus)
    frames = list(_frames(rows, surfaces))
    surfaces, image_pose = posed(surfaces, frames)
    if not _is_displaced(rows[-1]):
        check_return(path, image_pose)
    factors = [value for command in VIGNETTING if command in system for value in system[command].figures()]
    used = [glass for name, glass in glasses.items() if name in {surface.glass for surface in surfaces}]
    return Reading(Prescription(
        name=_title(system) or path.stem, focus=options.image_plane or "as given",
        surfaces=with_stop(path, [surface.scaled(unit_mm) for surface in surfaces], options),
        aperture=_aperture(path, system, unit_mm), field=options.field or _field(path, system, unit_mm),
        object_distance_mm=object_distance((rows[0]["SO"].figure(2, 0.0) + frames[0].origin[2]) * unit_mm),
        reference_wavelength_nm=_reference_nm(path, system), source=f"{path.name} (Code V)",
        glasses=tuple(each.glass for each in used), image_pose=image_pose and image_pose.scaled(unit_mm),
        notes=" ".join(filter(None, (vignetting_note(factors, surfaces), _zoom_note(system),
                                     *(each.note for each in used))))),
        unread=unread_names([*system, *_unread_of_ends(rows)], (*KNOWN_COMMANDS, *HARMLESS_COMMANDS)))


def _commands(path, text):
    """{command: its last line} of the system; a list of the same for surfaces; and lines of private glasses.

    Surface commands belong to the surface above them, or to those that they name. PRV and END enclose private glasses.
    """
    system, rows, private, of_surfaces, inside = {}, [], [], [], False
    for words in _words(text):
        command = words[0].upper()
        if inside or command == "PRV":
            inside = command != "END"
            private += [Line(path, "PRV", tuple(words))] if inside and command != "PRV" else ()
        elif command in SURFACES:
            rows.append({command: _surface_line(path, len(rows), words)})
        elif command in OF_SURFACE and (rows or _named_surfaces(words)):
            of_surfaces.append((len(rows) - 1, words))
        elif not (command == "ZOO" and len(words) > 2):  # values that vary with zoom
            system[command] = Line(path, "command", tuple(words))
    for number, words in of_surfaces:
        _add_to_surfaces(path, rows, number, words)
    return system, rows, private


def _surface_line(path, number, words):
    line = Line(path, f"surface {number}", tuple(words))
    figures = (_is_number(word) or (words[0].upper() == "SO" and word.lower() == "inf") for word in words[1:3])
    if len(words) > 4 or not all(figures):
        raise line.refusal("expected a radius or curvature, a thickness, and a glass")
    return line


def _named_surfaces(words):
    """The words of a surface command that name surfaces; the names of glasses and shapes may also begin with S."""
    command = words[0].upper()
    return [word for word in words[1:] if command != RETURN and (
        SURFACE_WORD.fullmatch(word) if command in REFUSED else word[:1].upper() == "S")]


def _add_to_surfaces(path, rows, above, words):
    """Add a surface command to the surface above it, or to those that it names."""
    named = _named_surfaces(words)
    numbers = _surface_numbers(path, rows, words, named) if named else [above]
    for number in numbers:
        _add(rows[number], Line(path, f"surface {number}", tuple(words)), named)


def _surface_numbers(path, rows, words, named):
    match = SURFACE_WORD.fullmatch(named[0])
    first, last, end = match.groups() if match else (None, None, None)
    ends = {"O": 0, "I": len(rows) - 1}
    numbers = [ends[end.upper()]] if end else range(int(first or 0), int(last or first or 0) + 1)
    if not match or len(named) > 1 or not numbers or numbers[-1] >= len(rows):
        raise Line(path, "command", tuple(words)).refusal(
            f"expected one surface, S0 to S{len(rows) - 1}, or several such as S1..3")
    return numbers


def _add(row, line, named):
    """Add a command to a surface; an edge (EDG) does not block light."""
    command = line.words[0].upper()
    if command in REFUSED:
        raise line.refusal(REFUSED[command])
    line = line._replace(words=tuple(word for word in line.words if word not in named))
    if command in OF_A_NUMBER and len(line.words) != 2 or command in FLAGS and len(line.words) > 1:
        raise line.refusal("expected one number" if command in OF_A_NUMBER else "expected no number")
    if command == SPHERE:
        for other in (*SHAPES, *OF_SHAPES):
            row.pop(other, None)
        return
    kind = _aperture_kind(line) if command in (CIRCLE, *RECTANGLE) else ""
    if kind not in (EDGE, HOLE):
        row[OBSTRUCTED if kind == OBSTRUCTION else command] = line


def _words(text):
    """Commands as lists of words: without comments, with & lines joined, and split at ; outside titles."""
    text = "\n".join(text.splitlines())
    text = QUOTED.sub(lambda match: (match[1] or "").replace(";", ","), text)
    lines = re.sub(r"&[ \t]*\n", " ", text).split("\n")
    return [words for line in lines for words in map(str.split, line.split(";")) if words]


def _is_number(word):
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False


def _aperture_kind(line):
    """The kind of a CIR, REX or REY: a clear aperture, an obstruction in it (CIR only), or the edge or hole of the
    glass."""
    command, kinds = line.words[0].upper(), [word.upper() for word in line.words[1:-1] if not LABEL.fullmatch(word)]
    kind = kinds[0] if kinds else CLEAR
    known = (CLEAR, EDGE, HOLE, OBSTRUCTION) if command == CIRCLE else (CLEAR, EDGE, HOLE)
    if len(kinds) > 1 or kind not in known or len(line.words) < 2 or not _is_number(line.words[-1]):
        raise line.refusal("expected CIR and the radius of a clear aperture, or CIR OBS and the one of an obstruction"
                           if command == CIRCLE else f"expected {command} and the half-width of a clear aperture")
    return kind


def _check_ends(path, rows):
    """Check that object and image exist, and are planes in air."""
    check_surface_count(path, len(rows) - 2)  # without object and image
    kinds = [next(iter(row)) for row in rows]
    if kinds != ["SO", *["S"] * (len(rows) - 2), "SI"] or len(rows) < 3:
        raise LensError(path, "surfaces", f"{len(rows)}", "expected SO, S ... and SI")
    for name, row in (("SO", rows[0]), ("SI", rows[-1])):
        bends = any(_value(row, command) for command in OF_SHAPES if command not in CONICS)
        if row[name].figure(1, 0.0) or bends or _glass(row[name], ()):
            raise LensError(path, name, "not a plane in air", "expected a flat object and a flat image")
    if _is_displaced(rows[0]):
        raise LensError(path, "SO", "tilted or decentred", "expected an object plane on the axis")
    for line in (row[command] for row in rows for command in PIVOTS if command in row):
        if line.figure(1):
            raise line.refusal("expected tilts about the vertex")


def _unread_of_ends(rows):
    """Apertures and conics of object and image, as names: none of them changes a lens."""
    return [f"{command} of {name}" for name, row in (("SO", rows[0]), ("SI", rows[-1]))
            for command in (CIRCLE, *RECTANGLE, *CONICS) if command in row and row[command].figure(-1)]


def _unit_mm(system):
    if "DIM" not in system:
        return 1.0
    unit = " ".join(system["DIM"].words[1:2])
    if unit[:1].upper() not in UNITS_MM:
        raise LensError(system["DIM"].path, "DIM", unit, f"expected one of {', '.join(UNITS_MM)}")
    return UNITS_MM[unit[:1].upper()]


def _has_curvatures(path, system, rows):
    """Whether RDM selects curvatures instead of radii; without RDM, all surfaces must be planes."""
    if "RDM" in system:
        return " ".join(system["RDM"].words[1:2]).upper().startswith("N")
    if any(line.figure(1, 0.0) for row in rows for line in list(row.values())[:1]):
        raise LensError(path, "RDM", "missing", "expected RDM, for radii, or RDM N, for curvatures, first")
    return False


def _surface(row, curvatures, private, glass_before):
    line = row["S"]
    glass = _glass(line, private)
    mirror = glass.upper() == MIRROR
    shape = next((command for command in SHAPES if command in row), "")
    for command in OF_SHAPES:
        if command in row and command not in OF_SHAPE[shape] and row[command].figure(1):
            raise row[command].refusal(f"expected one of {', '.join(OF_SHAPE[shape])}"
                                       f"{f' on a surface {shape}' if shape else ', or ' + ', '.join(SHAPES)}")
    value = line.figure(1, 0.0)
    surface = Surface((1 / value if curvatures else value) if value else np.inf, line.figure(2, 0.0),
                      glass_before if mirror else glass, row[CIRCLE].figure(-1) if CIRCLE in row else np.inf,
                      _value(row, "KY") or _value(row, "K"), _terms(row, POWERS), "STO" in row, mirror=mirror,
                      semi_obstruction_mm=row[OBSTRUCTED].figure(-1) if OBSTRUCTED in row else 0.0,
                      half_widths_mm=_half_widths(row))
    return replace(surface, **_second_section(surface, shape, row)) if shape else surface


def _half_widths(row):
    stated = [row[command] for command in RECTANGLE if command in row]
    if len(stated) == 1:
        raise stated[0].refusal("expected both half-widths of a rectangular aperture, REX and REY")
    return tuple(line.figure(-1) for line in stated)


def _value(row, command):
    return row[command].figure(1) if command in row else 0.0


def _terms(row, powers):
    """Coefficients of r^2, r^4 ... up to the last one that is not 0."""
    terms = {power: _value(row, command) for command, power in powers.items()}
    last = max((power for power, term in terms.items() if term), default=0)
    return tuple(terms.get(power, 0.0) for power in range(2, last + 1, 2))


def _second_section(surface, shape, row):
    """Fields of a cylinder, toroid or anamorphic asphere; a cylinder is curved along y unless the file states x."""
    if shape != "CYL" and not any(command in row for command in SECTION):
        raise row["S"].refusal(f"expected the curvature along x, CUX, of a surface {shape}")
    curvature, radius = _value(row, SECTION[0]), _value(row, SECTION[1])
    section = {"radius_x_mm": radius or (1 / curvature if curvature else np.inf)}
    if shape == "CYL" and np.isfinite([surface.radius_mm, section["radius_x_mm"]]).all():
        raise row["S"].refusal("expected a cylinder (CYL) to be curved along x or y, not both")
    if shape == "AAS":
        aspheric = _terms(row, {command: 4 + 2 * at for at, command in enumerate(ANAMORPHIC)})
        skews = (0.0, *(_value(row, command) for command in ANAMORPHIC.values()))
        return section | {"conic_x": _value(row, "KX"), "aspheric": aspheric, "skews": skews[:len(aspheric)]}
    if shape == "XTO":
        return section | {"profile": "x", "conic_x": surface.conic, "conic": 0.0}
    return section | ({"profile": "y"} if shape == "YTO" else {})


def _is_displaced(row):
    return any(_value(row, command) for command in (*DECENTRES, *TILTS))


def _frames(rows, surfaces):
    """Frame of each surface, and of the image plane.

    Tilts and decentres are of the axis in front of a surface. They stay, unless DAR returns behind the surface; with
    REV, the axis is tilted and decentred in reverse, behind the surface. Turns about x and y are left-handed.
    """
    frame = START
    for row, surface in zip(rows[1:], [*surfaces, Surface()], strict=True):
        displaced = frame if REVERSED in row else _displaced(frame, row)
        yield displaced
        frame = frame if RETURNING in row else _reversed(frame, row) if REVERSED in row else displaced
        frame = frame.moved(0.0, 0.0, surface.thickness_mm)


def _displaced(frame, row):
    x, y, z = (_value(row, command) for command in DECENTRES)
    alpha, beta, gamma = (_value(row, command) for command in TILTS)
    return frame.moved(x, y, z).turned(("x", -alpha), ("y", -beta), ("z", gamma))


def _reversed(frame, row):
    x, y, z = (_value(row, command) for command in DECENTRES)
    alpha, beta, gamma = (_value(row, command) for command in TILTS)
    return frame.turned(("z", -gamma), ("y", beta), ("x", alpha)).moved(-x, -y, -z)


def _glass(line, private):
    """Lensfield's name of Code V's NBK7_SCHOTT, 1.5168:64.17, 517642 or 517.642; private glasses keep their names."""
    token = "".join(line.words[3:4]).strip("'\"")
    if token.upper() in private:
        return token.upper()
    if token.upper() in ("", "AIR"):
        return ""
    if ":" in token:
        return token.replace(":", "/")
    name, _, catalogue = token.partition("_")
    return name_in(catalogue, name) if catalogue else best_name(name, [])


def _title(system):
    words = next((system[command].words[1:] for command in ("TITLE", "TIT") if command in system), ())
    return " ".join(words).strip("'\"")


def _aperture(path, system, unit_mm):
    line = next((system[command] for command in system if command in APERTURES), None)
    if line is None:
        raise LensError(path, "aperture", "missing", f"expected one of {', '.join(APERTURES)}")
    kind, value = APERTURES[line.words[0].upper()], line.figure(1)
    if line.words[0].upper() == "NA":
        return kind, 0.5 / value if value else 0.0
    return kind, in_mm(kind, value, unit_mm)


def _field(path, system, unit_mm):
    """The field in the first kind that the file uses, such as XAN and YAN."""
    kind = next((command[1:] for command in system
                 if command[0] in "XY" and command[1:] in (*FIELDS, REAL_IMAGE_HEIGHT)), None)
    x, y = (system[axis + kind].figures() if kind and axis + kind in system else () for axis in "XY")
    return field_end(path, FIELDS.get(kind), x, y, unit_mm)


def _reference_nm(path, system):
    wavelengths = system["WL"].figures() if "WL" in system else []
    reference = system["REF"].figure(1) if "REF" in system else 1
    if reference not in range(1, len(wavelengths) + 1):
        raise LensError(path, "REF", f"{reference:g}", "expected the number of one of the file's wavelengths, WL")
    return wavelengths[int(reference) - 1]


def _zoom_note(system):
    if "ZOO" not in system or system["ZOO"].figure(1) <= 1:
        return ""
    return f"The first of the file's {system['ZOO'].figure(1):g} zoom positions is used."
