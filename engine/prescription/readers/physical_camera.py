"""Lens files of physical-camera, a Blender extension: TOML with a table of the lens and one for each surface."""

from pathlib import Path
from typing import Any

import numpy as np

from ...runtime.errors import LensError
from ...runtime.toml_fields import TomlTable
from ...runtime.unread import json_names, unread_names
from ..coatings import MULTI, NONE, SINGLE
from ..prescription import Prescription, Surface
from .reading import Reading, ReadingOptions, with_stop

LENS, SURFACES = "lens", "surface"
KINDS = ("spherical", "flat", "stop", "aspheric", "cylindrical_x", "cylindrical_y")
STOP, PLANES, ASPHERE = "stop", ("flat", "stop"), "aspheric"
CYLINDERS = {"cylindrical_x": ("radius_x_mm", "radius_mm"), "cylindrical_y": ("radius_mm", "radius_x_mm")}
"""The curved section, and the plane one."""
OF_ASPHERE = ("conic", "aspheric_coeffs")
KNOWN_NAMES = (LENS, SURFACES, "name", "patent", "focal_length", "max_fstop", "coating", "type", "radius", "thickness",
               "ior", "abbe_v", "aperture", "conic", "aspheric_coeffs", "focus", "close_distance", "variable",
               "thickness_close")
COATINGS = (NONE, SINGLE, MULTI)
HARMLESS_NAMES = ("squeeze",)  # the surfaces determine the squeeze


def is_physical_camera(table: TomlTable) -> bool:
    """Whether a TOML file is physical-camera's."""
    return {LENS, SURFACES} <= table.values.keys()


def read_physical_camera(path: Path, table: TomlTable, options: ReadingOptions) -> Reading:
    """Read the fields of a file. The image plane, which it does not state, is at the best focus."""
    if options.field is None:
        raise LensError(path, "field", "missing",
                        "physical-camera does not state the end of the field: give --field-angle or --field-height")
    lens, rows = _table(table, LENS), _tables(table, SURFACES)
    close_mm, closes_mm = _close_focus(table, len(rows))
    surfaces = with_stop(path, [_surface(row, closes_mm.get(number)) for number, row in enumerate(rows)], options)
    f_number = lens.number("max_fstop")
    return Reading(Prescription(
        name=lens.line("name") or path.stem, surfaces=surfaces, field=options.field,
        aperture=("f_number", f_number), focus=options.image_plane or "best",
        coating=lens.choice("coating", COATINGS) if "coating" in lens else "",
        focal_length_mm=lens.number("focal_length"), focused_at_mm=(np.inf, close_mm) if closes_mm else (),
        source=" ".join(f"{lens.line('patent')} ({path.name}, physical-camera)".split())),
        f_number, unread_names(json_names(table.values, HARMLESS_NAMES), KNOWN_NAMES))


def _table(table, name):
    """A table in this table."""
    values = table.values.get(name)
    if not isinstance(values, dict):
        raise table.refusal(name, f"expected a table [{name}]")
    return TomlTable(table.path, values, f"{name}, ")


def _tables(table, name):
    """A list of tables in this table; places in errors are counted from 1."""
    rows = table.values.get(name)
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise table.refusal(name, "expected a list of tables")
    return [TomlTable(table.path, row, f"{table.place}{name} {number}, ") for number, row in enumerate(rows, 1)]


def _close_focus(table, count):
    """The object distance of the close focus, and the thickness of each gap that varies, by its number from 0."""
    if "focus" not in table:
        return None, {}
    focus = _table(table, "focus")
    gaps = {}
    for row in _tables(focus, "variable"):
        number = row.number("surface")
        if number not in range(count):
            raise row.refusal("surface", f"expected the number of a surface, 0 to {count - 1}")
        gaps[int(number)] = row.number("thickness_close")
    return focus.number("close_distance"), gaps


def _surface(row, close_mm):
    """A surface, with the thickness behind it at the close focus, if that differs."""
    kind, thickness_mm = row.choice("type", KINDS) if "type" in row else KINDS[0], row.number("thickness")
    return Surface(thickness_mm=thickness_mm, glass=_glass(row), semi_aperture_mm=row.number("aperture") / 2,
                   stop=kind == STOP, gaps_mm=() if close_mm is None else (thickness_mm, close_mm),
                   **_form(row, kind))


def _form(row, kind) -> dict[str, Any]:
    """Fields of a surface of this kind."""
    radius_mm = np.inf if kind in PLANES else row.number("radius") or np.inf
    if kind == ASPHERE:  # its coefficients begin with the one of r^4
        return {"radius_mm": radius_mm, "conic": row.number("conic", 0.0),
                "aspheric": (0.0, *row.numbers("aspheric_coeffs"))}
    for name in OF_ASPHERE:
        if name in row:
            raise row.refusal(name, f"expected it only for type {ASPHERE}")
    if kind in CYLINDERS:
        curved, plane = CYLINDERS[kind]
        return {curved: radius_mm, plane: np.inf}
    return {"radius_mm": radius_mm}


def _glass(row):
    index, abbe = row.number("ior"), row.number("abbe_v", 0.0)
    return "" if index <= 1 else f"{index:.9g}/{abbe:.9g}" if abbe else f"{index:.9g}"
