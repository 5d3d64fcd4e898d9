"""Spectra as people write them down: files of two columns, and pairs in a line."""

import os
import re
from pathlib import Path

import numpy as np

from ..errors import InputError, absence

_NUMBER = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?+"  # ++ takes all, once: no text takes its length squared
_COLON_PAIRS = re.compile(rf"{_NUMBER}\s*(?:nm)?\s*:")  # how they begin
_BRACKET_PAIRS = re.compile(rf"\[|{_NUMBER}(?:\s+{_NUMBER})+$")
MOST_BYTES = 2**23  # 0.01 nm apart from ultraviolet to infrared
MOST_CHARACTERS = 2**16  # of a spectrum in a line


def are_pairs(text: str) -> bool:
    """Whether a spectrum's text is pairs, right or wrong, and no path."""
    return bool(_COLON_PAIRS.match(text) or _BRACKET_PAIRS.match(text))


def read_spectrum_text(text: str, folder: str | os.PathLike) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in nm and values, written as pairs or in a file of two columns.

    Parameters
    ----------
    text : str
        `400:0.1, 700:0.2` (Mitsuba), `[400 0.1 700 0.2]` (PBRT, with or without brackets) or a path.
    folder : path
        Where a relative path starts from.

    Returns
    -------
    wavelengths_nm, values : float64 arrays, the wavelengths positive and ascending, the values finite and not negative

    Raises
    ------
    InputError
    """
    if len(text) > MOST_CHARACTERS:
        raise InputError(text, "spectrum", f"{len(text)} characters long",
                         f"expected at most {MOST_CHARACTERS}: give a two-column file")
    if are_pairs(text):
        return _checked(text, _colon_pairs(text) if _COLON_PAIRS.match(text) else _bracket_pairs(text))
    path = Path(folder) / os.path.expanduser(text)
    if not os.path.isfile(path):  # of a text too long to be a name, Path.is_file raises
        raise InputError(text, "spectrum", absence(path), "give a library name, a two-column file (nm, value) or pairs "
                                                          "such as 400:0.1, 700:0.2 or [400 0.1 700 0.2]")
    return read_columns(path)


def read_columns(path: str | os.PathLike) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in nm and values from a file of two columns, split by blanks, commas or semicolons; # comments."""
    pairs = []
    try:
        with open(path, "rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(path, "spectrum", "not readable", str(error)) from None
    if len(raw) > MOST_BYTES:
        raise InputError(path, "size", f"over {MOST_BYTES} bytes", "expected a wavelength and a value in each line")
    lines = raw.decode("utf-8-sig", errors="replace").splitlines()
    for number, line in enumerate(lines, 1):
        words = re.split(r"[\s,;]+", line.split("#")[0].strip())
        if words == [""]:
            continue
        try:
            nm, value = map(float, words[:2])
        except ValueError:
            raise InputError(path, f"line {number}", line.strip(), "expected a wavelength in nm and a value") from None
        pairs.append((nm, value))
    return _checked(path, pairs)


def _colon_pairs(text):
    pairs = []
    for item in filter(None, (part.strip() for part in re.split(r"[,;]", text))):
        match = re.fullmatch(rf"({_NUMBER})\s*(?:nm)?\s*:\s*({_NUMBER})", item)
        if not match:
            raise InputError(text, "spectrum", item, "expected wavelength:value, such as 400:0.1")
        pairs.append((float(match[1]), float(match[2])))
    return pairs


def _bracket_pairs(text):
    inside = re.fullmatch(r"\[([^\[\]]*)\]", text)
    words = (inside[1] if inside else text).split()
    stray = [word for word in words if not re.fullmatch(_NUMBER, word)]
    if stray or len(words) % 2:
        raise InputError(text, "spectrum", stray[0] if stray else f"{len(words)} numbers",
                         "expected pairs of a wavelength in nm and a value, such as [400 0.1 700 0.2]")
    numbers = list(map(float, words))
    return list(zip(numbers[::2], numbers[1::2], strict=True))


def _checked(where, pairs):
    if not pairs:
        raise InputError(where, "spectrum", "empty", "expected pairs of a wavelength in nm and a value")
    wavelengths, values = np.array(pairs, dtype=np.float64).T
    if not np.all(np.isfinite(values)) or np.any(values < 0):
        raise InputError(where, "spectrum", f"{values.min():g} at the least", "expected finite values of 0 or more")
    if not np.all(np.isfinite(wavelengths)) or np.any(wavelengths <= 0) or np.any(np.diff(wavelengths) <= 0):
        raise InputError(where, "wavelengths", "not ascending", "expected positive nm in ascending order")
    return wavelengths, values
