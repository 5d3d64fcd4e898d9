"""DeepLens' JSON: a list of surfaces with the material behind each, and the sensor."""

from pathlib import Path

import numpy as np

from ...errors import LensError
from ..glasses import best_name
from ..prescription import Prescription, Surface

SHAPES, STOPS = ("Spheric", "Aspheric", "Plane"), ("Aperture", "Stop")
AIR = ("air", "vacuum", "occluder", "none")
PLASTICS = {"coc": "1.5337/56.22", "pmma": "1.4918/57.44", "polycarb": "1.5855/29.91", "pc": "1.5855/29.91",
            "polystyr": "1.5904/30.87", "ps": "1.5904/30.87", "okp4": "1.6328/23.34", "okp4ht": "1.6328/23.34"}
"""Index and Abbe number of the plastics that DeepLens has by name."""


def read_deeplens(path: Path, contents: dict, field: tuple[str, float] | None) -> Prescription:
    """The lens that DeepLens wrote; its stop is as wide as the file says, whatever `fnum` comes to."""
    rows = contents["surfaces"]
    surfaces = tuple(_surface(path, number, row, _thickness(path, number, row, rows[number:], contents))
                     for number, row in enumerate(rows, 1))
    stop = next((surface for surface in surfaces if surface.stop), None)
    if stop is None:
        raise LensError(path, "stop", "missing", f"expected a surface of type {' or '.join(STOPS)}")
    size = contents.get("sensor_size") or contents.get("(sensor_size)")
    return Prescription(name=path.stem, surfaces=surfaces, aperture=("stop", stop.semi_aperture_mm),
                        field=field or ("image_height_mm", float(contents["r_sensor"])),
                        sensor_mm=(float(size[0]), float(size[1])) if size else None,
                        source=" ".join(f"{path.name} (DeepLens) {contents.get('info', '')}".split()))


def _thickness(path, number, row, behind, contents):
    """To the next surface or the sensor: told, or by their places; names in parentheses are for people to read."""
    if "d_next" in row:
        return float(row["d_next"])
    place, following = _told(row, "d"), _told(behind[0], "d") if behind else _told(contents, "d_sensor")
    if place is None or following is None:
        raise LensError(path, f"surface {number}, d_next", "missing", "expected the distance to the next surface")
    return following - place


def _told(row, name):
    value = row.get(name, row.get(f"({name})"))
    return None if value is None else float(value)


def _surface(path, number, row, thickness_mm):
    kind = row["type"]
    if kind not in (*SHAPES, *STOPS):
        raise LensError(path, f"surface {number}", str(kind), f"expected one of {', '.join((*SHAPES, *STOPS))}")
    curved = kind in ("Spheric", "Aspheric")
    curvature = _told(row, "c") if curved else 0.0
    radius_mm = float(row["roc"]) if curved and "roc" in row else 1 / curvature if curvature else np.inf
    radius_mm = radius_mm or np.inf  # a plane has 0
    aspheric = [float(term) for term in row.get("ai") or ()] if kind == "Aspheric" else []
    return Surface(radius_mm, thickness_mm, _glass(str(row.get("mat2", "air"))), float(row["r"]),
                   float(row.get("k", 0.0)) if kind == "Aspheric" else 0.0, tuple(aspheric), kind in STOPS)


def _glass(material):
    name = material.lower()
    if name in AIR:
        return ""
    return PLASTICS.get(name) or (material if "/" in material else best_name(material.upper(), []))
