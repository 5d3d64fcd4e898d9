"""simulate(): spectral radiance through a lens to spectral irradiance, wavelength by wavelength."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from .errors import ImageError
from .folding import fold, unfold
from .geometry import FieldGeometry, distort
from .ideal import ideal_irradiance
from .plan import Options, make_plan
from .psf import PsfBank
from .reference import filter_exactly
from .report import Report
from .sections import filter_sections
from .spectral_image import IRRADIANCE, RADIANCE, pixel_axes_mm, pixel_position_mm

BAND_PIXELS = 1 << 17


def simulate(radiance, lens, options=Options(), *, progress=None, report=None):
    """Spectral irradiance that the lens lays on the sensor.

    Parameters
    ----------
    radiance : SpectralImage
        Scene radiance, W m^-2 sr^-1 nm^-1, as an ideal lens would image it; with overscan, so that light from
        beyond the frame comes in where distortion and blur bring it in.
    lens : Lens
    options : Options
    progress : callable (fraction), optional
        Called after each wavelength.
    report : Report, optional
        Gathers stage times, the plan, the fits and the energy.

    Returns
    -------
    SpectralImage
        Irradiance of the sensor's frame, W m^-2 nm^-1, without overscan.

    Raises
    ------
    LensError, ImageError
        A wavelength outside the lens data; a distortion that folds the field; pixels that are not finite.
    """
    report = report or Report()
    _check(radiance)
    plan = make_plan(options, lens, radiance.pitch_um, radiance.frame_px)
    # Light from just outside the frame is blurred into it: the frame is filtered with a margin of one PSF radius.
    margin = tuple(min(overscan, plan.psf_radius_px) for overscan in radiance.overscan_px)
    target = radiance.cropped(tuple(o - m for o, m in zip(radiance.overscan_px, margin)))
    frame = target.frame()
    irradiance = np.empty(frame.cube.shape, dtype=np.float32)
    tally = _Tally()
    for index, wavelength_nm in enumerate(radiance.wavelengths_nm):
        with report.stage("lens data"):
            optics = lens.at_wavelength(wavelength_nm)
            field = FieldGeometry(optics, lens.name)
            bank = PsfBank(optics, radiance.pitch_um)
        with report.stage("distortion and relative illumination"):
            ideal, beyond = _ideal_plane(radiance, index, target, optics, field, lens, plan)
        with report.stage("filtering"):
            canvas = _filter(ideal, target, plan, bank, field, report)
        irradiance[index] = _inside(canvas, [m + plan.psf_radius_px for m in margin], frame)
        tally.add(wavelength_nm, field, ideal, canvas, irradiance[index], _inside(beyond, margin, frame))
        if progress:
            progress((index + 1) / radiance.wavelengths_nm.size)
    report.facts |= {"lens": lens.name, "plan": plan.as_dict(), "pitch_um": radiance.pitch_um,
                     "frame_px": list(radiance.frame_px), "overscan_px": list(radiance.overscan_px),
                     "wavelengths": tally.wavelengths, "energy": tally.energy(radiance.pitch_um),
                     "out_of_field_fraction": tally.out_of_field_fraction}
    return replace(frame, cube=irradiance, quantity=IRRADIANCE, lens_name=lens.name,
                   f_number_effective=lens.f_number_effective)


def _ideal_plane(radiance, index, target, optics, field, lens, plan):
    """Ideal irradiance of one wavelength where the lens puts it, and which of its pixels are out of field.

    Bands of rows small enough for the processor's cache are worked on side by side.
    """
    x_mm, y_mm = pixel_axes_mm(target.cube.shape[1:], target.centre_px, target.pitch_um)
    ideal = np.empty(target.cube.shape[1:])
    beyond = np.empty(ideal.shape, dtype=bool)
    framed = np.pad(radiance.cube[index], 1)
    centre_px = radiance.centre_px[0] + 1, radiance.centre_px[1] + 1

    def work(rows):
        distorted, height_mm = distort(framed, centre_px, x_mm, y_mm[rows], radiance.pitch_um, field)
        beyond[rows] = height_mm > lens.heights_mm[-1]
        if plan.out_of_field == "vignette":
            distorted[beyond[rows]] = 0
        ideal[rows] = ideal_irradiance(distorted, field.relative_illumination(height_mm), optics.transmittance,
                                       lens.f_number_effective)

    step = max(1, BAND_PIXELS // x_mm.size)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, (slice(top, top + step) for top in range(0, y_mm.size, step))))
    return ideal, beyond


def _filter(ideal, target, plan, bank, field, report):
    """Blur a plane; folded onto one quadrant where lens and frame are symmetric about the axis."""

    def psfs_about(centre_px):
        return _psf_lookup(bank, field, target.pitch_um, centre_px, report)

    if plan.method == "exact":
        return filter_exactly(ideal, plan.psf_radius_px, psfs_about(target.centre_px))
    sizes = plan.section_size, plan.order, plan.space_px, plan.psf_radius_px
    middle = tuple((n - 1) / 2 for n in ideal.shape)
    if bank.mirror_symmetric and np.allclose(target.centre_px, middle, rtol=0, atol=1e-9):
        quadrants = fold(ideal)
        axis = tuple(0.0 if n % 2 else -0.5 for n in ideal.shape)
        canvas = unfold(filter_sections(quadrants, *sizes, psfs_about(axis)), ideal.shape, plan.psf_radius_px)
    else:
        canvas = filter_sections(ideal[None], *sizes, psfs_about(target.centre_px))[0]
    if plan.order <= 2 and ideal.min() >= 0:
        np.maximum(canvas, 0, out=canvas)  # no weight is negative: what falls below zero is the FFT's rounding
    return canvas


def _inside(plane, margin_px, frame):
    """The part of a plane that is the frame, which lies `margin_px` (rows, columns) inside it."""
    top, left = margin_px
    rows, columns = frame.cube.shape[1:]
    return plane[top:top + rows, left:left + columns]


def _psf_lookup(bank, field, pitch_um, centre_px, report):
    """PSFs for source pixels of a grid with its axis at centre_px, looked up by the height their light came from."""

    def psfs(rows, columns):
        with report.stage("point spread functions"):
            x_mm, y_mm = pixel_position_mm(rows, columns, centre_px, pitch_um)
            height_mm = field.paraxial_height_mm(np.hypot(x_mm, y_mm))
            return bank.psfs(height_mm, np.arctan2(y_mm, x_mm))

    return psfs


def _check(radiance):
    if radiance.quantity != RADIANCE:
        raise ImageError("image", "quantity", radiance.quantity, f"a lens takes {RADIANCE}")
    finite = np.isfinite(radiance.cube)
    if not finite.all():
        plane, row, column = np.argwhere(~finite)[0]
        raise ImageError("image", f"pixel at row {row}, column {column}, {radiance.wavelengths_nm[plane]:g} nm",
                         str(radiance.cube[plane, row, column]),
                         f"every value must be finite; {np.count_nonzero(~finite)} of {finite.size} are not")


class _Tally:
    """Light and fits, wavelength by wavelength, for the report."""

    def __init__(self):
        self.wavelengths = []
        self.out_of_field_fraction = 0.0
        self._sums = np.zeros(3)

    def add(self, wavelength_nm, field, ideal, canvas, frame, beyond):
        self._sums += ideal.sum(), canvas.sum(), frame.sum(dtype=np.float64)
        self.out_of_field_fraction = max(self.out_of_field_fraction, float(beyond.mean()))
        self.wavelengths.append({
            "wavelength_nm": float(wavelength_nm),
            "distortion_fit": {"order": field.distortion.order, "residual_mm": field.distortion.residual},
            "relative_illumination_fit": {"order": field.illumination.order,
                                          "residual": field.illumination.residual}})

    def energy(self, pitch_um):
        """Spectral flux, summed over the wavelengths, before and after the blur and inside the frame."""
        flux = self._sums * (pitch_um * 1e-6) ** 2
        return dict(zip(("in_w_per_nm", "out_w_per_nm", "in_frame_w_per_nm"), flux.tolist()))
