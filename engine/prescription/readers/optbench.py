"""PhotonsToPhotos Optical Bench text: sections of tab-separated lines, with a column per zoom and focus position.

Rows of `[lens data]` have surface, radius (or AS for the stop, FS for another diaphragm, CG for a cover glass's plane),
thickness, index, diameter, Abbe number and glass; a thickness may be the name of a variable distance. Rows of
`[aspherical data]` have surface, radius, conic constant and the coefficients of r^4, r^6 ..., or from r^2 on with the
constant AsphericalA2.
"""

import re
from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ...runtime.unread import unread_names
from ..prescription import Prescription, Surface
from .lines import numbered
from .reading import Reading, ReadingOptions, with_stop

PLANES = ("AS", "FS", "CG", "Infinity", "-Infinity", "")
COLUMNS = 6  # followed by glass names, which are less precise than the figures
KNOWN_SECTIONS = ("descriptive data", "constants", "variable distances", "lens data", "aspherical data")
HARMLESS_SECTIONS = ("figure", "!figure", "notes", "metadata")
KNOWN_VARIABLES = ("Focal Length", "Angle of View", "F-Number", "Image Height", "d0", "AsphericalA2")
HARMLESS_VARIABLES = ("Scaled", "Magnification", "Total Length", "Bf", "Aperture Diameter", "S", "Distance")
"""Results of the surfaces, and the original scale. Bf and others are used if a thickness names them."""
OF_PATENT = re.compile(r"\((p|m)\)$")  # a figure from the patent, or measured, for comparison
LARGEST_ANGLE_DEG = 85.0  # limit for fisheyes: a plane image cannot cover 90 degrees
FULL_FRAME_MM = (36.0, 24.0)
SAME_DIAGONAL_MM = 0.3


def read_optbench(path: Path, text: str, options: ReadingOptions) -> Reading:
    """Read an Optical Bench text at the position with this number, by default the first one for infinity.

    Positions that only differ in focus become the lens's variable gaps, unless a position is given. The image plane is
    at the best focus, because patents round thicknesses.
    """
    sections, which, field = _sections(path, text), options.which, options.field
    for name in ("variable distances", "lens data"):
        if not sections.get(name):
            raise LensError(path, f"[{name}]", "missing", "expected a text file of PhotonsToPhotos' Optical Bench")
    variables = {line.words[0]: line for name in ("constants", "variable distances") for line in sections.get(name, ())}
    count = len(variables["d0"].words) - 1 if "d0" in variables else 1
    column = _column(path, variables, count, which)
    focusing = _focusing(variables, count, sections["lens data"]) if which is None else []
    aspheres = {line.words[0]: line for line in sections.get("aspherical data", ())}
    first_power = 2 if "AsphericalA2" in variables else 4
    surfaces = with_stop(path, [_surface(line, variables, column, focusing, aspheres.get(line.words[0]), first_power)
                                for line in sections["lens data"]], options)
    _check_stop(path, surfaces)
    titles = {line.words[0]: " ".join(line.words[1:]) for line in sections.get("descriptive data", ())}
    title = " ".join(titles.get("title", "").split()) or path.stem
    half_deg = (_variable(variables, "Angle of View", column) or 0.0) / 2
    diagonal_mm = _variable(variables, "Image Height", column)
    full_frame = diagonal_mm and abs(diagonal_mm - np.hypot(*FULL_FRAME_MM)) < SAME_DIAGONAL_MM
    return Reading(Prescription(
        name=path.stem, surfaces=surfaces, aperture=_aperture(path, variables, column, surfaces),
        focal_length_mm=_variable(variables, "Focal Length", column),
        field=field or _field(path, half_deg, diagonal_mm),
        object_distance_mm=_variable(variables, "d0", column) or np.inf,
        sensor_mm=FULL_FRAME_MM if full_frame else None, focus=options.image_plane or "best",
        source=f"{title} ({path.name}, Optical Bench)",
        focused_at_mm=tuple(_variable(variables, "d0", at) for at in focusing),
        notes=_notes(0 if focusing else count, column, field, half_deg)),
        _variable(variables, "F-Number", column), _unread(sections, variables))


def _unread(sections, variables):
    """Unused sections, variables and rows of aspheres."""
    thicknesses = {"".join(line.words[2:3]) for line in sections["lens data"]}
    surfaces = {line.words[0] for line in sections["lens data"]}
    return (*(f"[{name}]" for name in unread_names(sections, (*KNOWN_SECTIONS, *HARMLESS_SECTIONS))
              if not OF_PATENT.search(name)),
            *(name for name in unread_names(variables, (*KNOWN_VARIABLES, *HARMLESS_VARIABLES, *thicknesses))
              if not OF_PATENT.search(name)),
            *(f"aspherical data of surface {name}" for name in unread_names(
                (line.words[0] for line in sections.get("aspherical data", ())), surfaces)))


def _sections(path, text):
    """{name: lines} of the sections. Names are in brackets; a name may share its line with another."""
    sections, current = {}, None
    for line in numbered(path, map(str.rstrip, text.splitlines()), "\t"):
        words = tuple(word.strip() for word in line.words)
        if words[0].startswith("["):
            current = sections.setdefault(words[0].rsplit("[", 1)[1].rstrip("] ").lower(), [])
        elif current is not None and not words[0].startswith("#"):
            current.append(line._replace(words=words))
    return sections


def _column(path, variables, count, which):
    """Number of the position to use, from 1."""
    if which is None:
        return next((at for at in range(1, count + 1) if _variable(variables, "d0", at) in (None, np.inf)), 1)
    if not which.isdecimal() or not 1 <= int(which) <= count:
        raise LensError(path, "--which", which, f"expected the number of a position, 1 to {count}")
    return int(which)


def _focusing(variables, count, rows):
    """Columns from far to near, if they are focus positions with varying gaps; otherwise empty."""
    distances_mm = [_variable(variables, "d0", at) or 0.0 for at in range(1, count + 1)]
    if len(set(distances_mm)) < count or np.isinf(distances_mm).sum() != 1 or min(distances_mm) <= 0:
        return []
    columns = sorted(range(1, count + 1), key=lambda at: -distances_mm[at - 1])
    return columns if any(_gaps_mm(variables, "".join(line.words[2:3]), columns) for line in rows[:-1]) else []


def _gaps_mm(variables, thickness, columns):
    """A distance at each of the columns; () if it is constant."""
    gaps_mm = tuple(_variable(variables, thickness, at) for at in columns) if thickness in variables else ()
    return gaps_mm if len(set(gaps_mm)) > 1 else ()


def _variable(variables, name, column):
    """The value of a variable at this position, or its common value; None without one."""
    words = variables[name].words[1:] if name in variables else ()
    word = words[column - 1] if column <= len(words) and words[column - 1] else words[0] if words else ""
    try:
        return float(word)
    except ValueError:
        return None


def _surface(line, variables, column, focusing, asphere, first_power):
    name, radius, thickness, index, diameter, abbe = [*line.words, *[""] * COLUMNS][:COLUMNS]
    if radius in ("AS", "FS") and index and not abbe:  # some files have the diameter in the column of the index
        index, diameter = "", diameter or index
    line = line._replace(words=(name, radius, thickness, index, diameter, abbe))
    gaps_mm = _gaps_mm(variables, thickness, focusing)
    distance_mm = (_variable(variables, thickness, column) if thickness in variables
                   else line.figure(2) if thickness else 0.0)
    if distance_mm is None or None in gaps_mm:
        raise LensError(line.path, f"{line.place}, {thickness}", " ".join(variables[thickness].words[1:]),
                        "expected the distance at this position")
    conic, terms = 0.0, []
    if asphere is not None:
        conic = asphere.figure(2) if asphere.words[2:3] != ("",) else 0.0
        terms = [asphere.figure(at) if asphere.words[at] else 0.0 for at in range(3, len(asphere.words))]
    radius_mm = np.inf if radius in PLANES else line.figure(1)
    aspheric = (0.0,) * (first_power // 2 - 1) + tuple(terms) if any(terms) else ()
    return Surface(radius_mm, distance_mm, _glass(line, index, abbe), line.figure(4) / 2 if diameter else np.inf, conic,
                   aspheric, radius == "AS", gaps_mm=gaps_mm)


def _glass(line, index, abbe):
    """n/V, as in the patent."""
    if not index or line.figure(3) == 1:
        return ""
    return f"{line.figure(3):.9g}/{line.figure(5):.9g}" if abbe else f"{line.figure(3):.9g}"


def _check_stop(path, surfaces):
    stops = sum(surface.stop for surface in surfaces)
    if stops != 1:
        raise LensError(path, "AS", f"in {stops} rows", "expected one row to be the aperture stop, or --stop")


def _aperture(path, variables, column, surfaces):
    f_number = _variable(variables, "F-Number", column)
    if f_number is not None:
        return "f_number", f_number
    stop, = (surface for surface in surfaces if surface.stop)
    if not np.isfinite(stop.semi_aperture_mm):
        raise LensError(path, "F-Number", "missing", "expected one, or a diameter in the row AS")
    return "stop", stop.semi_aperture_mm


def _field(path, half_deg, diagonal_mm):
    if half_deg > 0:
        return "angle_deg", min(half_deg, LARGEST_ANGLE_DEG)
    if diagonal_mm:
        return "image_height_mm", diagonal_mm / 2
    raise LensError(path, "field", "missing", "give --field-angle or --field-height")


def _notes(count, column, field, half_deg):
    position = f"Number {column} of the file's {count} zoom and focus positions is used." if count > 1 else ""
    cut = field is None and half_deg > LARGEST_ANGLE_DEG
    return " ".join(filter(None, (position, cut and f"The field ends at {LARGEST_ANGLE_DEG:g} degrees.")))
