"""Versions of file formats."""

from collections.abc import Collection
from typing import Any

from .errors import InputError
from .numbers import is_integer


def check_version(where: Any, version: Any, known: Collection[int], error: type[InputError] = InputError,
                  field: str = "version") -> None:
    """Check the version that a file states.

    Parameters
    ----------
    where : str or path
        The file.
    version : value in the file; None if it is missing
    known : collection of int
        The versions that this Lensfield reads.
    error : type
        Of the error.
    field : str
        Its name in the file.

    Raises
    ------
    InputError
        The version is not known: of the type `error`.
    """
    if is_integer(version) and version in known:
        return
    newer = is_integer(version) and version > max(known)
    raise error(where, field, "missing" if version is None else version,
                f"expected {' or '.join(map(str, known))}" + "; update Lensfield to read newer files" * newer)
