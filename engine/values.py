"""Values that compare by what they hold, arrays included."""

import hashlib
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from numbers import Real
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False, repr=False)
class Value:
    """Base of frozen dataclasses that hold arrays: they compare, hash, show and pickle by what they hold.

    A dataclass by itself compares arrays element by element, which is no yes or no, and shows them in full. So the
    subclasses, too, are `@dataclass(frozen=True, eq=False, repr=False)`. Arrays are not copied, but cannot be written
    to through the value: whoever makes it leaves them alone from then on.
    """

    def __post_init__(self) -> None:
        for field in fields(self):
            held = getattr(self, field.name)
            if isinstance(held, np.ndarray):
                view = held.view()
                view.setflags(write=False)
                object.__setattr__(self, field.name, view)

    @cached_property
    def digest(self) -> bytes:
        """What tells it from every other value; made when it is first asked for."""
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
        # Made anew from its fields: arrays come out of a pickle writable, and what follows from them need not travel.
        return type(self), tuple(getattr(self, field.name) for field in fields(self))


def digest_of(value: Any) -> bytes:
    """SHA-256 of what a value holds: numbers, texts, None, arrays, and tuples and dataclasses of these.

    Equal numbers have equal digests, whatever their type; arrays do where kind, shape and every bit are the same.

    Raises
    ------
    TypeError
        It holds something else.
    """
    held: Any
    if isinstance(value, np.ndarray):
        kind, held = f"array {value.dtype.str} {value.shape}", np.ascontiguousarray(value)
    elif isinstance(value, tuple):
        kind, held = "tuple", b"".join(map(digest_of, value))
    elif is_dataclass(value):
        kind = type(value).__qualname__
        held = b"".join(digest_of(getattr(value, field.name)) for field in fields(value))
    elif isinstance(value, Real):
        kind, held = "number", (float(value) + 0.0).hex().encode()
    elif isinstance(value, str) or value is None:
        kind, held = "text", repr(value).encode()
    else:
        raise TypeError(f"a {type(value).__name__} has no digest")
    digest = hashlib.sha256(f"{kind}\n".encode())
    digest.update(held)
    return digest.digest()


def plain(value: Any) -> Any:
    """What JSON can hold of a value: lists for tuples, and None for numbers that are not finite."""
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _shown(held: object) -> str:
    """What a repr shows of a field: of arrays their kind and shape."""
    return f"{held.dtype}{list(held.shape)}" if isinstance(held, np.ndarray) else repr(held)
