"""Text as lens-design programs write it: of any encoding, with decimal points or commas, and not to be trusted."""

import codecs
import os
from pathlib import Path

import numpy as np

from ...errors import LensError, absence

LARGEST_FILE = 2**26
MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


def read_text(path: str | os.PathLike) -> str:
    """The text of a file in UTF-16, UTF-8 or latin-1.

    Raises
    ------
    LensError
        No such file, one that cannot be read, or one that is too large to be what it should be.
    """
    if not os.path.isfile(path):
        raise LensError(path, "file", absence(path), "expected a text file")
    try:
        size = os.path.getsize(path)
        if size > LARGEST_FILE:
            raise LensError(path, "file", f"{size / 2**20:.0f} MB", "expected a text file of at most 64 MB")
        return decoded(Path(path).read_bytes())
    except OSError as error:
        raise LensError(path, "file", "not readable", error.strerror or str(error)) from None


def decoded(data: bytes) -> str:
    """The text of bytes in UTF-16, UTF-8 or latin-1."""
    for mark, encoding in MARKS.items():
        if data.startswith(mark):
            return data.decode(encoding, errors="replace")
    if b"\0" in data[:64]:  # what GETTEXTFILE writes may lack the mark
        return data.decode("utf-16-le" if data[1:2] == b"\0" else "utf-16-be", errors="replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def numbers(text: str, path: str | os.PathLike, field: str) -> np.ndarray:
    """float array of all the numbers in a text, with decimal points or decimal commas.

    Commas beside points part numbers; alone they are decimal commas.

    Raises
    ------
    LensError
        The text holds something else, or a number that is not finite.
    """
    words = text.replace(",", " " if "." in text else ".").split()
    try:
        values = np.fromiter(map(float, words), float, len(words))
    except ValueError:
        wrong = next(word for word in words if not _is_number(word))
        raise LensError(path, field, wrong, "expected numbers alone") from None
    if not np.isfinite(values).all():
        raise LensError(path, field, "not finite", "expected numbers throughout")
    return values


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True


def number_table(text: str, path: str | os.PathLike, field: str, shape: tuple[int, int]) -> np.ndarray:
    """float array (wavelength, height) from a table that lists, height by height, one number for each wavelength.

    Rows and line ends carry no meaning: some macros write a row for each height, others one number on each line.

    Raises
    ------
    LensError
        The text holds something else than `shape` = (wavelengths, heights) finite numbers.
    """
    values = numbers(text, path, field)
    wavelengths, heights = shape
    if values.size != wavelengths * heights:
        raise LensError(path, field, f"{values.size} numbers",
                        f"expected {heights} heights x {wavelengths} wavelengths = {heights * wavelengths}")
    return values.reshape(heights, wavelengths).T
