"""TOML files, read field by field: errors name the field that is missing or of the wrong type."""

import json
import re
import textwrap
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .errors import InputError, LensError
from .text import read_text
from .versions import check_version

WIDTH = 105  # of a line of text as written, without the field's name
LONGEST_FILE = 2**20  # characters: a typical file has a few thousand
ENDLESS_KEY = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){16}""")
"""No legitimate key has 16 parts, and a key of thousands takes gigabytes to parse."""


@dataclass(frozen=True)
class TomlTable:
    """A table of a TOML file. Its methods raise an error for a field of the wrong type.

    Attributes
    ----------
    path : Path
    values : dict
    place : str
        Its place in the file, as a prefix for field names in errors; such as "surface 3, ".
    error : type
        Of the errors.
    """

    path: Path
    values: dict[str, Any]
    place: str = ""
    error: type[InputError] = LensError

    def __contains__(self, field: str) -> bool:
        return field in self.values

    def refusal(self, field: str, remedy: str) -> InputError:
        """The error to raise for a field."""
        return self.error(self.path, self.place + field, self.values.get(field, "missing"), remedy)

    def text(self, field: str, default: str | None = None) -> str:
        """A string. Without a default, it must not be blank."""
        value = self.values.get(field, default)
        if not isinstance(value, str) or (default is None and not value.strip()):
            raise self.refusal(field, "expected a string")
        return value

    def line(self, field: str) -> str:
        """Text with line ends and repeated spaces collapsed to a single space; empty if it is missing."""
        return " ".join(self.text(field, "").split())

    def choice(self, field: str, choices: Sequence[str]) -> str:
        """One of the given strings."""
        value = self.values.get(field)
        if not isinstance(value, str) or value not in choices:
            raise self.refusal(field, f"expected {' or '.join(choices)}")
        return value

    def number(self, field: str, default: float | None = None) -> float:
        """A number, which may be infinite."""
        value = _as_float(self.values.get(field, default))
        if value is None:
            raise self.refusal(field, "expected a number")
        return value

    def numbers(self, field: str, count: int | None = None) -> list[float]:
        """A list of numbers, of the given length if there is one."""
        values = self.values.get(field)
        if not isinstance(values, list) or not values or count not in (None, len(values)):
            raise self.refusal(field, f"expected {'a list of' if count is None else count} numbers in brackets")
        return [replace(self, values={field: value}).number(field) for value in values]

    def number_rows(self, field: str, of: str) -> dict[str, list[float]]:
        """Lists of numbers by name, all as long as the first; `of` says in errors what each belongs to."""
        rows = self.values.get(field)
        if not isinstance(rows, dict) or not rows:
            raise self.refusal(field, f"expected a list of numbers for each {of}")
        table = replace(self, values=rows, place=f"{field}, ")
        first = len(table.numbers(next(iter(rows))))
        return {name: table.numbers(name, first) for name in rows}

    def flag(self, field: str) -> bool:
        """A boolean; False if it is missing."""
        value = self.values.get(field, False)
        if not isinstance(value, bool):
            raise self.refusal(field, "expected true or false")
        return value


def _as_float(value):
    """The value as a float; None for booleans, NaN, integers too large for a float, and anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value:
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def read_toml(path: Path, kind: str, version: int, before: re.Pattern[str] | None = None,
              error: type[InputError] = LensError) -> TomlTable:
    """The fields of a TOML file that begins with this `format` and `version`; with `before`, those above its match.

    Raises
    ------
    InputError
        The file is not TOML, or has another format or version: of the type `error`.
    """
    table = read_any_toml(path, before, error)
    table.choice("format", [kind])
    check_version(path, table.values.get("version"), [version], error)
    return table


def read_any_toml(path: Path, before: re.Pattern[str] | None = None,
                  error: type[InputError] = LensError) -> TomlTable:
    """The fields of a TOML file of any format; with `before`, those above its match.

    Raises
    ------
    InputError
        The file is not TOML: of the type `error`.
    """
    text = read_text(path, error)
    text = before.split(text, maxsplit=1)[0] if before else text
    if len(text) > LONGEST_FILE:
        raise error(path, "TOML", f"{len(text)} characters", f"expected at most {LONGEST_FILE}")
    if endless := ENDLESS_KEY.search(text):
        raise error(path, "TOML", endless[0], "expected keys of at most 16 parts")
    try:
        return TomlTable(path, tomllib.loads(text), error=error)
    except (ValueError, RecursionError) as reason:
        raise error(path, "TOML", "not readable", " ".join(str(reason).split())) from None


def check_known(table: TomlTable, known: Sequence[str]) -> None:
    """Raise an error for a field that is not one of these."""
    for name in table.values:
        if name not in known:
            raise table.error(table.path, f"{table.place}{name}", "unknown", f"expected {', '.join(known)}")


def pairs(values: Mapping[str, Any], defaults: Mapping[str, Any]) -> list[str]:
    """`name = value` for each value that differs from its default."""
    return [f"{name} = {_written(value)}" for name, value in values.items() if value != defaults.get(name)]


def _written(value):
    """TOML text of a string, flag, number, array or table."""
    if isinstance(value, str):
        return _written_text(" ".join("".join(letter if letter.isprintable() else " " for letter in value).split()))
    if isinstance(value, dict):
        return f"{{ {', '.join(pairs(value, {}))} }}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(_written, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(float(value)).removesuffix(".0")


def _written_text(text):
    """Quoted text on one line, or on several if it is long."""
    quoted = json.dumps(text, ensure_ascii=False)
    if len(quoted) <= WIDTH:
        return quoted
    return f'"""{textwrap.fill(quoted[1:-1], WIDTH, break_long_words=False, break_on_hyphens=False)}"""'
