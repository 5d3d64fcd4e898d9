"""From a prescription to lens data: field heights, the PSF window, and then a PSF per height and wavelength."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from threading import Event

import numpy as np

from ..lens.conventions import WAVELENGTHS_NM, four_by_three
from ..lens.radial_lens import RadialLens
from ..prescription.prescription import Prescription
from ..prescription.system import System
from ..rays.field_heights import image_radius_mm
from ..rays.focus import build_system
from ..rays.pupil import polynomial_weights
from ..rays.rays import HalfPupil, trace_pupil
from ..runtime.errors import LensError
from ..runtime.threads import thread_count
from .diffraction import point_spread
from .heights import adaptive_heights_mm
from .pupil_fit import fit_pupils
from .quality import QUALITIES, Quality
from .wavefront import Wavefronts, trace_wavefronts
from .window import needed_width_um, pitch_for_um

LEAST_SAMPLES, MOST_SAMPLES = 65, 129  # of a PSF along each side
CHIEF_STEP = 1e-3  # relative to the last height: step between chief rays, for the derivative of areas
SURVEY_SHARE = 0.2  # approximate share of the bake's time, for the progress bar


def bake(prescription: Prescription, *, quality: str | Quality = "standard", heights: int | None = None,
         wavelengths_nm: Sequence[float] | np.ndarray = WAVELENGTHS_NM, pitch_um: float | None = None,
         samples: int | None = None, workers: int | None = None,
         progress: Callable[[float, str], object] = lambda fraction, label: None) -> RadialLens:
    """Compute the lens data of a prescription.

    Parameters
    ----------
    prescription : Prescription
    quality : str or Quality
        The name of one of `QUALITIES`; or SKETCH, for pixels that are larger than the lens's PSFs.
    heights : int or None
        Number of field heights, from the axis to the end of the prescription's field, densest where PSFs change
        fastest; None for as many as the quality needs.
    wavelengths_nm : sequence of float
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
    RadialLens

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
    heights_mm, between = _heights(system, heights, wavelengths_nm, fineness)
    traced = trace_wavefronts(system, heights_mm, _traced_nm(wavelengths_nm, fineness.traced), fineness.pupil)
    area, flux = _illumination(system, heights_mm, traced, wavelengths_nm, fineness)
    reference_area = _reference_area(system, fineness)
    wavefronts = traced.at(wavelengths_nm)
    needed_um = needed_width_um(traced)
    samples = samples or _samples(needed_um, _sensor_mm(system), fineness)
    sample_um = pitch_um or pitch_for_um(needed_um, samples)
    psf, fringes = _psfs(traced, wavefronts, sample_um, samples, fineness, workers, progress)
    notes = _notes(system.prescription.notes, fringes / fineness.sums.fringes, between, fineness)
    return _lens(system, heights_mm, wavefronts, area, reference_area, flux, sample_um, psf, notes)


def _check_request(prescription, heights, wavelengths_nm, samples, pitch_um):
    if heights is not None and heights < 2:
        raise LensError(prescription.name, "heights", heights, "expected at least 2")
    if not wavelengths_nm.size or np.any(np.diff(wavelengths_nm) <= 0):
        raise LensError(prescription.name, "wavelengths", wavelengths_nm.tolist(), "expected ascending nanometres")
    if samples is not None and (samples < 3 or samples % 2 == 0):
        raise LensError(prescription.name, "samples", samples, "expected an odd number: the chief ray is at the centre")
    if pitch_um is not None and not (np.isfinite(pitch_um) and pitch_um > 0):
        raise LensError(prescription.name, "pitch", pitch_um, "expected a positive number of um")


def _sensor_mm(system):
    return system.prescription.sensor_mm or four_by_three(image_radius_mm(system))


def _samples(width_um, sensor_mm, quality: Quality):
    """Odd number of samples across a window, no larger than the pixels of a picture that fills the sensor."""
    number = int(np.ceil(width_um / (1e3 * sensor_mm[0] / quality.picture_px)))
    return min(max(number, LEAST_SAMPLES), MOST_SAMPLES) // 2 * 2 + 1


def _heights(system, number, wavelengths_nm, quality: Quality):
    """Heights in mm, as many as requested or needed, and the share of misplaced light between them."""
    middle = np.argmin(np.abs(wavelengths_nm - system.prescription.reference_wavelength_nm))
    survey_nm = np.unique([wavelengths_nm[0], wavelengths_nm[middle]])
    if number is None:
        return adaptive_heights_mm(system, survey_nm, quality.between, quality.most_heights)
    return adaptive_heights_mm(system, survey_nm, 0.0, number, least=1 + number // 2)


def _notes(notes, lengthening, between, quality: Quality):
    """The prescription's notes, plus a line for each limit of the bake's accuracy."""
    lines = [notes] if notes else []
    if lengthening > 1:
        lines.append(f"Diffraction is computed with wavelengths lengthened by a factor of up to {lengthening:.2g}.")
    if between > quality.between:
        lines.append(f"Halfway between two heights, {100 * between:.2g} % of the light is misplaced.")
    return "\n".join(lines)


def _traced_nm(wavelengths_nm, number):
    """Wavelengths to trace: all if they are few, otherwise Chebyshev extrema over the wave number."""
    if wavelengths_nm.size <= number:
        return wavelengths_nm
    first, last = 1 / wavelengths_nm[0], 1 / wavelengths_nm[-1]
    return 1 / (first + (last - first) * (1 - np.cos(np.pi * np.arange(number) / (number - 1))) / 2)


def _illumination(system, heights_mm, traced: Wavefronts, wavelengths_nm, quality: Quality):
    """Irradiance under uniform radiance, in sr: arrays (wavelength, height).

    Returns
    -------
    area
        Area in direction cosines of the bundle at the chief ray's image point.
    flux
        Light that an element of the object sends through the lens, over the element's image area by chief rays. The
        PSFs' coma then moves part of this light towards or away from the axis.
    """
    area, source_area = traced.areas(*quality.edges)
    dark = np.argwhere(area <= 0)
    if dark.size:
        raise LensError(system.prescription.name, "field height", f"{heights_mm[dark[0, 1]]:.4g} mm",
                        "no light passes the apertures here: reduce the field")
    flux = (source_area * _beam_per_image(system, heights_mm)
            * _image_per_real(system, heights_mm, traced.wavelengths_nm))
    return polynomial_weights(1e3 / traced.wavelengths_nm, 1e3 / wavelengths_nm) @ np.stack([area, flux])


def _reference_area(system, quality: Quality):
    """Area in direction cosines of the bundle on the axis at the reference wavelength, whatever wavelengths are baked:
    the lens's f-number."""
    axis = trace_wavefronts(system, [0.0], [system.prescription.reference_wavelength_nm], quality.pupil)
    return axis.areas(*quality.edges)[0][0, 0]


def _beam_per_image(system, heights_mm):
    """The object's area or solid angle over the paraxial image's area: the factor of the light that the source's
    coordinates do not include."""
    if system.object_at_infinity:
        return np.cos(np.arctan(heights_mm / system.efl_mm))**3 / system.efl_mm**2
    return np.full(len(heights_mm), 1 / system.magnification**2)


def _image_per_real(system, heights_mm, wavelengths_nm):
    """Area of the paraxial image over the area of the real, distorted image: array (wavelength, height)."""
    step_mm = CHIEF_STEP * heights_mm[-1]
    between = [np.clip(heights_mm + offset_mm, 0, heights_mm[-1]) for offset_mm in (-step_mm, step_mm)]
    before, here, behind = (trace_pupil(system, each, wavelengths_nm, HalfPupil(1, 1)).chief_height_mm for each in
                            (between[0], np.maximum(heights_mm, step_mm), between[1]))
    return (between[1] - between[0]) / (behind - before) * np.maximum(heights_mm, step_mm) / here


def _psfs(traced, wavefronts, pitch_um, samples, quality: Quality, workers, progress):
    """PSFs of all wavelengths and heights, as shares of all light: array (wavelength, height, v, u); and the number of
    the finest fringes in a sample."""
    wavelengths_nm, heights = wavefronts.wavelengths_nm, wavefronts.chief_height_mm.shape[1]
    psf, fringes = np.empty((wavelengths_nm.size, heights, samples, samples)), np.zeros(heights)
    stopped = Event()

    def compute(height):
        at_height = [traced.one(wavelength, height) for wavelength in range(traced.wavelengths_nm.size)]
        fits = fit_pupils(at_height, quality.sums.degree, wavelengths_nm)
        fringes[height] = fits[0].fringes(wavelengths_nm[0], pitch_um)
        for wavelength, fit in enumerate(fits):
            if stopped.is_set():
                return
            psf[wavelength, height] = point_spread(wavefronts.one(wavelength, height), pitch_um, samples, quality.sums,
                                                   fit)

    with ThreadPoolExecutor(workers or thread_count()) as pool:
        futures = [pool.submit(compute, height) for height in range(heights)]
        try:
            for count, future in enumerate(as_completed(futures), 1):
                future.result()
                progress(SURVEY_SHARE + (1 - SURVEY_SHARE) * count / len(futures), "Computing PSFs")
        except BaseException:
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return psf, fringes.max()


def _lens(system: System, heights_mm, wavefronts, area, reference_area, flux, pitch_um, psf, notes):
    """The `RadialLens` with the baked tables."""
    prescription, wavelengths_nm = system.prescription, wavefronts.wavelengths_nm
    real_mm = wavefronts.chief_height_mm.copy()
    real_mm[:, 0] = 0.0  # instead of rounding errors of 1e-15
    energy = psf.sum(axis=(2, 3))
    return RadialLens(
        name=prescription.name, maker=prescription.maker, story=prescription.story, source=prescription.source,
        notes=notes, efl_mm=system.efl_mm, magnification=system.magnification,
        f_number_effective=0.5 / np.sqrt(reference_area / np.pi),
        object_distance_mm=prescription.object_distance_mm, entrance_pupil_mm=system.entrance_pupil_mm,
        sensor_mm=_sensor_mm(system),
        reference_wavelength_nm=prescription.reference_wavelength_nm, wavelengths_nm=wavelengths_nm,
        heights_mm=heights_mm, real_height_mm=real_mm, relative_illumination=area / area[:, :1],
        psf=psf / energy[..., None, None], psf_pitch_um=pitch_um, enclosed_energy=np.minimum(energy, 1),
        transmittance=system.transmittance(wavelengths_nm),
        point_flux=flux / area * area[:, :1] / reference_area)
