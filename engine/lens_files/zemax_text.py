"""Text listings of Zemax and OpticStudio: Huygens and FFT PSFs, relative illumination, field curvature and distortion.

The orientation of PSF listings was measured on OpticStudio's output, which states the PSF's centroid in addition to its
samples: the first row has the largest y, and columns ascend with x. The chief ray is the sample named by `Center
point`: in FFT listings by row from the top and column, in Huygens listings by column and row *from the bottom*, all
counted from 1.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..runtime.errors import LensError
from ..runtime.text import numbers
from .psf_grid import PsfGrid

NUMBER = r"([-+]?\d{1,30}(?:[.,]\d{1,30})?(?:[Ee][-+]?\d{1,4})?)"
INTEGER = r"(\d{1,9})"
CENTRE = re.compile(rf"Center point is:\s*(row\s*)?{INTEGER},\s*(?:column\s*)?{INTEGER}")
GRID = re.compile(rf"Image grid size:\s*{INTEGER}\s*by\s*{INTEGER}")
OTHER_THAN_NUMBERS = re.compile(r"[^\s\d.,eE+\-]")
MM = {"": 1.0, "millimeters": 1.0, "centimeters": 10.0, "inches": 25.4, "meters": 1000.0}
FIELD_COLUMNS = ("tan shift", "sag shift", "real height", "ref. height", "distortion (", "distortion(")


def is_listing(text: str) -> bool:
    """Whether a text contains anything other than numbers."""
    return OTHER_THAN_NUMBERS.search(text) is not None


def psf_grid(text: str, path: Path) -> PsfGrid:
    """The PSF of a Huygens or FFT listing.

    Raises
    ------
    LensError
        The text is not such a listing, is incomplete, has several wavelengths, or its scale is not linear.
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
    """The text before the first row of numbers, and the rows."""
    lines = text.splitlines()
    first = next((at for at, line in enumerate(lines) if len(line.split()) >= 3 and not is_listing(line)), len(lines))
    return "\n".join(lines[:first]), [line for line in lines[first:] if line.strip()]


def _number(text):
    return float(text.replace(",", "."))


def _pitch_um(header, columns, path):
    """Distance between samples; from the width of the area if the header states it, because it has more digits."""
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
    centre = CENTRE.search(header)
    if "fft psf" in header.lower() or (centre and centre[1]):
        return fft_centre(header, shape)
    rows, columns = shape
    column, row = (int(centre[2]), int(centre[3])) if centre else (columns // 2 + 1, rows // 2 + 1)
    return row - 1, column - 1


def fft_centre(header: str, shape: tuple[int, int]) -> tuple[int, int]:
    """Row from the bottom and column of the chief ray, from 0, in an FFT's PSF that may be cropped to its middle.

    The header states both in the full grid, from 1, the row from the top. Without this line, the default position is
    used.
    """
    rows, columns = shape
    centre, grid = CENTRE.search(header), GRID.search(header)
    grid_rows, grid_columns = (int(grid[1]), int(grid[2])) if grid else shape
    row, column = (int(centre[2]), int(centre[3])) if centre else (grid_rows // 2 + 1, grid_columns // 2)
    return rows - (row - (grid_rows - rows) // 2), column - 1 - (grid_columns - columns) // 2


def _wavelength_nm(header, path):
    wavelengths = re.search(rf"^[ \t]*{NUMBER}(?:\s+to\s+{NUMBER})?\s*\S{{1,4}}\s+at\s", header, re.MULTILINE)
    if not wavelengths:
        return None
    if wavelengths[2] and _number(wavelengths[1]) != _number(wavelengths[2]):
        raise LensError(path, "wavelengths", wavelengths[0].strip(), "expected the PSF of a single wavelength")
    return 1e3 * _number(wavelengths[1])


def image_mm(header: str, path: Path) -> tuple[float, float] | None:
    """The chief ray's point (x, y) in the image plane in mm, from the header of a PSF; None if it is not stated."""
    point = re.search(rf"(?:Center|Reference) coordinates\s*:\s*{NUMBER},\s*{NUMBER}[ \t]*([A-Za-z]*)", header,
                      re.IGNORECASE)
    if not point:
        return None
    scale = MM.get(point[3].lower())
    if scale is None:
        raise LensError(path, "Center coordinates", point[0], f"expected one of: {', '.join(MM)[2:]}")
    return scale * _number(point[1]), scale * _number(point[2])


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
    """The relative illumination over the field, from a Zemax listing."""
    unit = re.search(r"Field (?:values|units) are(?: in)?\s*(\w+)", text, re.IGNORECASE)
    wavelength = re.search(rf"Wavelength\s*:\s*{NUMBER}", text)
    if not re.search(r"Rel(?:\.|ative) Ill", text, re.IGNORECASE):
        raise LensError(path, "relative illumination", "missing", "expected a table or a Zemax listing of it")
    table = _columns(text.splitlines(), 2, path, "relative illumination")
    return FieldListing(np.abs(table[:, 0]), table[:, 1], unit[1].lower() if unit else "",
                        1e3 * _number(wavelength[1]) if wavelength else None)


def distortion(text: str, path: Path) -> list[FieldListing]:
    """Real over paraxial heights, in mm, from a Zemax listing of field curvature and distortion.

    Returns
    -------
    list of FieldListing
        One for each wavelength; `field` is the reference height f tan(theta), the paraxial height.
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
    """float array (row, column) of the lines that begin with at least `least` numbers."""
    rows = []
    for line in lines:
        words = line.replace("%", " ").replace(",", ".").split()
        if len(words) >= least and not any(OTHER_THAN_NUMBERS.search(word) for word in words[:least]):
            rows.append(" ".join(words[:least]))
    if len(rows) < 2:
        raise LensError(path, field, f"{len(rows)} rows", "expected at least two field points")
    return numbers(" ".join(rows), path, field).reshape(-1, least)
