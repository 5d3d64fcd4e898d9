"""Text from lens-design programs: in several encodings, with decimal points or commas, and untrusted."""

import codecs
import os

import numpy as np

from .errors import InputError, LensError, explain
from .inputs import MOST_TEXT_BYTES, check_input, open_input

FAR_MM = 1e8  # distances from here on mean infinity: Zemax writes 1e10, CODE V 1e13
MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}


def read_text(path: str | os.PathLike, error: type[InputError] = LensError) -> str:
    """The text of a file in UTF-16, UTF-8 or latin-1.

    Raises
    ------
    InputError
        The file is missing, unreadable or implausibly large: of the type `error`.
    """
    check_input(path, "file", "expected a text file", MOST_TEXT_BYTES, error)
    try:
        with open_input(path) as file:
            return decoded(file.read())
    except OSError as reason:
        raise error(path, "file", "not readable", explain(reason)) from None


def decoded(data: bytes) -> str:
    """The text of bytes in UTF-16, UTF-8 or latin-1."""
    for mark, encoding in MARKS.items():
        if data.startswith(mark):
            return data.decode(encoding, errors="replace")
    if b"\0" in data[:64]:  # GETTEXTFILE may omit the byte order mark
        return data.decode("utf-16-le" if data[1:2] == b"\0" else "utf-16-be", errors="replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def numbers(text: str, path: str | os.PathLike, field: str) -> np.ndarray:
    """float array of all the numbers in a text, with decimal points or decimal commas.

    In a text that also contains points, commas separate numbers; otherwise they are decimal commas.

    Raises
    ------
    LensError
        The text contains anything else, or a number that is not finite.
    """
    words = text.replace(",", " " if "." in text else ".").split()
    try:
        values = np.fromiter(map(float, words), float, len(words))
    except ValueError:
        wrong = next(word for word in words if not _is_number(word))
        raise LensError(path, field, wrong, "expected only numbers") from None
    if not np.isfinite(values).all():
        raise LensError(path, field, "not finite", "expected only finite numbers")
    return values


def _is_number(word):
    try:
        float(word)
    except ValueError:
        return False
    return True


def number_table(text: str, path: str | os.PathLike, field: str, shape: tuple[int, int]) -> np.ndarray:
    """float array (wavelength, height) from a table that lists one number per wavelength for each height in turn.

    Line ends are ignored: some macros write a row for each height, others one number per line.

    Raises
    ------
    LensError
        The text does not consist of `shape` = (wavelengths, heights) finite numbers.
    """
    values = numbers(text, path, field)
    wavelengths, heights = shape
    if values.size != wavelengths * heights:
        raise LensError(path, field, f"{values.size} numbers",
                        f"expected {heights} heights x {wavelengths} wavelengths = {heights * wavelengths}")
    return values.reshape(heights, wavelengths).T


def object_distance(distance_mm: float) -> float:
    """Another program's object distance in mm: inf if the program means infinity by it."""
    return np.inf if abs(distance_mm) >= FAR_MM else distance_mm
