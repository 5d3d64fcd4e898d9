"""Reader and writer of cameras: TOML with the fields of `Camera`, and a table of quantum efficiencies."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..runtime.build_identity import MARK
from ..runtime.errors import CameraError, InputError
from ..runtime.inputs import reading
from ..runtime.toml_fields import TomlTable, check_known, pairs, read_toml
from ..spectral.spectra import parse_wavelengths
from .camera import NUMBERS, ORIGINS, PARTS, Camera

FORMAT, VERSION = "lensfield-camera", 1
TEXTS = "name", "title", "maker", "source", "notes"
WRITTEN = (*TEXTS, "provenance", "shape_px", "filters", "bits", *NUMBERS)
FIELDS_OF_FILE = ("format", "version", *WRITTEN, "wavelengths_nm", "quantum_efficiency")
DEFAULTS = {each.name: each.default for each in fields(Camera)}


def read_camera(path: Path) -> Camera:
    """Read a camera from a file.

    Raises
    ------
    CameraError
        The file is missing or damaged, or a value in it is invalid.
    """
    with reading(path):
        return _camera(path)


def _camera(path):
    table = read_toml(path, FORMAT, VERSION, error=CameraError)
    check_known(table, FIELDS_OF_FILE)
    efficiency = table.number_rows("quantum_efficiency", "channel")
    texts: dict[str, Any] = {"name": path.stem} | {name: table.line(name) for name in TEXTS if name in table}
    numbers: dict[str, Any] = {name: table.number(name) for name in NUMBERS if name in table or name not in _optional()}
    try:
        return Camera(**texts, **numbers, shape_px=tuple(map(_whole, table.numbers("shape_px", 2))),
                      filters=_filters(table), channels="".join(efficiency), wavelengths_nm=_wavelengths_nm(table),
                      quantum_efficiency=np.array(list(efficiency.values())), bits=_whole(table.number("bits")),
                      provenance=_provenance(table))
    except CameraError as error:
        raise error.at(path) from None


def _whole(number):
    """The number as an int if it is whole; Camera refuses others."""
    return int(number) if number.is_integer() else number


def _optional():
    return {name for name, default in DEFAULTS.items() if isinstance(default, float)}


def _filters(table):
    rows = table.values.get("filters", [])
    if not isinstance(rows, list) or not all(isinstance(row, str) and row for row in rows):
        raise table.refusal("filters", 'expected rows of the filter array, such as ["RG", "GB"]')
    return tuple(rows)


def _wavelengths_nm(table):
    given = table.values.get("wavelengths_nm")
    if not isinstance(given, str):
        return table.numbers("wavelengths_nm")
    try:
        return parse_wavelengths(given)
    except InputError as error:
        raise table.refusal("wavelengths_nm", error.remedy) from None


def _provenance(table):
    origins = table.values.get("provenance", {})
    if not isinstance(origins, dict):
        raise table.refusal("provenance", 'expected a table such as { sensitivity = "measured", noise = "generic" }')
    origins = TomlTable(table.path, origins, "provenance, ", table.error)
    check_known(origins, PARTS)
    return tuple((part, origins.choice(part, ORIGINS)) for part in PARTS if part in origins)


def camera_text(camera: Camera) -> str:
    """The text of a file; reading it returns an equal camera."""
    values = {name: getattr(camera, name) for name in WRITTEN}
    values["provenance"] = dict(camera.provenance) or ()
    efficiency = {name: tuple(row.tolist())
                  for name, row in zip(camera.channels, camera.quantum_efficiency, strict=True)}
    return "\n".join([f"# {MARK}", f'format = "{FORMAT}"', f"version = {VERSION}",
                      *pairs(values, DEFAULTS | {"filters": ()}),
                      *pairs({"wavelengths_nm": tuple(camera.wavelengths_nm.tolist())}, {}),
                      "", "[quantum_efficiency]", *pairs(efficiency, {}), ""])
