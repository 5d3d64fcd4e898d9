"""DeepLens JSON: a list of surfaces with the material behind each, and the sensor."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...runtime.errors import LensError
from ...runtime.unread import json_names, unread_names
from ..glasses import best_name
from ..prescription import Prescription, Surface
from .reading import Reading, ReadingOptions, with_stop

KNOWN_NAMES = ("info", "foclen", "fnum", "r_sensor", "d_sensor", "sensor_size", "sensor_res", "r_last", "surfaces",
               "idx", "type", "r", "c", "roc", "d", "d_next", "k", "ai", "use_ai2", "mat1", "mat2",
               *(f"ai{power}" for power in range(2, 22, 2)))  # the terms of ai, one by one
CYLINDER = "Cylindric"  # curved along x
SHAPES, STOPS = ("Spheric", "Aspheric", "Plane", CYLINDER), ("Aperture", "Stop")
AIR = ("air", "vacuum", "occluder", "none")
PLASTICS = {"coc": "1.5337/56.22", "pmma": "1.4918/57.44", "polycarb": "1.5855/29.91", "pc": "1.5855/29.91",
            "polystyr": "1.5904/30.87", "ps": "1.5904/30.87", "okp4": "1.6328/23.34", "okp4ht": "1.6328/23.34"}
"""Index and Abbe number of the plastics that DeepLens names."""


def read_deeplens(path: Path, contents: dict, options: ReadingOptions) -> Reading:
    """Read a lens written by DeepLens; the file states the size of its stop."""
    rows = contents["surfaces"]
    if contents.get("DOE"):
        raise LensError(path, "DOE", str(contents["DOE"].get("type", "there")),
                        "expected refracting surfaces: diffractive elements cannot be traced")
    surfaces = with_stop(path, [
        _surface(path, number, row, _thickness(path, number, row, rows[number:number + 1], contents))
        for number, row in enumerate(rows, 1)], options)
    stop = next((surface for surface in surfaces if surface.stop), None)
    if stop is None:
        raise LensError(path, "stop", "missing", f"expected a surface of type {' or '.join(STOPS)}, or --stop")
    size = contents.get("sensor_size") or contents.get("(sensor_size)")
    names = (name for name in json_names(contents) if not name.startswith("("))
    return Reading(Prescription(
        name=path.stem, surfaces=surfaces, aperture=("stop", stop.semi_aperture_mm),
        field=options.field or ("image_height_mm", float(contents["r_sensor"])),
        focus=options.image_plane or "as given",
        sensor_mm=(float(size[0]), float(size[1])) if size else None, focal_length_mm=_number(contents, "foclen"),
        source=" ".join(f"{path.name} (DeepLens) {contents.get('info', '')}".split())),
        _number(contents, "fnum"), unread_names(names, KNOWN_NAMES))


def _thickness(path, number, row, behind, contents):
    """Distance to the next surface or the sensor: stated, or from their positions.

    Values in parentheses, which DeepLens writes for readability, are used if the plain ones are missing.
    """
    if "d_next" in row:
        return float(row["d_next"])
    place, following = _number(row, "d"), _number(behind[0], "d") if behind else _number(contents, "d_sensor")
    if place is None or following is None:
        raise LensError(path, f"surface {number}, d_next", "missing", "expected the distance to the next surface")
    return following - place


def _number(row, name):
    value = row.get(name, row.get(f"({name})"))
    return None if value is None else float(value)


def _surface(path, number, row, thickness_mm):
    kind = row["type"]
    if kind not in (*SHAPES, *STOPS):
        raise LensError(path, f"surface {number}", str(kind), f"expected one of {', '.join((*SHAPES, *STOPS))}")
    if row.get("diffraction"):
        raise LensError(path, f"surface {number}, diffraction", "on", "expected refracting surfaces: diffractive "
                                                                      "elements cannot be traced")
    curved = kind in ("Spheric", "Aspheric", CYLINDER)
    curvature = _number(row, "c") if curved else 0.0
    radius_mm = float(row["roc"]) if curved and "roc" in row else 1 / curvature if curvature else np.inf
    radius_mm = radius_mm or np.inf  # a plane has 0
    aspheric = _aspheric(row) if kind == "Aspheric" else []
    surface = Surface(radius_mm, thickness_mm, _glass(str(row.get("mat2", "air"))), float(row["r"]),
                      float(row.get("k", 0.0)) if kind == "Aspheric" else 0.0, tuple(aspheric), kind in STOPS)
    return replace(surface, radius_mm=np.inf, radius_x_mm=radius_mm) if kind == CYLINDER else surface


def _aspheric(row):
    """Coefficients of r^2, r^4 ...: the list `ai`, which starts at r^4 if `use_ai2` is false, or one by one."""
    terms = [float(term) for term in row.get("ai") or ()]
    if terms:
        return terms if row.get("use_ai2", True) else [0.0, *terms]
    powers = {int(name[2:]): float(value) for name, value in row.items() if re.fullmatch(r"ai\d+", name)}
    return [powers.get(power, 0.0) for power in range(2, max(powers, default=0) + 1, 2)]


def _glass(material):
    name = material.lower()
    if name in AIR:
        return ""
    return PLASTICS.get(name) or (material if "/" in material else best_name(material.upper(), []))
