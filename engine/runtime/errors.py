"""Errors that a user can act on: which file or object, which field, which value, what to do."""

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Self

MOST_SHOWN = {"where": 240, "field": 80, "value": 120, "remedy": 400}
"""Characters of each part of an error: untrusted text is limited to a line, never a complete file."""
_withheld: ContextVar[tuple[Any, str] | None] = ContextVar("withheld", default=None)

PATH_REMEDIES = {
    errno.ENAMETOOLONG: "give a shorter path (most file systems allow 255 bytes per name)",
    errno.ELOOP: "remove the circular link, or give another path",
    errno.EEXIST: "a file or link has this name; move it, or give another path",
    errno.ENOTDIR: "a parent of this path is a file; correct the path",
    errno.EACCES: "change its permissions, or give another path",
    errno.EPERM: "change its permissions, or give another path",
    errno.EROFS: "give a path on a writable disk",
    errno.EISDIR: "give the name of a file",
}
"""Remedies for errors of the operating system that follow from the path itself."""


def shown(value: Any, most: int = 40) -> str:
    """A value as messages show it: on one line, shortened in the middle if it is long, without control characters.

    Parameters
    ----------
    value : object
        A string is shown unchanged, anything else by its repr.
    most : int
        Maximum number of characters.
    """
    try:
        text = value if isinstance(value, str) else repr(value)
    except (RecursionError, ValueError):  # nested too deeply, or a number with more digits than Python converts
        text = f"{type(value).__name__} too large to show"
    if len(text) > most:
        begin = (most - 3) // 2
        text = f"{text[:begin]}...{text[begin + 3 - most:]}"
    return printable(" ".join(text.splitlines()))


def listed(names: Iterable[str], most: int) -> str:
    """Names as messages list them: "a, b and 3 more" if there are more than `most`."""
    names = list(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def printable(text: str) -> str:
    """The text with unprintable characters replaced; line ends stay."""
    replaced = {ord(letter): " " if letter.isspace() else "?" for letter in set(text)
                if letter != "\n" and not letter.isprintable()}
    return text.translate(replaced) if replaced else text


class Stopped(Exception):
    """Raised by a progress function to end the work, because its result would be out of date."""


class InputError(ValueError):
    """Bad input, reported in one line of limited length and printable characters.

    Parameters
    ----------
    where : str or path
        The file, object or option at fault.
    field : str
        The field in it.
    value : object
        The rejected value.
    remedy : str
        The expected value, or what to do.

    Examples
    --------
    >>> from lensfield import InputError, Options
    >>> try:
    ...     Options(accuracy=-1)
    ... except InputError as error:
    ...     print(error)
    options: accuracy is -1: expected a number above 0 and below 2, such as 0.01
    """

    def __init__(self, where: Any, field: str, value: Any, remedy: str):
        if withheld := _withheld.get():
            where, field, value, remedy = withheld[0], "content", "not valid", withheld[1]
        self.where = shown(str(where), MOST_SHOWN["where"])
        self.field, self.remedy = shown(field, MOST_SHOWN["field"]), shown(remedy, MOST_SHOWN["remedy"])
        self.value = shown(value, MOST_SHOWN["value"]) if isinstance(value, str) else value
        value_text = shown(self.value, MOST_SHOWN["value"]) or "empty"
        super().__init__(f"{self.where}: {self.field} is {value_text}: {self.remedy}")

    def at(self, where: Any) -> Self:
        """The same error reported for another place, such as the file that the rejected value came from."""
        with quoted():
            return type(self)(where, self.field, self.value, self.remedy)

    def __reduce__(self):  # workers return errors pickled, and by default an exception is recreated from its text alone
        return type(self), (self.where, self.field, self.value, self.remedy)


@contextmanager
def withheld(path: Any, remedy: str) -> Iterator[None]:
    """Omit a file's contents from errors in the block, because a scene or other data names it, not the user.

    Such a path may lead to a file of secrets, whose first line would then appear in a log that others read. Every
    InputError in the block becomes an error about the path, as does any other exception that the contents cause.

    Parameters
    ----------
    path : path
    remedy : str
        What to do about a file with invalid contents.
    """
    token = _withheld.set((path, remedy))
    try:
        yield
    except (InputError, OSError, MemoryError):  # errors of the system quote only file names
        raise
    except Exception:
        raise InputError(path, "content", "not valid", remedy) from None
    finally:
        _withheld.reset(token)


@contextmanager
def quoted() -> Iterator[None]:
    """Show errors in the block in full, even within `withheld`: they contain nothing from the file's contents."""
    token = _withheld.set(None)
    try:
        yield
    finally:
        _withheld.reset(token)


def absence(path: str | os.PathLike) -> str:
    """Why a path is not a regular file, or not a folder, as the value of an error."""
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "missing"
    except OSError as error:
        return f"not accessible ({error.strerror})"
    except ValueError:
        return "not a valid path (it contains a null character)"
    return "a folder" if stat.S_ISDIR(mode) else "a file" if stat.S_ISREG(mode) else "a device or pipe"


def explain(error: OSError | ValueError) -> str:
    """Why the operating system rejected a path, and the remedy if the path itself is at fault.

    Parameters
    ----------
    error : OSError or ValueError
        The latter is what Python raises for a null character in a path.

    Returns
    -------
    str
        Without error number and path, for use as the remedy of an `InputError`.
    """
    if not isinstance(error, OSError):
        return f"remove the null character from the path ({error})"
    reason = error.strerror or str(error)
    remedy = PATH_REMEDIES.get(error.errno or 0)
    return f"{reason}: {remedy}" if remedy else reason


def one_line(error: Exception) -> str:
    """An exception as a one-line message for users. For an OSError: the file, reason and remedy."""
    if not isinstance(error, OSError):
        return str(error).strip() or type(error).__name__
    if isinstance(error.filename, str | bytes):
        return str(InputError(os.fsdecode(error.filename), "file", "not accessible", explain(error)))
    return explain(error)


class LensError(InputError):
    """Lens data that are missing, damaged or unsuitable for the request.

    Examples
    --------
    >>> from lensfield import LensError, load_lens
    >>> try:
    ...     load_lens("nonsuch")
    ... except LensError as error:
    ...     print(error.where, error.field, error.value, sep=", ")
    nonsuch, lens, missing
    """


class CameraError(InputError):
    """A camera's data that are missing, damaged or unsuitable for the request.

    Examples
    --------
    >>> from lensfield import CameraError, load_camera
    >>> try:
    ...     load_camera("nonsuch")
    ... except CameraError as error:
    ...     print(error.where, error.field, error.value, sep=", ")
    nonsuch, camera, unknown
    """


class ImageError(InputError):
    """A spectral image that is damaged or unsuitable for the request.

    Examples
    --------
    >>> from lensfield import ImageError, SpectralImage
    >>> try:
    ...     SpectralImage([[1.0, 2.0]], wavelengths_nm=[450, 550], pitch_um=15)
    ... except ImageError as error:
    ...     print(error)
    image: wavelengths_nm is 2 long: expected one for each of the 1 planes
    """
