"""Checks of input files: regular, readable, of plausible size, and in the folders that a confined process may use.

A path may come from an untrusted .blend or lens file. A pipe blocks its reader for ever, a device never ends, and a
sparse file of a terabyte occupies a few bytes of disk: `check_input` checks a file without opening it.
"""

import os
import stat
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import IO

from .errors import InputError, absence, explain, quoted, withheld

AnyPath = str | os.PathLike[str]

MOST_TEXT_BYTES = 2**26
"""Limit for a text file: a prescription, an IES lamp, a shader. The longest measured lamp has about 100 kB."""
MOST_FONT_BYTES = 2**30
"""The largest collections of CJK fonts have 0.2 GB."""
MOST_BYTES = 2**36
"""Limit for a file that is read completely into memory: 64 GiB, an uncompressed image of 65,536 x 65,536 px with four
floats each. Blender creates no larger images."""
_confined: dict[str, tuple[Path, ...]] = {}
_named_by_others: dict[str, str] = {}


def confine(read: Iterable[AnyPath], write: Iterable[AnyPath]) -> None:
    """Restrict this process to reading and writing files below these folders, with all links resolved.

    Parameters
    ----------
    read, write : iterable of path
    """
    _confined.update(read=tuple(map(_real, read)), write=tuple(map(_real, write)))


def is_confined() -> bool:
    """Whether this process is confined to some folders, because its files are untrusted."""
    return bool(_confined)


def release() -> None:
    """Undo `confine`."""
    _confined.clear()


def is_below(path: AnyPath, folder: AnyPath) -> bool:
    """Whether a path, with all links resolved, is a folder or below it."""
    return _real(path).is_relative_to(_real(folder))


def check_input(path: AnyPath, field: str, expected: str, most_bytes: int | None = MOST_BYTES,
                error: type[InputError] = InputError, where: str | None = None) -> None:
    """Raise an error unless a path is a regular file that can be read, of plausible size. It is not opened.

    Parameters
    ----------
    path : path
    field : str
        The file's role, for the error.
    expected : str
        The remedy if the path is missing or not a regular file.
    most_bytes : int or None
        None for files that are never read completely, such as videos.
    error : type
        InputError or a class derived from it.
    where : str, optional
        Named in the error instead of the path: the text that led to it.
    """
    with quoted():  # these errors contain nothing from the file
        _check_confined("read", path, error, where)
        try:
            status = os.stat(path)
        except (OSError, ValueError):  # the latter for a text with a null character
            raise error(where or path, field, absence(path), expected) from None
        if not stat.S_ISREG(status.st_mode):
            raise error(where or path, field, absence(path), expected)
        if most_bytes is not None and status.st_size > most_bytes:
            raise error(where or path, field, f"{status.st_size / 2**20:.0f} MB",
                        f"expected at most {most_bytes / 2**20:.0f} MB")
        if not os.access(path, os.R_OK):
            raise error(where or path, field, "not readable", "Permission denied")


def check_named(path: AnyPath, kind: str, named_by: object, most_bytes: int | None = MOST_BYTES) -> None:
    """Raise an InputError for a file named by a scene that Blender must not open, such as a pipe. It may be missing.

    Parameters
    ----------
    path : path
    kind : str
        The file's role in the scene.
    named_by : object
        The scene's file or data-block.
    most_bytes : int or None
        As for `check_input`.
    """
    _check_confined("read", path, InputError)
    if os.path.exists(path) and not os.path.isdir(path):
        check_input(path, kind, f"{named_by} names it: expected a regular file", most_bytes)


def open_input(path: AnyPath) -> IO[bytes]:
    """Open a file to read bytes. The open does not block even if the file was replaced by a pipe after its check.

    Raises
    ------
    OSError
    """
    return open(path, "rb", opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NONBLOCK", 0)))


def read_limited(path: AnyPath, field: str, most_bytes: int, expected: str) -> str:
    """The text of a UTF-8 file with a limited number of bytes; invalid bytes become replacement characters.

    Raises
    ------
    InputError
    """
    try:
        with open_input(path) as file:
            raw = file.read(most_bytes + 1)
    except OSError as error:
        raise InputError(path, field, "not readable", explain(error)) from None
    if len(raw) > most_bytes:
        raise InputError(path, "size", f"over {most_bytes} bytes", expected)
    return raw.decode("utf-8-sig", errors="replace")


def note_who_names(path: AnyPath, remedy: str | None) -> None:
    """Note whether the user named a file: errors quote the contents of such files only.

    Parameters
    ----------
    path : path
    remedy : str or None
        What to do about invalid contents of a file that a scene or other data names; None for a file that the user
        names.
    """
    if remedy is None:
        _named_by_others.pop(os.path.abspath(path), None)
    else:
        _named_by_others[os.path.abspath(path)] = remedy


def reading(path: object) -> AbstractContextManager[None]:
    """A context for reading and checking a file's contents. `path` may also be contents in memory."""
    remedy = _named_by_others.get(os.path.abspath(path)) if isinstance(path, str | os.PathLike) else None
    return nullcontext() if remedy is None else withheld(path, remedy)


def check_writable_place(path: AnyPath) -> None:
    """Raise an InputError for a path that a confined process may not write to."""
    _check_confined("write", path, InputError)


def _check_confined(use, path, error, where=None):
    if use in _confined and not any(_real(path).is_relative_to(folder) for folder in _confined[use]):
        inside = "the scene's folder and --root" if use == "read" else "--output"
        raise error(where or path, "file", f"outside {inside}", f"--untrusted {use}s files below {inside} only")


def _real(path):
    """The resolved path, whether the file exists or not; one outside all folders if it cannot be resolved."""
    try:
        return Path(path).resolve()
    except (OSError, RuntimeError, ValueError):  # circular links; a null character
        return Path(os.path.abspath(os.devnull), "unresolved")
