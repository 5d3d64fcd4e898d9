"""Ghostlight's .lens: JSON with elements, which are rigid groups of surfaces, and a table of their glasses."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ...runtime.errors import LensError
from ...runtime.unread import json_names, unread_names
from ...spectral.refraction import Formula
from ..coatings import of_layers
from ..glasses import Glass
from ..prescription import Prescription, Surface
from .frames import START, Frame, posed
from .reading import Reading, ReadingOptions, with_stop

FORMAT = "ghostlight-optical"
SPHERE, ASPHERE, CYLINDER = "sphere", "asphere", "cylindrical"
CURVED = {"x": ("radius_mm", "radius_x_mm"), "y": ("radius_x_mm", "radius_mm")}  # sections of a cylinder by its axis
AIR, ABBE, SELLMEIER, EVERYWHERE_NM = ("air", "AIR", ""), "abbe", "sellmeier", (0.0, np.inf)
RELATIVE = "relative_to_preceding"
TURNS = (("y", "tilt_y"), ("x", "tilt_x"), ("z", "roll"))  # about the element's own axes, in this order
COATING, SIMPLE, ATTENUATOR = "coating", "simple", "attenuator_gaussian"
KNOWN_NAMES = ("format", "pivots", "optical_system", "transform", "position", "mode", "x", "y", "z", "rotation",
               "tilt_x", "tilt_y", "roll", "pivot", "surfaces", "semi_aperture", "is_stop", "is_active", "thickness",
               "form", "type", "radius", "conic_constant", "terms", "axis", "materials", "glass")
HARMLESS_NAMES = ("version", "metadata", "glass_catalogue", "modifiers", "id", "name", "elements", "pivot_point",
                  "offset", "exposed")


def is_ghostlight(text: str) -> bool:
    """Whether a .lens is Ghostlight's: the others are not JSON."""
    return text.lstrip().startswith("{")


def read_ghostlight(path: Path, text: str, options: ReadingOptions) -> Reading:
    """Read a file. The image plane is at the best focus: the authors estimated distances that patents do not state."""
    contents = json.loads(text)
    if contents.get("format") != FORMAT:
        raise LensError(path, "format", str(contents.get("format", "missing")), f"expected {FORMAT}")
    if options.field is None:
        raise LensError(path, "field", "missing",
                        "a .lens does not state the end of the field: give --field-angle or --field-height")
    _check_pivots(path, contents)
    glasses = {name: _glass(path, name, entry) for name, entry in contents["glass_catalogue"].items()}
    on_axis, frames = _flattened(path, contents["optical_system"], glasses)
    surfaces = with_stop(path, posed(on_axis, frames)[0], options)
    stop = next((surface for surface in surfaces if surface.stop), None)
    if stop is None:
        raise LensError(path, "stop", "missing", "expected a surface with is_stop, or --stop")
    facts, used = contents.get("metadata", {}), {surface.glass for surface in surfaces}
    focal_mm = float(facts["focal_length_mm"]) if facts.get("focal_length_mm") else None
    f_number = float(facts["nominal_f_number"]) if facts.get("nominal_f_number") else None
    return Reading(Prescription(
        name=" ".join(str(facts.get("name") or path.stem).split()), surfaces=surfaces, field=options.field,
        aperture=("f_number", f_number) if f_number else ("stop", stop.semi_aperture_mm),
        focus=options.image_plane or "best", focal_length_mm=focal_mm,
        glasses=tuple(glass for glass in glasses.values() if isinstance(glass, Glass) and glass.name in used),
        source=" ".join(f"{facts.get('source') or ''} ({path.name}, Ghostlight)".split())),
        f_number, unread_names((*json_names(contents, HARMLESS_NAMES), *_effects(contents)), KNOWN_NAMES))


def _check_pivots(path, contents):
    """Raise a LensError if a pivot, which moves elements, has an offset."""
    for pivot in contents.get("pivots") or ():
        if any(value for part in pivot.get("offset", {}).values() for value in part.values()):
            raise LensError(path, f"pivot {pivot.get('name', '')}", "with an offset",
                            "expected an offset of 0: store the moved elements")


def _glass(path, name, entry):
    """"n/V", or a private glass, from an entry of the table of glasses."""
    formula = entry["dispersion"]
    if formula["model"] == ABBE:
        return f"{formula['nd']:.9g}/{formula['Vd']:.9g}"
    if formula["model"] != SELLMEIER:
        raise LensError(path, f"glass {name}", str(formula["model"]), f"expected {ABBE} or {SELLMEIER}")
    pairs = zip(map(float, formula["B"]), map(float, formula["C"]), strict=True)
    return Glass(" ".join(name.split()), Formula(2, (0.0, *(value for pair in pairs for value in pair)), EVERYWHERE_NM))


def _flattened(path, elements, glasses) -> tuple[list[Surface], list[Frame]]:
    """The surfaces of all elements, and their frames; the last frame belongs to the image plane."""
    surfaces, frames, place_mm, behind_mm = [], [], 0.0, 0.0
    for element in elements:
        transform = element.get("transform", {})
        position = transform.get("position", {})
        place_mm = position.get("z", 0.0) + (place_mm if position.get("mode") == RELATIVE and surfaces else 0.0)
        frame, behind_mm = _frame(transform, place_mm), 0.0
        media = [material["glass"] for material in element["materials"]] + [""]
        for row, medium in zip(element["surfaces"], media, strict=True):
            number = len(surfaces) + 1
            surfaces.append(_surface(path, number, row, _medium(path, number, medium, glasses)))
            frames.append(frame.moved(0.0, 0.0, behind_mm))
            behind_mm += row.get("thickness", 0.0)
    return surfaces, [*frames, START.moved(0.0, 0.0, place_mm + behind_mm)]


def _frame(transform, place_mm):
    """The frame of an element's first surface: turned about the pivot."""
    position, pivot = transform.get("position", {}), transform.get("pivot", {})
    turns = transform.get("rotation", {})
    x, y, z = (pivot.get(axis, 0.0) for axis in "xyz")
    frame = START.moved(position.get("x", 0.0), position.get("y", 0.0), place_mm).moved(x, y, z)
    return frame.turned(*((axis, turns.get(name, 0.0)) for axis, name in TURNS)).moved(-x, -y, -z)


def _medium(path, number, name, glasses):
    if name in AIR:
        return ""
    if name not in glasses:
        raise LensError(path, f"surface {number}, glass", name, "expected a glass of the file's glass_catalogue")
    return glasses[name] if isinstance(glasses[name], str) else glasses[name].name


def _surface(path, number, row, glass):
    if not row.get("is_active", True):
        raise LensError(path, f"surface {number}", "not active", "expected surfaces that are traced")
    if any(modifier.get("model") == ATTENUATOR for modifier in row.get("modifiers", ())):
        raise LensError(path, f"surface {number}", ATTENUATOR, "expected surfaces without filters")
    return Surface(thickness_mm=float(row.get("thickness", 0.0)), glass=glass, stop=bool(row.get("is_stop", False)),
                   semi_aperture_mm=float(row["semi_aperture"]), coating=_coating(row),
                   **_form(path, number, row["form"]))


def _form(path, number, form) -> dict[str, Any]:
    """Fields of a surface from its form; a cylinder is named after the axis along which it is straight."""
    radius_mm = float(form.get("radius", 0.0)) or np.inf
    if form["type"] == SPHERE:
        return {"radius_mm": radius_mm}
    if form["type"] == ASPHERE:
        terms = tuple(map(float, form.get("terms", ())))  # from r^4
        return {"radius_mm": radius_mm, "conic": float(form.get("conic_constant", 0.0)),
                "aspheric": (0.0, *terms) if any(terms) else ()}
    if form["type"] == CYLINDER and form.get("axis") in CURVED:
        curved, plane = CURVED[form["axis"]]
        return {curved: radius_mm, plane: np.inf}
    raise LensError(path, f"surface {number}", " ".join(map(str, (form["type"], form.get("axis", "")))).strip(),
                    f"expected {SPHERE}, {ASPHERE}, or {CYLINDER} along {' or '.join(CURVED)}")


def _coating(row):
    """The coating of a surface, by the number of its layers; "" without one, or with one of another model."""
    for modifier in row.get("modifiers", ()):
        if modifier["type"] == COATING and modifier.get("model") == SIMPLE:
            return of_layers(int(modifier["ar_layers"]))
    return ""


def _effects(contents):
    """Names of modifiers that are not used: shapes of apertures, and coatings of other models."""
    return (f"{modifier.get('shape') or modifier.get('model')} {modifier['type']}"
            for element in contents["optical_system"] for row in element["surfaces"]
            for modifier in row.get("modifiers", ()) if (modifier["type"], modifier.get("model")) != (COATING, SIMPLE))
