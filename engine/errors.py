"""Errors that a user can act on: which file or object, which field, which value, what to do."""

import os
from typing import Any, Self


class InputError(ValueError):
    """Bad input, told in one line.

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
        self.where, self.field, self.value, self.remedy = str(where), field, value, remedy
        shown = (value or "empty") if isinstance(value, str) else repr(value)
        super().__init__(f"{self.where}: {field} is {shown}: {remedy}")

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
