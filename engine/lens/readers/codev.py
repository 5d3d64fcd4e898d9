"""PSFs as CODE V exports them from its buffer: bare matrices.

The chief ray is at row and column n / 2 + 1 (a note in the ISET macro for CODE V). Rows are taken to ascend with y and
columns with x: no public document says so, but NASA's MATLAB toolkit for CODE V draws buffers that way up, and ISET's
macros, which export image points at +y from CODE V and at -y from Zemax, then give their reader one orientation.
"""

from pathlib import Path

from ...errors import LensError
from .psf_grid import PsfGrid
from .text import numbers


def psf_grid(text: str, path: Path, pitch_um: float) -> PsfGrid:
    """The PSF of a bare square matrix, whose pitch the file does not tell.

    Raises
    ------
    LensError
        The text is no square matrix of numbers.
    """
    values = numbers(text, path, "PSF samples")
    side = round(values.size**0.5)
    if not values.size or side * side != values.size:
        raise LensError(path, "PSF samples", f"{values.size} numbers", "expected a square matrix")
    return PsfGrid(path, values.reshape(side, side), pitch_um, (side // 2, side // 2))
