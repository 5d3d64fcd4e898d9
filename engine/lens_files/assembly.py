"""The last step of all readers of lens data: check that the files are consistent, and build the lens."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..lens.radial_lens import RadialLens
from ..runtime.errors import LensError
from .psf_grid import PsfGrid, psf_table

SAME_WAVELENGTH_NM = 1.0
SAME_HEIGHT = 0.01  # of the largest height
MOST_PSFS = 100_000
PUPIL_UNKNOWN = "Entrance pupil not stated: assumed at the first surface."
ISET_ASSUMED = ("Sensor assumed to be 4 : 3 with the last height at its corners. Transmittance assumed to be 1. "
                "F-number as stated: ISET's is the paraxial working f-number, while irradiance follows the real one, "
                "0.5 / NA (the paper's lens, Edmund 54-852, becomes 12 % too bright).")


def check_count(path: Path, wavelengths: Sequence[float] | np.ndarray, heights: Sequence[float] | np.ndarray) -> None:
    """Raise a LensError if a description names implausibly many PSFs, before any of them is read."""
    if len(wavelengths) * len(heights) > MOST_PSFS:
        raise LensError(path, "PSFs", f"{len(wavelengths)} x {len(heights)}", f"expected at most {MOST_PSFS}")


@np.errstate(over="ignore")  # for a magnification of almost 0, with which the pupil is unknown
def entrance_pupil(half_field_deg: float, height_mm: float, magnification: float, object_distance_mm: float,
                   efl_mm: float) -> tuple[float, str]:
    """Position of the entrance pupil from which an object at the edge of the field appears at the given angle.

    |magnification| (object distance + entrance pupil) = image height / tan(half field)

    Returns
    -------
    entrance_pupil_mm : float
    note : str
        The assumption.
    """
    if np.isinf(object_distance_mm) or not 0 < half_field_deg < 90 or magnification == 0:
        return 0.0, PUPIL_UNKNOWN
    virtual_height_mm = height_mm / np.tan(np.radians(half_field_deg))
    pupil_mm = virtual_height_mm / abs(magnification) - object_distance_mm
    # Macros of 2008 and later write a height of efl tan(fov) even for near objects, which says nothing about the pupil.
    if abs(virtual_height_mm - efl_mm) < 1e-5 * abs(efl_mm) or abs(pupil_mm) > object_distance_mm:
        return 0.0, PUPIL_UNKNOWN
    return float(pupil_mm), "Entrance pupil from the field angle of the last height."


def build_lens(path: str | Path, read_psf: Callable[[int, int], PsfGrid], image_side: str, **facts: Any) -> RadialLens:
    """Build a lens from tables and PSFs.

    Parameters
    ----------
    path : path
        For errors.
    read_psf : function of (height number, wavelength number), from 1
    image_side : "+y" or "-y"
        The side of the axis with the image points, unless a PSF states it.
    facts : the other fields of RadialLens
        Except enclosed energy, which exports do not contain. Transmittance is optional and 1 by default.

    Raises
    ------
    LensError
        Any of them is invalid.
    """
    wavelengths, real = np.asarray(facts["wavelengths_nm"], dtype=float), facts["real_height_mm"]
    grids = [[_checked(read_psf(h + 1, w + 1), nm, real[w, h], real.max()) for h in range(real.shape[1])]
             for w, nm in enumerate(wavelengths)]
    psf, pitch_um = psf_table(grids, image_side)
    facts.setdefault("transmittance", np.ones(wavelengths.size))
    try:
        return RadialLens(psf=psf, psf_pitch_um=pitch_um, enclosed_energy=np.full(real.shape, np.nan), **facts)
    except LensError as error:
        raise error.at(path) from None


def _checked(grid, wavelength_nm, real_height_mm, largest_mm):
    """The grid, after a check that any wavelength or height that it states agrees with these."""
    if grid.wavelength_nm is not None and abs(grid.wavelength_nm - wavelength_nm) > SAME_WAVELENGTH_NM:
        raise LensError(grid.where, "wavelength", f"{grid.wavelength_nm:g} nm", f"expected {wavelength_nm:g} nm here")
    if grid.image_mm is not None and abs(np.hypot(*grid.image_mm) - real_height_mm) > SAME_HEIGHT * largest_mm:
        raise LensError(grid.where, "image point", f"{np.hypot(*grid.image_mm):g} mm from the axis",
                        f"expected {real_height_mm:g} mm, as in the table of real heights")
    return grid
