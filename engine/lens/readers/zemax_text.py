"""Text listings of Zemax and OpticStudio: Huygens and FFT PSFs, relative illumination, field curvature and distortion.

How PSF listings lie was measured on OpticStudio's own, which tell the PSF's centroid beside its samples: the first row
is that of the largest y, and columns ascend with x. The chief ray is the sample that `Center point` tells: in FFT
listings by row from the top and column, in Huygens listings by column and row *from the bottom*, all from 1.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import LensError
from .psf_grid import PsfGrid
from .text import numbers

NUMBER = r"([-+]?\d{1,30}(?:[.,]\d{1,30})?(?:[Ee][-+]?\d{1,4})?)"
WHOLE = r"(\d{1,9})"
CENTRE = re.compile(rf"Center point is:\s*(row\s*)?{WHOLE},\s*(?:column\s*)?{WHOLE}")
GRID = re.compile(rf"Image grid size:\s*{WHOLE}\s*by\s*{WHOLE}")
OTHER_THAN_NUMBERS = re.compile(r"[^\s\d.,eE+\-]")
MM = {"": 1.0, "millimeters": 1.0, "centimeters": 10.0, "inches": 25.4, "meters": 1000.0}
FIELD_COLUMNS = ("tan shift", "sag shift", "real height", "ref. height", "distortion (", "distortion(")


def is_listing(text: str) -> bool:
    """Whether a text has more than numbers in it."""
    return OTHER_THAN_NUMBERS.search(text) is not None


def psf_grid(text: str, path: Path) -> PsfGrid:
    """The PSF of a Huygens or FFT listing.

    Raises
    ------
    LensError
        No such listing, an incomplete one, or one of several wavelengths or on a scale that is not linear.
    """
    header, rows = _header_and_rows(text)
    columns = len(rows[0].split()) if rows else 0
    values = numbers(" ".join(rows), path, "PSF samples")
    if not rows or values.size != len(rows) * columns:
        raise LensError(path, "PSF samples", f"{values.size} in {len(rows)} rows", "expected a full grid of numbers")
    shape = (len(rows), columns)
    return PsfGrid(path, values.reshape(shape)[::-1], _pitch_um(header, columns, path), _centre(header, shape),
                   _wavelength_nm(header, path), image_mm(header, path))


def _header_and_rows(text):
    """What stands before the first row of numbers, and the rows."""
    lines = text.splitlines()
    first = next((at for at, line in enumerate(lines) if len(line.split()) >= 3 and not is_listing(line)), len(lines))
    return "\n".join(lines[:first]), [line for line in lines[first:] if line.strip()]


def _number(text):
    return float(text.replace(",", "."))


def _pitch_um(header, columns, path):
    """Distance between samples; from the width of the area, which is told to more digits, where there is one."""
    spacing = re.search(rf"Data spacing is\s*{NUMBER}\s*(\S*)", header)
    if not spacing:
        raise LensError(path, "Data spacing", "missing", "expected a Zemax PSF listing, as text")
    pitch, unit = _number(spacing[1]), spacing[2].rstrip(".")
    if not unit.endswith("m") or unit == "mm":
        raise LensError(path, "Data spacing", spacing[0], "expected um")
    area = re.search(rf"Data area is\s*{NUMBER}", header)
    finer = _number(area[1]) / columns if area else pitch
    return finer if abs(finer - pitch) <= 0.01 * pitch else pitch


def _centre(header, shape):
    """Row from the bottom and column of the chief ray, from 0."""
    told = CENTRE.search(header)
    if "fft psf" in header.lower() or (told and told[1]):
        return fft_centre(header, shape)
    rows, columns = shape
    column, row = (int(told[2]), int(told[3])) if told else (columns // 2 + 1, rows // 2 + 1)
    return row - 1, column - 1


def fft_centre(header: str, shape: tuple[int, int]) -> tuple[int, int]:
    """Row from the bottom and column of the chief ray, from 0, in an FFT's PSF of which the middle may be shown.

    The header tells both in the whole grid, from 1, the row from the top; where it does not, it is the usual one.
    """
    rows, columns = shape
    told, whole = CENTRE.search(header), GRID.search(header)
    whole_rows, whole_columns = (int(whole[1]), int(whole[2])) if whole else shape
    row, column = (int(told[2]), int(told[3])) if told else (whole_rows // 2 + 1, whole_columns // 2)
    return rows - (row - (whole_rows - rows) // 2), column - 1 - (whole_columns - columns) // 2


def _wavelength_nm(header, path):
    told = re.search(rf"^[ \t]*{NUMBER}(?:\s+to\s+{NUMBER})?\s*\S{{1,4}}\s+at\s", header, re.MULTILINE)
    if not told:
        return None
    if told[2] and _number(told[1]) != _number(told[2]):
        raise LensError(path, "wavelengths", told[0].strip(), "expected the PSF of a single wavelength")
    return 1e3 * _number(told[1])


def image_mm(header: str, path: Path) -> tuple[float, float] | None:
    """Where the chief ray meets the image plane, (x, y) in mm, by the header of a PSF; None where it does not tell."""
    told = re.search(rf"(?:Center|Reference) coordinates\s*:\s*{NUMBER},\s*{NUMBER}[ \t]*([A-Za-z]*)", header,
                     re.IGNORECASE)
    if not told:
        return None
    scale = MM.get(told[3].lower())
    if scale is None:
        raise LensError(path, "Center coordinates", told[0], f"expected one of: {', '.join(MM)[2:]}")
    return scale * _number(told[1]), scale * _number(told[2])


@dataclass(frozen=True, eq=False)
class FieldListing:
    """A quantity listed over the field, at one wavelength.

    Attributes
    ----------
    field : array (n,)
        Field coordinates, in `unit`: degrees, or lens units (mm).
    values : array (n,)
    unit : str
    wavelength_nm : float or None
    """

    field: np.ndarray
    values: np.ndarray
    unit: str
    wavelength_nm: float | None


def relative_illumination(text: str, path: Path) -> FieldListing:
    """The relative illumination over the field of a Zemax listing of it."""
    unit = re.search(r"Field (?:values|units) are(?: in)?\s*(\w+)", text, re.IGNORECASE)
    wavelength = re.search(rf"Wavelength\s*:\s*{NUMBER}", text)
    if not re.search(r"Rel(?:\.|ative) Ill", text, re.IGNORECASE):
        raise LensError(path, "relative illumination", "not there", "expected a table or a Zemax listing of it")
    table = _columns(text.splitlines(), 2, path, "relative illumination")
    return FieldListing(np.abs(table[:, 0]), table[:, 1], unit[1].lower() if unit else "",
                        1e3 * _number(wavelength[1]) if wavelength else None)


def distortion(text: str, path: Path) -> list[FieldListing]:
    """Real over paraxial heights, in mm, from a Zemax listing of field curvature and distortion.

    Returns
    -------
    list of FieldListing
        One for each wavelength; `field` is the reference height f tan(theta), which is the paraxial one.
    """
    kind = re.search(r"Distortion Type\s*:\s*([^\n]*)", text, re.IGNORECASE)
    if kind and not re.match(r"F-Tan", kind[1], re.IGNORECASE):
        raise LensError(path, "Distortion Type", kind[1], "expected F-Tan(Theta), which has paraxial heights")
    parts = re.split(rf"Data for wavelength\s*:?\s*{NUMBER}[^\n]*", text)
    if len(parts) == 1:
        return [_distortion_block(text, None, path)]
    return [_distortion_block(block, 1e3 * _number(micrometres), path)
            for micrometres, block in zip(parts[1::2], parts[2::2], strict=True)]


def _distortion_block(text, wavelength_nm, path):
    lines = text.splitlines()
    title = next((line.lower() for line in lines if "real height" in line.lower()), None)
    if title is None or "ref. height" not in title:
        raise LensError(path, "columns", "without Real Height and Ref. Height",
                        "expected a Zemax listing of field curvature and distortion")
    order = sorted((title.find(name), name) for name in FIELD_COLUMNS if name in title)
    column = {name: place for place, (_, name) in enumerate(order, start=1)}
    table = _columns(lines, max(column.values()) + 1, path, "distortion")
    return FieldListing(np.abs(table[:, column["ref. height"]]), np.abs(table[:, column["real height"]]),
                        "millimeters", wavelength_nm)


def _columns(lines, least, path, field):
    """float array (row, column) of the lines that begin with as many numbers."""
    found = []
    for line in lines:
        words = line.replace("%", " ").replace(",", ".").split()
        if len(words) >= least and not any(OTHER_THAN_NUMBERS.search(word) for word in words[:least]):
            found.append(" ".join(words[:least]))
    if len(found) < 2:
        raise LensError(path, field, f"{len(found)} rows", "expected at least two field points")
    return numbers(" ".join(found), path, field).reshape(-1, least)
