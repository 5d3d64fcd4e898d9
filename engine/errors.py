"""Errors that a user can act on: which file or object, which field, which value, what to do."""

import os
from typing import Any, Self

MOST_SHOWN = {"where": 240, "field": 80, "value": 120, "remedy": 400}
"""Characters of each part of an error: a line of what others have written, and never a file."""


def shown(value: Any, most: int = 40) -> str:
    """A value as messages show it: in one line, cut in the middle where it is long, and without what steers terminals.

    Parameters
    ----------
    value : object
        A text is shown as it is, anything else by its repr.
    most : int
        Characters.
    """
    try:
        text = value if isinstance(value, str) else repr(value)
    except (RecursionError, ValueError):  # nested without end, or a number of more digits than Python writes
        text = f"{type(value).__name__} too large to show"
    if len(text) > most:
        begin = (most - 3) // 2
        text = f"{text[:begin]}...{text[begin + 3 - most:]}"
    return printable(" ".join(text.splitlines()))


def printable(text: str) -> str:
    """A text whose characters all show; line ends stay."""
    return "".join(letter if letter.isprintable() or letter == "\n" else " " if letter.isspace() else "?"
                   for letter in text)


class InputError(ValueError):
    """Bad input, told in one line, in which nothing is long and everything shows.

    Parameters
    ----------
    where : str or path
        The file, object or option at fault.
    field : str
        The field in it.
    value : object
        What was found there.
    remedy : str
        What is expected or what to do.
    """

    def __init__(self, where: Any, field: str, value: Any, remedy: str):
        parts = {"where": str(where), "field": field, "remedy": remedy}
        self.where, self.field, self.remedy = (shown(part, MOST_SHOWN[name]) for name, part in parts.items())
        self.value = shown(value, MOST_SHOWN["value"]) if isinstance(value, str) else value
        told = shown(self.value, MOST_SHOWN["value"]) or "empty"
        super().__init__(f"{self.where}: {self.field} is {told}: {self.remedy}")

    def at(self, where: Any) -> Self:
        """The same error told of another place: of a file, where the value that was made from it told of itself."""
        return type(self)(where, self.field, self.value, self.remedy)

    def __reduce__(self):  # it comes back from worker processes, and an exception is made again from its text alone
        return type(self), (self.where, self.field, self.value, self.remedy)


def absence(path: str | os.PathLike) -> str:
    """What is wrong with a path that should be a file and is not, as a value for an error."""
    return "a folder" if os.path.isdir(path) else "not there"


class LensError(InputError):
    """Lens data that is missing, damaged or unfit for what was asked of it."""


class ImageError(InputError):
    """A spectral image that is damaged or unfit for what was asked of it."""
