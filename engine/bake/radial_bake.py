"""Lens data of rotationally symmetric lenses: tables over heights."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..lens.radial_lens import RadialLens
from ..prescription.system import System
from ..rays.light_end import LightEnd, light_end
from ..rays.pupil import polynomial_weights
from ..rays.rays import HalfPupil, trace_pupil
from ..rays.transmission import transmittance
from ..runtime.errors import LensError
from .heights import adaptive_heights_mm
from .psfs import in_threads, psfs_of
from .quality import Quality
from .sampling import limit_notes, picture_samples, sensor_mm, traced_nm
from .wavefront import Wavefronts, trace_wavefronts
from .window import needed_width_um, pitch_for_um

CHIEF_STEP = 1e-3  # relative to the last field: step between chief rays, for the derivative of areas
LAST_LIT = 0.9995  # of the field at the end of the light: the last height with a PSF
HALFWAY = "Halfway between two heights"


def bake_radial(system: System, quality: Quality, heights: int | None, wavelengths_nm: np.ndarray,
                pitch_um: float | None, samples: int | None, workers: int | None,
                progress: Callable[[float, str], object]) -> RadialLens:
    """Compute the lens data of a rotationally symmetric lens; parameters as of `bake`."""
    end = _end(system, wavelengths_nm)
    heights_mm, between = _heights(system, end, heights, wavelengths_nm, quality)
    traced = trace_wavefronts(system, heights_mm, traced_nm(wavelengths_nm, quality.traced), quality.pupil)
    area, flux = _illumination(system, heights_mm, traced, wavelengths_nm, quality)
    reference_area = _reference_area(system, quality)
    wavefronts = traced.at(wavelengths_nm)
    needed_um = needed_width_um(traced)
    samples = samples or picture_samples(needed_um, sensor_mm(system), quality)
    sample_um = pitch_um or pitch_for_um(needed_um, samples)
    psf, fringes = _psfs(traced, wavefronts, sample_um, samples, quality, workers, progress)
    notes = limit_notes(system.prescription.notes, fringes, HALFWAY, between, quality)
    lens = _lens(system, heights_mm, wavefronts, area, reference_area, flux, sample_um, psf, notes)
    return _with_darkness(lens, system, end.height_mm) if end.dark else lens


def _end(system, wavelengths_nm) -> LightEnd:
    ends_nm = wavelengths_nm[np.unique([0, wavelengths_nm.size - 1])]
    return light_end(system, tuple(ends_nm.tolist()))


def _heights(system, end: LightEnd, number, wavelengths_nm, quality: Quality):
    """Heights in mm, as many as requested or needed, and the share of misplaced light between them."""
    middle = np.argmin(np.abs(wavelengths_nm - system.prescription.reference_wavelength_nm))
    survey_nm = np.unique([wavelengths_nm[0], wavelengths_nm[middle]])
    last_mm = end.height_mm
    if end.dark:
        last_mm, = system.heights_of(LAST_LIT * system.fields_of([end.height_mm]))
    if number is None:
        return adaptive_heights_mm(system, survey_nm, quality.between, quality.most_heights, last_mm=last_mm)
    number -= end.dark
    return adaptive_heights_mm(system, survey_nm, 0.0, number, least=1 + number // 2, last_mm=last_mm)


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
    fields = system.fields_of(heights_mm)
    step, ends = CHIEF_STEP * fields[-1], np.sort([0.0, fields[-1]])
    before, behind = (np.clip(fields + offset, *ends) for offset in (-step, step))
    here_mm = np.maximum(heights_mm, system.heights_of(step))
    before_mm, real_mm, behind_mm = (
        trace_pupil(system, each, wavelengths_nm, HalfPupil(1, 1)).chief_height_mm
        for each in (system.heights_of(before), here_mm, system.heights_of(behind)))
    return system.height_slopes(fields) * (behind - before) / (behind_mm - before_mm) * here_mm / real_mm


def _psfs(traced, wavefronts, pitch_um, samples, quality: Quality, workers, progress):
    """PSFs of all wavelengths and heights, as shares of all light: array (wavelength, height, v, u); and the number of
    the finest fringes in a sample."""
    wavelengths, heights = wavefronts.chief_height_mm.shape
    psf, fringes = np.empty((wavelengths, heights, samples, samples)), np.zeros(heights)

    def compute(height, stopped):
        psf[:, height], fringes[height] = psfs_of(traced, wavefronts, height, pitch_um, samples, quality, stopped)

    in_threads(compute, heights, workers, progress)
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
        f_number_effective=0.5 / np.sqrt(reference_area / np.pi), central_obstruction=system.central_obstruction,
        object_distance_mm=prescription.object_distance_mm, entrance_pupil_mm=system.entrance_pupil_mm,
        sensor_mm=sensor_mm(system),
        reference_wavelength_nm=prescription.reference_wavelength_nm, wavelengths_nm=wavelengths_nm,
        heights_mm=heights_mm, real_height_mm=real_mm, relative_illumination=area / area[:, :1],
        psf=psf / energy[..., None, None], psf_pitch_um=pitch_um, enclosed_energy=np.minimum(energy, 1),
        transmittance=transmittance(system, wavelengths_nm),
        point_flux=flux / area * area[:, :1] / reference_area)


def _with_darkness(lens: RadialLens, system: System, height_mm: float) -> RadialLens:
    """The lens with one more height, from which on it is dark, and with the last PSFs there."""
    chief = trace_pupil(system, [height_mm], lens.wavelengths_nm, HalfPupil(1, 1))

    def longer(table):
        return np.concatenate([table, table[:, -1:]], axis=1)

    return replace(lens, heights_mm=np.append(lens.heights_mm, height_mm),
                   real_height_mm=np.concatenate([lens.real_height_mm, chief.chief_height_mm], axis=1),
                   relative_illumination=np.pad(lens.relative_illumination, [(0, 0), (0, 1)]),
                   point_flux=longer(lens.point_flux), psf=longer(lens.psf),
                   enclosed_energy=longer(lens.enclosed_energy))
