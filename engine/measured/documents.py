"""Texts of calibrations as nested fields, whether they are YAML, JSON or XML."""

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np

from ..runtime.errors import LensError
from ..runtime.numbers import is_number
from ..runtime.text import read_text
from ..runtime.toml_fields import TomlTable
from ..runtime.yaml_text import parse_yaml

MOST_NODES = 20_000
MOST_CHARACTERS = 2**22
OPENCV_HEAD = "%YAML:1.0"
OPENCV_ROOT = "opencv_storage"


def read_fields(path: Path) -> TomlTable:
    """The fields of a YAML or JSON file, or of OpenCV's XML.

    Raises
    ------
    LensError
        The file is missing, or neither of these.
    """
    text = _text(path)
    try:
        contents = _parsed(path.suffix.lower(), text)
    except (ValueError, RecursionError, ElementTree.ParseError) as error:
        raise LensError(path, "file", "not readable", " ".join(str(error).split())) from None
    if not isinstance(contents, dict):
        raise LensError(path, "file", "without named fields", "expected a calibration")
    return TomlTable(path, contents)


def read_xml(path: Path) -> ElementTree.Element:
    """The root of an XML file.

    Raises
    ------
    LensError
        The file is missing, or is not XML.
    """
    try:
        return _xml(_text(path))
    except (ValueError, RecursionError, ElementTree.ParseError) as error:
        raise LensError(path, "file", "not readable", " ".join(str(error).split())) from None


def matrix(table: TomlTable, field: str, shape: tuple[int, ...] = ()) -> np.ndarray:
    """A matrix with `rows`, `cols` and `data`, as OpenCV and ROS write it, or nested lists: array of this shape, or
    flat.

    Raises
    ------
    LensError
        The field is missing, has other than finite numbers, or another shape.
    """
    value = table.values.get(field)
    data = value.get("data") if isinstance(value, dict) else value
    try:
        numbers = np.array([float(number) for number in _entries(data)])
    except (TypeError, ValueError, OverflowError):
        raise table.refusal(field, "expected a matrix of numbers") from None
    if not np.isfinite(numbers).all() or (shape and numbers.size != np.prod(shape)):
        expected = " x ".join(map(str, shape)) if shape else "a row of"
        raise table.refusal(field, f"expected {expected} finite numbers")
    if isinstance(value, dict):
        rows, columns = value.get("rows"), value.get("cols")
        if is_number(rows) and is_number(columns) and numbers.size != rows * columns:
            raise table.error(table.path, table.place + field, f"of {numbers.size} numbers",
                              f"expected {rows:g} x {columns:g}")
    return numbers.reshape(shape or -1)


def _entries(data):
    """The entries of a text, of a list or of a list of rows."""
    if isinstance(data, str):
        return data.split()
    return [number for row in data for number in (row if isinstance(row, list) else [row])]


def table_at(table: TomlTable, field: str) -> TomlTable:
    """A table in a table.

    Raises
    ------
    LensError
        It is missing, or something else.
    """
    value = table.values.get(field)
    if not isinstance(value, dict):
        raise table.refusal(field, "expected named fields")
    return TomlTable(table.path, value, f"{table.place}{field}, ")


def size_in(table: TomlTable, fields: tuple[str, str]) -> tuple[int, int]:
    """Columns and rows in two fields.

    Raises
    ------
    LensError
        One is missing, or not a whole number.
    """
    for field in fields:
        number = table.number(field)
        if not 1 <= number < 1e6 or number != int(number):
            raise table.refusal(field, "expected a whole number of pixels")
    return int(table.number(fields[0])), int(table.number(fields[1]))


def _text(path):
    text = read_text(path)
    if len(text) > MOST_CHARACTERS:
        raise LensError(path, "file", f"{len(text)} characters", f"expected at most {MOST_CHARACTERS}")
    return text


def _parsed(suffix, text):
    if suffix == ".json":
        return json.loads(text)
    if suffix == ".xml":
        return _of_elements(_xml(text))
    return _typed(parse_yaml(text.removeprefix(OPENCV_HEAD).lstrip(), MOST_NODES))


def _xml(text):
    if "<!ENTITY" in text:
        raise ValueError("expected XML without entities of its own")
    return ElementTree.fromstring(text)


def _of_elements(root):
    """The fields of OpenCV's XML."""
    if root.tag != OPENCV_ROOT:
        raise ValueError(f"expected OpenCV's {OPENCV_ROOT}")
    return {child.tag: {each.tag: _scalar(each.text or "") for each in child} if len(child)
            else _scalar((child.text or "").strip()) for child in root}


def _typed(value: Any) -> Any:
    """A value with texts of numbers as numbers."""
    if isinstance(value, dict):
        return {str(name): _typed(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_typed(each) for each in value]
    return _scalar(value) if isinstance(value, str) else value


def _scalar(text):
    try:
        return float(text)
    except ValueError:
        return text
