"""PSFs as ZOSPy, the Python API of OpticStudio, writes them: a DataFrame and its analysis, as JSON.

The rows of OpticStudio's grids ascend with y and their columns with x. ZOSPy's labels (um) are half a sample too large,
because it interprets the grid's origin as a corner of a sample, while OpticStudio means the sample's middle. The chief
ray's sample is therefore labelled half a pitch (as PSFs on the axis show), or 0 in older releases. If the header states
the centre, that is used instead.
"""

import json
from pathlib import Path

import numpy as np

from ..runtime.errors import LensError
from .psf_grid import PsfGrid
from .zemax_text import CENTRE, GRID, fft_centre, image_mm

LINEAR = {"psf_type": "Linear", "rotation": 0, "use_centroid": False}


def psf_grid(text: str, path: Path) -> PsfGrid:
    """The PSF in the output of a ZOSPy analysis result's `to_json`.

    Raises
    ------
    LensError
        The JSON is not such a result or is damaged; or the PSF has a non-linear scale, is rotated, or is centred on its
        centroid.
    """
    try:
        result = json.loads(text)
        table = result["data"].get("psf", result["data"])  # a frame, alone or together with a Strehl ratio
        values = np.array(table["data"], dtype=float)
        y_um, x_um = np.array(table["index"], dtype=float), np.array(table["columns"], dtype=float)
        settings, lines = result.get("settings"), result.get("header")
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        raise LensError(path, "ZOSPy result", "not readable", "expected the JSON of a PSF analysis") from None
    _check_settings(settings, path)
    header = "\n".join(map(str, lines)) if isinstance(lines, list) else ""
    pitch_um = _pitch_um(values, y_um, x_um, path)
    upwards, rightwards = (slice(None, None, -1 if labels[1] < labels[0] else 1) for labels in (y_um, x_um))
    stated = CENTRE.search(header)
    centre = (fft_centre(header, values.shape) if stated and stated[1] and GRID.search(header) else
              (_chief_sample(y_um, pitch_um), _chief_sample(x_um, pitch_um)))
    return PsfGrid(path, values[upwards, rightwards], pitch_um, centre, image_mm=image_mm(header, path))


def _check_settings(settings, path):
    """Raise a LensError if settings contradict an upright PSF around the chief ray on a linear scale."""
    if settings is None:
        return
    if not isinstance(settings, dict):
        raise LensError(path, "settings", settings, "expected the settings of a PSF analysis")
    for name, expected in LINEAR.items():
        if settings.get(name, expected) != expected:
            raise LensError(path, name, settings[name], f"export PSFs with {name} {expected}")


@np.errstate(invalid="ignore", over="ignore")  # for labels that are NaN or infinite
def _pitch_um(values, y_um, x_um, path):
    """Distance between the labels, which must be constant."""
    if values.shape != y_um.shape + x_um.shape or values.ndim != 2 or min(values.shape) < 3:
        raise LensError(path, "PSF", f"of shape {values.shape}",
                        f"expected the shape of its labels, {y_um.size} x {x_um.size}, and at least 3 x 3")
    steps = np.abs(np.concatenate([np.diff(y_um), np.diff(x_um)]))
    pitch_um = float(steps.mean())
    if not np.all(np.abs(steps - pitch_um) <= 1e-3 * pitch_um):  # also catches NaN
        raise LensError(path, "labels", "unevenly spaced", "expected y and x in um, evenly spaced")
    return pitch_um


def _chief_sample(labels_um, pitch_um):
    """Index of the chief ray's sample in ascending order: labelled 0, or half a sample more."""
    labels_um = np.sort(labels_um)
    at_zero = np.flatnonzero(np.abs(labels_um) < pitch_um / 4)
    return int(at_zero[0] if at_zero.size else np.argmin(np.abs(labels_um - pitch_um / 2)))
