"""From a prescription to lens data: field heights, the window of the PSFs, and then every height and wavelength."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from threading import Event

import numpy as np

from ..errors import LensError
from ..lens.lens import Lens
from ..lens.readers.assembly import four_by_three
from ..lens.sampling import WAVELENGTHS_NM
from ..threads import thread_count
from .diffraction import lengthening, point_spread
from .focus import build_system
from .heights import telling_heights_mm
from .prescription import Prescription
from .quality import QUALITIES, Quality
from .rays import HalfPupil, trace_pupil
from .system import System
from .wavefront import Wavefronts, polynomial_weights, trace_wavefronts
from .window import ENERGY, SETTLED, needed_width_um, pitch_for_um, width_um

MOST_WIDENED = 2.0  # of the survey's window: one place's faint flare is not worth coarser samples everywhere
LEAST_SAMPLES, MOST_SAMPLES = 65, 129  # of a PSF along each side
CHIEF_STEP = 1e-3  # of the last height: from chief ray to chief ray, whose distance tells how areas change
SURVEY_SHARE = 0.2  # of the time that a bake takes, roughly, for the progress bar


def bake(prescription: Prescription, *, quality: str = "standard", heights: int | None = None,
         wavelengths_nm: Sequence[float] | np.ndarray = WAVELENGTHS_NM, pitch_um: float | None = None,
         samples: int | None = None, workers: int | None = None,
         progress: Callable[[float, str], object] = lambda fraction, label: None) -> Lens:
    """Lens data of a prescription.

    Parameters
    ----------
    prescription : Prescription
    quality : str
        One of `QUALITIES`.
    heights : int or None
        Field heights, from the axis to the end of the prescription's field, closest where PSFs change fastest; None for
        as many as the quality needs.
    wavelengths_nm : sequence of float
    pitch_um : float or None
        Of the PSFs; None for the finest at which they hold 99.5 % of the light everywhere.
    samples : int or None
        Of each PSF along each side; odd. None for as many as show all that a picture of the quality's pixels can, but
        `LEAST_SAMPLES` to `MOST_SAMPLES`.
    workers : int or None
        Threads that share the work; None for one on each core.
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
    fineness = QUALITIES[quality]
    progress(0.0, "Tracing rays")
    system = build_system(prescription)
    heights_mm, between = _heights(system, heights, wavelengths_nm, fineness)
    traced = trace_wavefronts(system, heights_mm, _traced_nm(wavelengths_nm, fineness.traced), fineness.pupil)
    area, flux = _illumination(system, heights_mm, traced, wavelengths_nm, fineness)
    wavefronts = traced.at(wavelengths_nm)
    needed_um = needed_width_um(traced, fineness.sums)
    samples = samples or _samples(needed_um, _sensor_mm(system, traced.chief_height_mm.max()), fineness)
    told = pitch_um or pitch_for_um(needed_um, samples)
    psf = _psfs(wavefronts, told, samples, fineness, workers, progress)
    held, before = psf.sum(axis=(2, 3)).min(), 0.0
    while pitch_um is None and held < ENERGY and held - before > SETTLED:  # the survey has missed the widest
        worst = wavefronts.one(*np.unravel_index(psf.sum(axis=(2, 3)).argmin(), psf.shape[:2]))
        wider_um = max(width_um(worst, told * samples, fineness.sums), told * samples)
        told = pitch_for_um(min(wider_um, MOST_WIDENED * needed_um), samples)
        psf = _psfs(wavefronts, told, samples, fineness, workers, progress)
        held, before = psf.sum(axis=(2, 3)).min(), held
    notes = _notes(system.prescription.notes, wavefronts, between, told, fineness)
    return _lens(system, heights_mm, wavefronts, area, flux, told, psf, notes)


def focused(prescription: Prescription) -> Prescription:
    """The same lens with image plane, stop and picture as they come to be, for other object distances to keep."""
    system = build_system(prescription)
    return replace(system.prescription, field=("image_height_mm", system.last_height_mm))


def _check_request(prescription, heights, wavelengths_nm, samples, pitch_um):
    if heights is not None and heights < 2:
        raise LensError(prescription.name, "heights", heights, "expected at least 2")
    if not wavelengths_nm.size or np.any(np.diff(wavelengths_nm) <= 0):
        raise LensError(prescription.name, "wavelengths", wavelengths_nm.tolist(), "expected ascending nanometres")
    if samples is not None and (samples < 3 or samples % 2 == 0):
        raise LensError(prescription.name, "samples", samples, "expected an odd number: the chief ray has the middle")
    if pitch_um is not None and not (np.isfinite(pitch_um) and pitch_um > 0):
        raise LensError(prescription.name, "pitch", pitch_um, "expected a positive number of um")


def _sensor_mm(system, last_mm):
    return system.prescription.sensor_mm or four_by_three(last_mm)


def _samples(width_um, sensor_mm, quality: Quality):
    """An odd number over so wide a window, of samples no larger than the pixels of a picture that fills the sensor."""
    number = int(np.ceil(width_um / (1e3 * sensor_mm[0] / quality.picture_px)))
    return min(max(number, LEAST_SAMPLES), MOST_SAMPLES) // 2 * 2 + 1


def _heights(system, number, wavelengths_nm, quality: Quality):
    """In mm, as many as asked for or needed; and the share of light in the wrong place between them."""
    middle = np.argmin(np.abs(wavelengths_nm - system.prescription.reference_wavelength_nm))
    telling_nm = np.unique([wavelengths_nm[0], wavelengths_nm[middle]])
    if number is None:
        return telling_heights_mm(system, telling_nm, quality.between, quality.most_heights)
    return telling_heights_mm(system, telling_nm, 0.0, number, least=1 + number // 2)


def _notes(notes, wavefronts: Wavefronts, between, pitch_um, quality: Quality):
    """A lens's notes, and what else of its accuracy there is to know."""
    times = max(lengthening(wavefronts.one(0, height), pitch_um, quality.sums)
                for height in range(wavefronts.chief_height_mm.shape[1]))
    said = [notes] if notes else []
    if times > 1:
        said.append(f"Diffraction is that of waves up to {times:.2g} times as long.")
    if between > quality.between:
        said.append(f"Half way between two heights {100 * between:.2g} % of the light lie in the wrong place.")
    return "\n".join(said)


def _traced_nm(wavelengths_nm, number):
    """Wavelengths to trace: all of a few, or Chebyshev's extrema over the wave numbers of many."""
    if wavelengths_nm.size <= number:
        return wavelengths_nm
    first, last = 1 / wavelengths_nm[0], 1 / wavelengths_nm[-1]
    return 1 / (first + (last - first) * (1 - np.cos(np.pi * np.arange(number) / (number - 1))) / 2)


def _illumination(system, heights_mm, traced: Wavefronts, wavelengths_nm, quality: Quality):
    """Irradiance of even radiance, in sr: arrays (wavelength, height).

    Returns
    -------
    area
        Where the chief ray lands: the area of its bundle in direction cosines.
    flux
        All light that a part of the object sends through the lens, over the area that chief rays make of it. PSFs then
        bring a part of that nearer to the axis, or farther from it, by their coma.
    """
    area, source_area = traced.areas(*quality.edges)
    dark = np.argwhere(area <= 0)
    if dark.size:
        raise LensError(system.prescription.name, "field height", f"{heights_mm[dark[0, 1]]:.4g} mm",
                        "no light gets through the apertures here: end the field earlier")
    flux = (source_area * _beam_per_image(system, heights_mm)
            * _image_per_real(system, heights_mm, traced.wavelengths_nm))
    return polynomial_weights(1e3 / traced.wavelengths_nm, 1e3 / wavelengths_nm) @ np.stack([area, flux])


def _beam_per_image(system, heights_mm):
    """What the source's coordinates leave out of the light: the object's area, or solid angle, over the paraxial
    image's."""
    if system.object_at_infinity:
        return np.cos(np.arctan(heights_mm / system.efl_mm))**3 / system.efl_mm**2
    return np.full(len(heights_mm), 1 / system.magnification**2)


def _image_per_real(system, heights_mm, wavelengths_nm):
    """Area of the paraxial image over that of the real one, which chief rays squeeze: array (wavelength, height)."""
    step_mm = CHIEF_STEP * heights_mm[-1]
    between = [np.clip(heights_mm + beside, 0, heights_mm[-1]) for beside in (-step_mm, step_mm)]
    before, here, behind = (trace_pupil(system, each, wavelengths_nm, HalfPupil(1, 1)).chief_height_mm for each in
                            (between[0], np.maximum(heights_mm, step_mm), between[1]))
    return (between[1] - between[0]) / (behind - before) * np.maximum(heights_mm, step_mm) / here


def _psfs(wavefronts, pitch_um, samples, quality, workers, progress):
    """Of all wavelengths and heights, in shares of all light: array (wavelength, height, v, u)."""
    psf = np.empty((*wavefronts.chief_height_mm.shape, samples, samples))
    stopped = Event()

    def sum_up(height):
        for wavelength in range(len(psf)):
            if stopped.is_set():
                return
            psf[wavelength, height] = point_spread(wavefronts.one(wavelength, height), pitch_um, samples, quality.sums)

    with ThreadPoolExecutor(workers or thread_count()) as pool:
        futures = [pool.submit(sum_up, height) for height in range(psf.shape[1])]
        try:
            for done, future in enumerate(as_completed(futures), 1):
                future.result()
                progress(SURVEY_SHARE + (1 - SURVEY_SHARE) * done / len(futures), "Summing up PSFs")
        except BaseException:
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return psf


def _lens(system: System, heights_mm, wavefronts, area, flux, pitch_um, psf, notes):
    """The lens of its tables."""
    prescription, wavelengths_nm = system.prescription, wavefronts.wavelengths_nm
    real_mm = wavefronts.chief_height_mm.copy()
    real_mm[:, 0] = 0.0  # where rounding leaves 1e-15
    energy = psf.sum(axis=(2, 3))
    reference = np.argmin(np.abs(wavelengths_nm - prescription.reference_wavelength_nm))
    return Lens(
        name=prescription.name, maker=prescription.maker, story=prescription.story, source=prescription.source,
        notes=notes, efl_mm=system.efl_mm, magnification=system.magnification,
        f_number_effective=0.5 / np.sqrt(area[reference, 0] / np.pi),
        object_distance_mm=prescription.object_distance_mm, entrance_pupil_mm=system.entrance_pupil_mm,
        sensor_mm=_sensor_mm(system, real_mm[reference, -1]),
        reference_wavelength_nm=prescription.reference_wavelength_nm, wavelengths_nm=wavelengths_nm,
        heights_mm=heights_mm, real_height_mm=real_mm, relative_illumination=area / area[:, :1],
        psf=psf / energy[..., None, None], psf_pitch_um=pitch_um, enclosed_energy=np.minimum(energy, 1),
        transmittance=system.transmittance(wavelengths_nm),
        point_flux=flux / area * area[:, :1] / area[reference, 0])
