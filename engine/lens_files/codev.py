"""PSFs as CODE V exports them from its buffer: bare matrices.

The chief ray is at row and column n / 2 + 1, according to a note in the ISET macro for CODE V. Rows are assumed to
ascend with y, and columns with x. This is not publicly documented, but NASA's MATLAB toolkit for CODE V draws buffers
this way up, and it gives the exports of ISET's macros, whose image points are at +y from CODE V and at -y from Zemax,
the same orientation for their reader.
"""

from pathlib import Path

from ..runtime.errors import LensError
from ..runtime.text import numbers
from .psf_grid import PsfGrid


def psf_grid(text: str, path: Path, pitch_um: float) -> PsfGrid:
    """The PSF in a bare square matrix, whose pitch the file does not state.

    Raises
    ------
    LensError
        The text is not a square matrix of numbers.
    """
    values = numbers(text, path, "PSF samples")
    side = round(values.size**0.5)
    if not values.size or side * side != values.size:
        raise LensError(path, "PSF samples", f"{values.size} numbers", "expected a square matrix")
    return PsfGrid(path, values.reshape(side, side), pitch_um, (side // 2, side // 2))
