"""The light of a lens at the heights of measured curves, and a reader of their tables."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..prescription.photographs import MM_PER_M, MOST_LIGHT, Vignetting
from ..prescription.prescription import Prescription
from ..runtime.errors import LensError
from ..runtime.text import read_text
from .even_light import EvenField

COLUMNS = "f_number", "focus_m", "height_mm", "light"


def light_of(prescription: Prescription, curves: Sequence[Vignetting], pixel_loss: float = 0.0) -> list[np.ndarray]:
    """The light of a lens, with its own apertures, at the heights of curves: a list of arrays (height,).

    Parameters
    ----------
    prescription : Prescription
    curves : sequence of Vignetting
    pixel_loss : float
        As in `StopLight.at`.

    Raises
    ------
    LensError
        As `EvenField`.
    """
    sizes_mm = {index: surface.semi_aperture_mm for index, surface in enumerate(prescription.surfaces)
                if index != prescription.stop_index and np.isfinite(surface.semi_aperture_mm)}
    fields = {focus_mm: EvenField(prescription, focus_mm, measured_heights_mm(curves, focus_mm))
              for focus_mm in dict.fromkeys(curve.focus_mm for curve in curves)}
    return [fields[curve.focus_mm].through(curve.f_number).at(
        list(sizes_mm), np.array(list(sizes_mm.values())), pixel_loss)[
            np.searchsorted(fields[curve.focus_mm].heights_mm, curve.heights_mm)] for curve in curves]


def measured_heights_mm(curves: Sequence[Vignetting], focus_mm: float, *more_mm: float) -> np.ndarray:
    """The axis, the heights of the curves at a focus, and more heights: ascending, each once."""
    measured_mm = [curve.heights_mm for curve in curves if curve.focus_mm == focus_mm]
    return np.unique(np.concatenate([[0.0], more_mm, *measured_mm]))


def read_vignetting(path: str | Path) -> list[Vignetting]:
    """The curves in a table of `COLUMNS`, separated by commas, with `focus_m` in metres or inf.

    Raises
    ------
    LensError
        The table is damaged, or a curve has fewer than three heights.
    """
    rows = list(csv.reader(read_text(path).splitlines()))
    if not rows or tuple(word.strip() for word in rows[0]) != COLUMNS:
        raise LensError(path, "line 1", ",".join(rows[0]) if rows else "", f"expected the columns {','.join(COLUMNS)}")
    curves: dict[tuple[float, float], dict[float, float]] = {}
    for number, row in enumerate(rows[1:], 2):
        if row:
            f_number, focus_m, height_mm, light = _row(path, number, row)
            if curves.setdefault((f_number, focus_m), {}).setdefault(height_mm, light) != light:
                raise LensError(path, f"line {number}", ",".join(row), "expected each height of a curve once")
    return [_curve(path, *setting, curve) for setting, curve in curves.items()]


def _row(path, number, row):
    try:
        values = [float(word) for word in row]
    except ValueError:
        values = []
    if len(values) != len(COLUMNS) or not all(value > 0 for value in values) or values[-1] > MOST_LIGHT or not (
            np.isfinite(values[0]) and np.isfinite(values[2])):
        raise LensError(path, f"line {number}", ",".join(row), "expected an f-number, metres or inf, a height in mm "
                        f"above 0, and the light relative to the axis, up to {MOST_LIGHT:g}")
    return values


def _curve(path, f_number, focus_m, curve):
    heights_mm = np.array(sorted(curve))
    if heights_mm.size < 3:
        raise LensError(path, f"curve at f/{f_number:g}", f"{heights_mm.size} heights", "expected at least 3")
    return Vignetting(f_number, focus_m * MM_PER_M, heights_mm, np.array([curve[each] for each in heights_mm]))
