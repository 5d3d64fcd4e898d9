"""The numbers, structures and functions that kernels.h declares, for ctypes.

It reads C of the form that kernels.h is in: structures whose fields are numbers, arrays of them, pointers or earlier
structures, and functions marked LF_API.
"""

import ctypes
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_TEXT = re.sub(r"/\*.*?\*/", "", Path(__file__).with_name("kernels.h").read_text(encoding="utf-8"), flags=re.DOTALL)
_NUMBER_TYPES: dict[str, Any] = {"float": ctypes.c_float, "double": ctypes.c_double, "int": ctypes.c_int,
                                 "int32_t": ctypes.c_int32, "int64_t": ctypes.c_int64}

NUMBERS = {name: int(value) for name, value in re.findall(r"#define LF_(\w+) (\d+)", _TEXT)}
"""Numbers by name, without the prefix LF_."""

STRUCTURES: dict[str, type[ctypes.Structure]] = {}
"""Structures by name, without the prefix lf_. Their pointers are addresses."""


def _fields(body: str) -> Iterator[tuple[str, Any]]:
    """The names and types of a structure's fields."""
    for kind, names in re.findall(r"(?:const )?(\w+) ([^;]+);", body):
        for pointer, name, count in re.findall(r"(\*?)(\w+)(?:\[(\w+)\])?", names):
            field = ctypes.c_void_p if pointer else STRUCTURES.get(kind.removeprefix("lf_")) or _NUMBER_TYPES[kind]
            yield name, field * (NUMBERS.get(count.removeprefix("LF_")) or int(count)) if count else field


def _argument(words: str) -> Any:
    """The type of a function's argument."""
    kind, pointer = re.match(r"(?:const )?(\w+) ?(\*?)", words).groups()  # type: ignore[union-attr]
    structure = STRUCTURES.get(kind.removeprefix("lf_"))
    return (ctypes.POINTER(structure) if structure else ctypes.c_void_p) if pointer else _NUMBER_TYPES[kind]


for _body, _name in re.findall(r"typedef struct \{(.*?)\} lf_(\w+);", _TEXT, re.DOTALL):
    STRUCTURES[_name] = type(_name, (ctypes.Structure,), {"_fields_": list(_fields(_body))})

FUNCTIONS = {name: (ctypes.c_char_p if kind == "const char *" else _NUMBER_TYPES[kind.strip()],
                    [_argument(each.strip()) for each in arguments.split(",") if each != "void"])
             for kind, name, arguments in re.findall(r"LF_API ([a-z][\w ]+\*?)(lf_\w+)\(([^)]*)\);", _TEXT)}
"""The types of each function's result and arguments, by its name in the library."""
