"""Parsers of spectra: two-column files, and pairs on one line."""

import os
import re
from pathlib import Path

import numpy as np

from ..runtime.errors import InputError
from ..runtime.inputs import check_input, read_limited, reading

_NUMBER = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?+"  # ++ does not backtrack, which avoids quadratic time
_COLON_PAIRS = re.compile(rf"{_NUMBER}\s*(?:nm)?\s*:")  # their start
_BRACKET_PAIRS = re.compile(rf"\[|{_NUMBER}(?:\s+{_NUMBER})+$")
MOST_BYTES = 2**23  # enough for steps of 0.01 nm from ultraviolet to infrared
MOST_CHARACTERS = 2**16  # in a spectrum on one line


def are_pairs(text: str) -> bool:
    """Whether a spectrum's text is pairs, valid or not, rather than a path."""
    return bool(_COLON_PAIRS.match(text) or _BRACKET_PAIRS.match(text))


def read_spectrum_text(text: str, folder: str | os.PathLike) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in nm and values, from pairs or a two-column file.

    Parameters
    ----------
    text : str
        `400:0.1, 700:0.2` (Mitsuba), `[400 0.1 700 0.2]` (PBRT, with or without brackets) or a path.
    folder : path
        Base of a relative path.

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
    check_input(path, "spectrum", "give a library name, a two-column file (nm, value) or pairs such as "
                "400:0.1, 700:0.2 or [400 0.1 700 0.2]", where=text)
    return read_columns(path)


def read_columns(path: str | os.PathLike) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths in nm and values from a two-column file, split by blanks, commas or semicolons; # comments."""
    with reading(path):
        return _checked(path, _columns(path))


def _columns(path):
    pairs = []
    lines = read_limited(path, "spectrum", MOST_BYTES, "expected a wavelength and a value in each line").splitlines()
    for number, line in enumerate(lines, 1):
        words = re.split(r"[\s,;]+", line.split("#")[0].strip())
        if words == [""]:
            continue
        try:
            nm, value = map(float, words[:2])
        except ValueError:
            raise InputError(path, f"line {number}", line.strip(), "expected a wavelength in nm and a value") from None
        pairs.append((nm, value))
    return pairs


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
    check_spectrum(where, wavelengths, values)
    return wavelengths, values


def check_spectrum(where: object, wavelengths: np.ndarray, values: np.ndarray) -> None:
    """Raise an InputError unless these are wavelengths in nm with a value each."""
    if np.ndim(wavelengths) != 1 or np.shape(wavelengths) != np.shape(values) or not np.size(wavelengths):
        raise InputError(where, "spectrum", f"of {np.shape(wavelengths)} wavelengths and {np.shape(values)} values",
                         "expected a value at each wavelength")
    if not np.all(np.isfinite(values)) or np.any(values < 0):
        raise InputError(where, "spectrum", f"{values.min():g} at its minimum", "expected finite values of 0 or more")
    if not np.all(np.isfinite(wavelengths)) or np.any(wavelengths <= 0) or np.any(np.diff(wavelengths) <= 0):
        raise InputError(where, "wavelengths", "not ascending", "expected positive nm in ascending order")
