"""TOML files field by field: what is missing, or of another kind than it should be, is told by its name."""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import LensError
from .text import read_text

LONGEST_FILE = 2**20  # characters: a description has some thousands
ENDLESS_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){16}""")
"""Keys of so many parts are no description's, and one of thousands takes gigabytes."""


@dataclass(frozen=True)
class TomlTable:
    """A table of a TOML file, whose methods raise a LensError for a field that is not of their kind.

    Attributes
    ----------
    path : Path
    values : dict
    place : str
        Where it stands in the file, for errors; such as "surface 3, ".
    """

    path: Path
    values: dict[str, Any]
    place: str = ""

    def __contains__(self, field: str) -> bool:
        return field in self.values

    def refusal(self, field: str, remedy: str) -> LensError:
        """What to raise about a field."""
        return LensError(self.path, self.place + field, self.values.get(field, "missing"), remedy)

    def text(self, field: str, default: str | None = None) -> str:
        """A text; where there is no default, one that is not blank."""
        value = self.values.get(field, default)
        if not isinstance(value, str) or (default is None and not value.strip()):
            raise self.refusal(field, "expected a text")
        return value

    def choice(self, field: str, choices: Sequence[str]) -> str:
        """One of these texts."""
        value = self.values.get(field)
        if not isinstance(value, str) or value not in choices:
            raise self.refusal(field, f"expected {' or '.join(choices)}")
        return value

    def number(self, field: str, default: float | None = None) -> float:
        """A number, infinity among them."""
        value = _as_float(self.values.get(field, default))
        if value is None:
            raise self.refusal(field, "expected a number")
        return value

    def numbers(self, field: str, count: int | None = None) -> list[float]:
        """A list of numbers; of so many, where that is known."""
        values = self.values.get(field)
        if not isinstance(values, list) or not values or count not in (None, len(values)):
            raise self.refusal(field, f"expected {'a list of' if count is None else count} numbers in brackets")
        return [TomlTable(self.path, {field: value}, self.place).number(field) for value in values]

    def flag(self, field: str) -> bool:
        """True or false; false where it is not there."""
        value = self.values.get(field, False)
        if not isinstance(value, bool):
            raise self.refusal(field, "expected true or false")
        return value


def _as_float(value):
    """None for what is no number: truth values, nan, and whole numbers beyond all floats."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value:
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def read_toml(path: Path, kind: str, version: int) -> TomlTable:
    """The fields of a TOML file that begins with this `format` and `version`.

    Raises
    ------
    LensError
        No TOML, or of another format or version.
    """
    text = read_text(path)
    if len(text) > LONGEST_FILE:
        raise LensError(path, "TOML", f"{len(text)} characters", f"expected at most {LONGEST_FILE}")
    if endless := ENDLESS_KEY.search(text):
        raise LensError(path, "TOML", endless[0], "expected keys of at most 16 parts")
    try:
        table = TomlTable(path, tomllib.loads(text))
    except (ValueError, RecursionError) as error:
        raise LensError(path, "TOML", "not readable", " ".join(str(error).split())) from None
    table.choice("format", [kind])
    if table.values.get("version") != version:
        raise table.refusal("version", f"expected {version}")
    return table
