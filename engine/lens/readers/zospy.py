"""PSFs as ZOSPy, the Python API of OpticStudio, gives them: DataFrames, and their JSON files.

The rows of OpticStudio's grids ascend with y and their columns with x. ZOSPy's labels (um) are half a sample too large,
because it takes the grid's origin for a corner of a sample where OpticStudio means its middle, so that the chief ray's
sample is labelled half a pitch (as PSFs on the axis show); in older releases 0. Where the header tells the centre, that
is taken.
"""

import json
import re

import numpy as np

from ...errors import LensError
from .psf_grid import PsfGrid, psf_table
from .text import read_text, shown
from .zemax_text import WHOLE, image_mm

LINEAR = {"psf_type": "Linear", "rotation": 0, "use_centroid": False}


def psf_grid_of_file(path):
    """The PSF of a JSON file that `to_json` of a ZOSPy analysis result has written.

    Raises
    ------
    LensError
        Not such a file, a damaged one, or a PSF on a scale that is not linear, rotated, or about its centroid.
    """
    try:
        result = json.loads(read_text(path))
        table, header, settings = result["data"], result.get("header") or [], result.get("settings") or {}
        values, index, columns = (np.array(table[name], dtype=float) for name in ("data", "index", "columns"))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        raise LensError(path, "ZOSPy result", "not readable", "expected the JSON of a PSF analysis") from None
    if not isinstance(settings, dict):
        raise LensError(path, "settings", shown(str(settings)), "expected those of a PSF analysis")
    for name, expected in LINEAR.items():
        if settings.get(name, expected) != expected:
            raise LensError(path, name, shown(str(settings[name])), f"export PSFs with {name} {expected}")
    lines = "\n".join(str(line) for line in header) if isinstance(header, list) else ""
    return _grid(path, values, index, columns, lines)


def psf_grid_of_frame(frame, where="DataFrame"):
    """The PSF of a pandas DataFrame that a ZOSPy PSF analysis gave: index y and columns x, in um.

    Raises
    ------
    LensError
        Samples or labels that are no numbers, or labels that are not evenly spaced.
    """
    try:
        values, index, columns = (np.array(part, dtype=float) for part in (frame.values, frame.index, frame.columns))
    except (ValueError, TypeError):
        raise LensError(where, "PSF", "not numeric", "expected samples labelled by y and x in um") from None
    return _grid(where, values, index, columns, "")


def psfs_of_frames(frames, image_side):
    """A lens's table of PSFs from DataFrames, `frames[wavelength][height]`: see `psf_table`."""
    return psf_table([[psf_grid_of_frame(frame) for frame in row] for row in frames], image_side)


def _grid(path, values, index, columns, header):
    if values.shape != index.shape + columns.shape or values.ndim != 2 or min(values.shape) < 3:
        raise LensError(path, "PSF", f"of shape {values.shape}",
                        f"expected that of its labels, {index.size} x {columns.size}, and at least 3 x 3")
    steps = np.concatenate([np.diff(index), np.diff(columns)])
    pitch = np.abs(steps).mean()
    if not np.all(np.abs(np.abs(steps) - pitch) <= 1e-3 * pitch):  # nor where one is no number
        raise LensError(path, "labels", "unevenly spaced", "expected y and x in um, of one spacing")
    upright = values[::-1] if index[1] < index[0] else values
    mirrored = upright[:, ::-1] if columns[1] < columns[0] else upright
    centre = _centre_of_header(header, values.shape) or (_zero(np.sort(index), pitch), _zero(np.sort(columns), pitch))
    return PsfGrid(path, mirrored, float(pitch), centre, image_mm=image_mm(header, path))


def _centre_of_header(header, shape):
    """Row from the bottom and column, from 0, as an FFT analysis tells them of its full grid, row from the top."""
    told = re.search(rf"Center point is:\s*row\s*{WHOLE},\s*column\s*{WHOLE}", header)
    full = re.search(rf"Image grid size:\s*{WHOLE}\s*by\s*{WHOLE}", header)
    if not told or not full:
        return None
    row, column = int(told[1]) - (int(full[1]) - shape[0]) // 2, int(told[2]) - (int(full[2]) - shape[1]) // 2
    return shape[0] - row, column - 1


def _zero(labels, pitch):
    """Which sample is the chief ray's: that labelled 0, or half a sample more."""
    at_zero = np.flatnonzero(np.abs(labels) < pitch / 4)
    return int(at_zero[0] if at_zero.size else np.argmin(np.abs(labels - pitch / 2)))
