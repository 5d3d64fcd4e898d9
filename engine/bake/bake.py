"""From a prescription to lens data: chief rays, the window of the PSFs, and then every field height and wavelength."""

import signal
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..errors import LensError
from ..lens.lens import Lens
from ..lens.readers.assembly import four_by_three
from ..lens.sampling import HEIGHTS, WAVELENGTHS_NM
from ..threads import thread_count
from .build import build_system
from .diffraction import point_spread
from .prescription import PSF_SAMPLES, Prescription
from .rays import HalfPupil, trace_pupil
from .wavefront import trace_wavefronts
from .window import ENERGY, WIDENING, needed_width_um, pitch_for_um

CHIEF_RAYS = 49
SURVEY_FIELDS = (0, 0.3, 0.55, 0.75, 0.85, 0.95, 1)  # of the heights: blur changes fastest where beams are cut off
SURVEY_SHARE = 0.2  # of the time that a bake takes, roughly, for the progress bar


def bake(prescription: Prescription, *, heights: int = HEIGHTS,
         wavelengths_nm: Sequence[float] | np.ndarray = WAVELENGTHS_NM, pitch_um: float | None = None,
         samples: int = PSF_SAMPLES, workers: int | None = None,
         progress: Callable[[float, str], object] = lambda fraction, label: None) -> Lens:
    """Lens data of a prescription.

    Parameters
    ----------
    prescription : Prescription
    heights : int
        Field heights, from the axis to the end of the prescription's field, evenly over the picture.
    wavelengths_nm : sequence of float
    pitch_um : float or None
        Of the PSFs; None for the finest at which they hold 99.5 % of the light everywhere.
    samples : int
        Of each PSF along each side; odd.
    workers : int or None
        Processes that share the work; None for one on each core.
    progress : function (fraction, label)

    Returns
    -------
    Lens

    Raises
    ------
    LensError
        A prescription that cannot be traced, or a request that makes no sense.
    """
    wavelengths_nm = np.asarray(wavelengths_nm, dtype=float)
    _check_request(prescription, heights, wavelengths_nm, samples, pitch_um)
    progress(0.0, "Tracing chief rays")
    system = build_system(prescription)
    heights_mm = _field_heights_mm(system, heights)
    with _pool(system.prescription, heights, workers) as pool:
        if pitch_um is None:
            pitch_um, columns = _columns_that_hold_the_light(pool, heights_mm, wavelengths_nm, samples, progress)
        else:
            columns = _columns(pool, heights_mm, wavelengths_nm, pitch_um, samples, progress)
    return _lens(system, heights_mm, wavelengths_nm, pitch_um, columns)


def focused(prescription: Prescription) -> Prescription:
    """The same lens with image plane, stop and picture as they come to be, for other object distances to keep."""
    system = build_system(prescription)
    return replace(system.prescription, aperture=("stop", system.stop_semi_aperture_mm),
                   field=("image_height_mm", system.last_height_mm))


def _check_request(prescription, heights, wavelengths_nm, samples, pitch_um):
    if heights < 2:
        raise LensError(prescription.name, "heights", heights, "expected at least 2")
    if not wavelengths_nm.size or np.any(np.diff(wavelengths_nm) <= 0):
        raise LensError(prescription.name, "wavelengths", wavelengths_nm.tolist(), "expected ascending nanometres")
    if samples < 3 or samples % 2 == 0:
        raise LensError(prescription.name, "samples", samples, "expected an odd number: the chief ray has the middle")
    if pitch_um is not None and not (np.isfinite(pitch_um) and pitch_um > 0):
        raise LensError(prescription.name, "pitch", pitch_um, "expected a positive number of um")


def _field_heights_mm(system, number):
    """Paraxial heights whose chief rays meet the image plane at even distances, at the reference wavelength."""
    nm = system.prescription.reference_wavelength_nm
    fields = np.linspace(0, 1, CHIEF_RAYS)
    paraxial_mm = system.last_height_mm * fields
    if np.isinf(system.prescription.object_distance_mm):  # at even angles, for wide lenses
        paraxial_mm = system.efl_mm * np.tan(fields * np.arctan(system.last_height_mm / system.efl_mm))
    chief = HalfPupil(1, 1)
    real_mm = np.array([trace_pupil(system, height, [nm], chief)[0].chief_height_mm for height in paraxial_mm])
    if np.any(np.diff(real_mm) <= 0):
        raise LensError(system.prescription.name, "field",
                        f"folding back at an image height of {real_mm[np.argmin(np.diff(real_mm) > 0)]:.4g} mm",
                        "end the field earlier")
    heights_mm = PchipInterpolator(real_mm, paraxial_mm)(np.linspace(0, real_mm[-1], number))
    return np.concatenate([[0.0], heights_mm[1:-1], [system.last_height_mm]])


def _pool(prescription, heights, workers):
    """Processes that each have the system: so many, or one on each core, but none without a field height to trace."""
    wanted = thread_count() if workers is None else workers
    return ProcessPoolExecutor(min(wanted, heights), get_context("spawn"), initializer=_start_worker,
                               initargs=(prescription,))


_system = None


def _start_worker(prescription):
    """Give a process its system, once: it takes seconds to make."""
    global _system
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    _system = build_system(prescription)


def _at_heights(pool, function, heights_mm, arguments, tell):
    """`function(height_mm, *arguments)` at every height: list, in their order."""
    futures = [pool.submit(function, height, *arguments) for height in heights_mm]
    try:
        for done, future in enumerate(as_completed(futures), 1):
            future.result()
            tell(done / len(futures))
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    return [future.result() for future in futures]


def _columns_that_hold_the_light(pool, heights_mm, wavelengths_nm, samples, progress):
    """Finest pitch whose windows hold 99.5 % of the light everywhere, and `_columns` with it."""
    pitch_um = _surveyed_pitch_um(pool, heights_mm, wavelengths_nm, samples, progress)
    columns = _columns(pool, heights_mm, wavelengths_nm, pitch_um, samples, progress)
    while min(psf.sum(axis=(1, 2)).min() for *_, psf in columns) < ENERGY:  # the survey has missed the widest
        pitch_um = pitch_for_um(pitch_um * samples * WIDENING, samples)
        columns = _columns(pool, heights_mm, wavelengths_nm, pitch_um, samples, progress)
    return pitch_um, columns


def _surveyed_pitch_um(pool, heights_mm, wavelengths_nm, samples, progress):
    """Finest pitch that keeps 99.5 % of the light in the window, by some heights and wavelengths."""
    some_mm = np.unique(heights_mm[(np.array(SURVEY_FIELDS) * (heights_mm.size - 1)).round().astype(int)])
    some_nm = np.unique(wavelengths_nm[[0, wavelengths_nm.size // 2, -1]])
    widths_um = _at_heights(pool, _width_um, some_mm, (some_nm, samples),
                            lambda done: progress(SURVEY_SHARE * done, "Choosing the window"))
    return pitch_for_um(max(widths_um), samples)


def _columns(pool, heights_mm, wavelengths_nm, pitch_um, samples, progress):
    """What `_column` gives, at every height."""
    return _at_heights(pool, _column, heights_mm, (wavelengths_nm, pitch_um, samples),
                       lambda done: progress(SURVEY_SHARE + (1 - SURVEY_SHARE) * done, "Summing up PSFs"))


def _width_um(height_mm, wavelengths_nm, samples):
    """Side of the window that holds 99.5 % of the light at these wavelengths."""
    return max(needed_width_um(wavefront, samples)
               for wavefront in trace_wavefronts(_system, height_mm, wavelengths_nm))


def _column(height_mm, wavelengths_nm, pitch_um, samples):
    """Of one field height, over the wavelengths: chief-ray heights, illumination and PSFs."""
    real_mm, illumination, psfs = [], [], []
    for wavefront in trace_wavefronts(_system, height_mm, wavelengths_nm):
        psf, area = point_spread(wavefront, pitch_um, samples)
        if not area:
            raise LensError(_system.prescription.name, "field height", f"{height_mm:.4g} mm",
                            "no light gets through the apertures here: end the field earlier")
        real_mm.append(wavefront.chief_height_mm)
        illumination.append(area)
        psfs.append(psf)
    return np.array(real_mm), np.array(illumination), np.array(psfs)


def _lens(system, heights_mm, wavelengths_nm, pitch_um, columns):
    """The lens of its tables' columns."""
    prescription = system.prescription
    real_mm, area, psf = (np.stack([column[part] for column in columns], axis=1) for part in range(3))
    real_mm[:, 0] = 0.0  # where rounding leaves 1e-15
    energy = psf.sum(axis=(2, 3))
    reference = np.argmin(np.abs(wavelengths_nm - prescription.reference_wavelength_nm))
    last_mm = real_mm[reference, -1]
    return Lens(
        name=prescription.name, maker=prescription.maker, story=prescription.story, source=prescription.source,
        notes=prescription.notes, efl_mm=system.efl_mm, magnification=system.magnification,
        f_number_effective=0.5 / np.sqrt(area[reference, 0] / np.pi),
        object_distance_mm=prescription.object_distance_mm, entrance_pupil_mm=system.entrance_pupil_mm,
        sensor_mm=prescription.sensor_mm or four_by_three(last_mm),
        reference_wavelength_nm=prescription.reference_wavelength_nm, wavelengths_nm=wavelengths_nm,
        heights_mm=heights_mm, real_height_mm=real_mm, relative_illumination=area / area[:, :1],
        psf=psf / energy[..., None, None], psf_pitch_um=pitch_um, enclosed_energy=np.minimum(energy, 1),
        transmittance=system.transmittance(wavelengths_nm))
