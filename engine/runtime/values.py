"""Values that compare by their contents, including arrays."""

import hashlib
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property, partial
from numbers import Real
from typing import Any, get_type_hints

import numpy as np


@dataclass(frozen=True, eq=False, repr=False)
class Value:
    """Base of frozen dataclasses that hold arrays: they compare, hash, print and pickle by their contents.

    A standard dataclass compares arrays element by element, which is not a single truth value, and prints them in full.
    Subclasses must therefore also be `@dataclass(frozen=True, eq=False, repr=False)`. Arrays are not copied, but are
    read-only through the value: its creator must not change them afterwards.
    """

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                view = value.view()
                view.setflags(write=False)
                object.__setattr__(self, field.name, view)

    @cached_property
    def digest(self) -> bytes:
        """SHA-256 of the contents, computed on first use."""
        return digest_of(self)

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return self is other or self.digest == other.digest

    def __hash__(self) -> int:
        return hash(self.digest)

    def __repr__(self) -> str:
        shown = (f"{field.name}={_shown(getattr(self, field.name))}" for field in fields(self) if field.repr)
        return f"{type(self).__name__}({', '.join(shown)})"

    def __reduce__(self) -> tuple:
        # Recreated from its fields: unpickled arrays would be writable, and cached properties need not be stored.
        return partial(type(self), **{field.name: getattr(self, field.name) for field in fields(self)}), ()


def check_types(value: Any) -> None:
    """Raise a TypeError unless the fields of a dataclass have their declared types; an int also serves as a float."""
    kinds = get_type_hints(type(value))
    for field in fields(value):
        content, kind = getattr(value, field.name), kinds[field.name]
        if not isinstance(content, kind) and not (type(content) is int and isinstance(float(content), kind)):
            raise TypeError(f"{field.name} is a {type(content).__name__}")


def digest_of(value: Any) -> bytes:
    """SHA-256 of a value's contents: numbers, strings, None, arrays, and tuples and dataclasses of these.

    Equal numbers have equal digests, whatever their type, and so do equal dataclasses. Arrays do if dtype, shape and
    every bit agree.

    Raises
    ------
    TypeError
        The value contains any other type.
    """
    content: Any
    if isinstance(value, np.ndarray):
        kind, content = f"array {value.dtype.str} {value.shape}", np.ascontiguousarray(value)
    elif isinstance(value, tuple):
        kind, content = "tuple", b"".join(map(digest_of, value))
    elif is_dataclass(value):
        kind = type(value).__qualname__
        content = b"".join(digest_of(getattr(value, field.name)) for field in fields(value) if field.compare)
    elif isinstance(value, Real):
        kind, content = "number", (float(value) + 0.0).hex().encode()
    elif isinstance(value, str) or value is None:
        kind, content = "text", repr(value).encode()
    else:
        raise TypeError(f"a {type(value).__name__} has no digest")
    digest = hashlib.sha256(f"{kind}\n".encode())
    digest.update(content)
    return digest.digest()


def json_value(value: Any) -> Any:
    """A value converted to JSON types: lists for tuples and arrays, None for numbers that are not finite."""
    if isinstance(value, dict):
        return {name: json_value(each) for name, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [json_value(each) for each in value]
    if isinstance(value, np.generic):
        return json_value(value.item())
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _shown(value: object) -> str:
    """A field's repr; for an array its dtype and shape."""
    return f"{value.dtype}{list(value.shape)}" if isinstance(value, np.ndarray) else repr(value)
