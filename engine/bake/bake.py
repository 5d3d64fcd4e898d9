"""From a prescription to lens data: places in the field, the PSF window, and then a PSF per place and wavelength."""

from collections.abc import Callable, Sequence

import numpy as np

from ..lens.conventions import WAVELENGTHS_NM
from ..lens.lens import Lens
from ..prescription.prescription import Prescription
from ..rays.focus import build_system
from ..runtime.errors import LensError
from .grid_bake import bake_grid
from .grid_ends import Ends, grid_ends_mm
from .quality import QUALITIES, Quality
from .radial_bake import bake_radial


def bake(prescription: Prescription, *, quality: str | Quality = "standard", heights: int | None = None,
         wavelengths_nm: Sequence[float] | np.ndarray = WAVELENGTHS_NM, ends_mm: Ends | None = None,
         pitch_um: float | None = None, samples: int | None = None, workers: int | None = None,
         progress: Callable[[float, str], object] = lambda fraction, label: None) -> Lens:
    """Compute the lens data of a prescription.

    Parameters
    ----------
    prescription : Prescription
    quality : str or Quality
        The name of one of `QUALITIES`; or SKETCH, for pixels that are larger than the lens's PSFs.
    heights : int or None
        Number of field heights, from the axis to the end of the prescription's field, densest where PSFs change
        fastest; None for as many as the quality needs. Only for lenses with rotational symmetry.
    wavelengths_nm : sequence of float
    ends_mm : Ends or None
        Ends of the grid of a lens without rotational symmetry, from `grid_ends_mm`; None for the ends of the sensor.
    pitch_um : float or None
        Pitch of the PSF samples; None for the finest at which every PSF contains 99.5 % of its light.
    samples : int or None
        Samples of each PSF along each side; odd. None for samples no larger than the pixels of the quality's picture,
        within `LEAST_SAMPLES` to `MOST_SAMPLES`.
    workers : int or None
        Threads; None for one per core.
    progress : function (fraction, label)

    Returns
    -------
    RadialLens or GridLens
        A `GridLens` without rotational symmetry.

    Raises
    ------
    LensError
        A prescription that cannot be traced, or an invalid argument.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    _check_request(prescription, heights, wavelengths_nm, samples, pitch_um)
    fineness = quality if isinstance(quality, Quality) else QUALITIES[quality]
    progress(0.0, "Tracing rays")
    system = build_system(prescription)
    if prescription.radial:
        return bake_radial(system, fineness, heights, wavelengths_nm, pitch_um, samples, workers, progress)
    return bake_grid(system, fineness, wavelengths_nm, ends_mm or grid_ends_mm(system), pitch_um, samples, workers,
                     progress)


def _check_request(prescription, heights, wavelengths_nm, samples, pitch_um):
    if heights is not None and heights < 2:
        raise LensError(prescription.name, "heights", heights, "expected at least 2")
    if heights is not None and not prescription.radial:
        raise LensError(prescription.name, "heights", heights, "only for lenses with rotational symmetry: leave it out")
    if not wavelengths_nm.size or np.any(np.diff(wavelengths_nm) <= 0):
        raise LensError(prescription.name, "wavelengths", wavelengths_nm.tolist(), "expected ascending nanometres")
    if samples is not None and (samples < 3 or samples % 2 == 0):
        raise LensError(prescription.name, "samples", samples, "expected an odd number: the chief ray is at the centre")
    if pitch_um is not None and not (np.isfinite(pitch_um) and pitch_um > 0):
        raise LensError(prescription.name, "pitch", pitch_um, "expected a positive number of um")
