"""Lensfield's own prescription: TOML with the fields of `Prescription` and a [[surfaces]] table each."""

import tomllib
from dataclasses import replace

import numpy as np

from ...errors import LensError
from ...lens.readers.text import read_text
from ..prescription import APERTURES, FIELDS, Prescription, Surface

FORMAT, VERSION = "lensfield-prescription", 1
TEXTS = ("name", "maker", "story", "source", "notes", "focus")
NUMBERS = ("object_distance_mm", "reference_wavelength_nm")
SURFACE_NUMBERS = ("radius_mm", "thickness_mm", "semi_aperture_mm", "conic")
SURFACE_KEYS = (*SURFACE_NUMBERS, "glass", "aspheric", "stop")


def read_toml(path, field=None):
    """Read a prescription of our own."""
    try:
        contents = tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise LensError(path, "TOML", "not readable", str(error)) from None
    if (contents.get("format"), contents.get("version")) != (FORMAT, VERSION):
        raise LensError(path, "format", f"{contents.get('format')} {contents.get('version')}",
                        f'expected format = "{FORMAT}" and version = {VERSION}')
    scale = _number(path, "scale", contents.get("scale", 1.0))
    if not 0 < scale < np.inf:
        raise LensError(path, "scale", scale, "expected a positive number")
    _check_keys(path, contents, ("format", "version", "scale", "aperture", "field", "sensor_mm", "surfaces",
                                 *TEXTS, *NUMBERS), "")
    facts = {key: _text(path, key, contents[key]) for key in TEXTS if key in contents}
    facts |= {key: _number(path, key, contents[key]) for key in NUMBERS if key in contents}
    rows = contents.get("surfaces")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise LensError(path, "surfaces", type(rows).__name__, "expected a list of [[surfaces]]")
    surfaces = tuple(_surface(path, f"surface {number}", row) for number, row in enumerate(rows, 1))
    prescription = Prescription(
        **{"name": path.stem} | facts, surfaces=surfaces,
        aperture=_choice(path, "aperture", contents.get("aperture"), APERTURES),
        field=field or _choice(path, "field", contents.get("field"), FIELDS),
        sensor_mm=_sensor(path, contents.get("sensor_mm")))
    prescription = prescription if scale == 1 else prescription.scaled(scale)
    return replace(prescription, field=field) if field else prescription  # a field that is asked for is not scaled


def _surface(path, name, row):
    _check_keys(path, row, SURFACE_KEYS, f"{name}, ")
    facts = {key: _number(path, f"{name}, {key}", row[key]) for key in SURFACE_NUMBERS if key in row}
    stop = row.get("stop", False)
    if not isinstance(stop, bool):
        raise LensError(path, f"{name}, stop", stop, "expected true or false")
    return Surface(**facts, glass=_text(path, f"{name}, glass", row.get("glass", "")), stop=stop,
                   aspheric=_aspheric(path, f"{name}, aspheric", row.get("aspheric", {})))


def _aspheric(path, name, terms):
    """Coefficients of r^2, r^4 ... from a table of powers."""
    if not isinstance(terms, dict) or not all(key.isdecimal() and int(key) % 2 == 0 and 0 < int(key) <= 40
                                              for key in terms):
        raise LensError(path, name, terms, "expected a table of even powers, such as {4 = 1e-3, 6 = -2e-5}")
    coefficients = {int(key) // 2: _number(path, f"{name}, {key}", value) for key, value in terms.items()}
    return tuple(coefficients.get(index, 0.0) for index in range(1, max(coefficients, default=0) + 1))


def _choice(path, name, table, kinds):
    """The one figure of a table such as {f_number = 2.0}."""
    if not isinstance(table, dict) or len(table) != 1 or next(iter(table)) not in kinds:
        raise LensError(path, name, "missing" if table is None else str(table),
                        f"expected a table with one of {', '.join(kinds)}")
    kind, value = next(iter(table.items()))
    return kind, _number(path, f"{name}, {kind}", value)


def _sensor(path, sides):
    if sides is None:
        return None
    if not isinstance(sides, list) or len(sides) != 2:
        raise LensError(path, "sensor_mm", str(sides), "expected [width, height]")
    return tuple(_number(path, "sensor_mm", side) for side in sides)


def _check_keys(path, table, known, where):
    unknown = [key for key in table if key not in known]
    if unknown:
        raise LensError(path, f"{where}{unknown[0]}", "unknown", f"expected {', '.join(known)}")


def _number(path, name, value):
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value:
        raise LensError(path, name, value, "expected a number")
    return float(value)


def _text(path, name, value):
    if not isinstance(value, str):
        raise LensError(path, name, value, "expected a text")
    return " ".join(value.split())
