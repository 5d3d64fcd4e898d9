"""What readers of lens data share once their files are read: checks between the files, and the Lens itself."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import LensError
from ..lens import Lens
from .psf_grid import PsfGrid, psf_table

SAME_WAVELENGTH_NM = 1.0
SAME_HEIGHT = 0.01  # of the largest height
MOST_PSFS = 100_000
FAR_MM = 1e8  # infinity, as other programs write it, is farther: Zemax's is 1e10, CODE V's 1e13
PUPIL_UNKNOWN = "Entrance pupil not told: taken at the first surface."
ISET_ASSUMED = ("Sensor taken as 4 : 3 with the last height at its corners. Transmittance taken as 1. F-number taken "
                "as told: ISET's is the paraxial working one, and light goes by the real one, 0.5 / NA (the paper's "
                "lens, Edmund 54-852, comes out 12 % too bright).")


def check_count(path: Path, wavelengths: Sequence[float] | np.ndarray, heights: Sequence[float] | np.ndarray) -> None:
    """Raise a LensError where a description asks for more PSFs than anybody has, before it is followed."""
    if len(wavelengths) * len(heights) > MOST_PSFS:
        raise LensError(path, "PSFs", f"{len(wavelengths)} x {len(heights)}", f"expected at most {MOST_PSFS}")


def four_by_three(half_diagonal_mm: float) -> tuple[float, float]:
    """Width and height of the sensor with sides 4 : 3."""
    return 1.6 * half_diagonal_mm, 1.2 * half_diagonal_mm


def object_distance(told_mm: float) -> float:
    """Another program's object distance in mm: inf where its figure stands for infinity."""
    return np.inf if abs(told_mm) >= FAR_MM else told_mm


@np.errstate(over="ignore")  # of a magnification of next to nothing: then it is not known
def entrance_pupil(half_field_deg: float, height_mm: float, magnification: float, object_distance_mm: float,
                   efl_mm: float) -> tuple[float, str]:
    """Where the entrance pupil must lie for an object at the edge of the field to be seen at that angle.

    |magnification| (object distance + entrance pupil) = image height / tan(half field)

    Returns
    -------
    entrance_pupil_mm : float
    note : str
        What was assumed.
    """
    if np.isinf(object_distance_mm) or not 0 < half_field_deg < 90 or magnification == 0:
        return 0.0, PUPIL_UNKNOWN
    seen_mm = height_mm / np.tan(np.radians(half_field_deg))
    pupil_mm = seen_mm / abs(magnification) - object_distance_mm
    # The macros of 2008 and later write a height of efl tan(fov) for near objects too: nothing follows from that one.
    if abs(seen_mm - efl_mm) < 1e-5 * abs(efl_mm) or abs(pupil_mm) > object_distance_mm:
        return 0.0, PUPIL_UNKNOWN
    return float(pupil_mm), "Entrance pupil from the field angle of the last height."


def build_lens(path: str | Path, read_psf: Callable[[int, int], PsfGrid], image_side: str, **facts: Any) -> Lens:
    """The Lens of tables and PSFs.

    Parameters
    ----------
    path : path
        For errors.
    read_psf : function of (height number, wavelength number), from 1
    image_side : "+y" or "-y"
        Where the image points lie, unless a PSF tells.
    facts : the other fields of Lens
        Without enclosed energy, which exports do not tell, and transmittance where it is not known: then 1.

    Raises
    ------
    LensError
        What cannot be right in any of them.
    """
    wavelengths, real = np.asarray(facts["wavelengths_nm"], dtype=float), facts["real_height_mm"]
    grids = [[_checked(read_psf(h + 1, w + 1), nm, real[w, h], real.max()) for h in range(real.shape[1])]
             for w, nm in enumerate(wavelengths)]
    psf, pitch_um = psf_table(grids, image_side)
    facts.setdefault("transmittance", np.ones(wavelengths.size))
    try:
        return Lens(psf=psf, psf_pitch_um=pitch_um, enclosed_energy=np.full(real.shape, np.nan), **facts)
    except LensError as error:
        raise error.at(path) from None


def _checked(grid, wavelength_nm, real_height_mm, largest_mm):
    """The grid, unless it tells of another wavelength or another height than these: files that were mixed up."""
    if grid.wavelength_nm is not None and abs(grid.wavelength_nm - wavelength_nm) > SAME_WAVELENGTH_NM:
        raise LensError(grid.where, "wavelength", f"{grid.wavelength_nm:g} nm", f"expected {wavelength_nm:g} nm here")
    if grid.image_mm is not None and abs(np.hypot(*grid.image_mm) - real_height_mm) > SAME_HEIGHT * largest_mm:
        raise LensError(grid.where, "image point", f"{np.hypot(*grid.image_mm):g} mm from the axis",
                        f"expected {real_height_mm:g} mm, by the table of real heights")
    return grid
