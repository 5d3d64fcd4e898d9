"""simulate(): spectral radiance through a lens to spectral irradiance, wavelength by wavelength."""

from dataclasses import replace

import numpy as np

from .errors import ImageError
from .image.nonfinite import clamp_fireflies, refuse_fireflies
from .image.pixel_grid import lay_out
from .image.spectral_image import IRRADIANCE, PLANE, RADIANCE, pixel_axes_mm
from .kept import Kept
from .plan.options import Options
from .report import Report


def simulate(radiance, lens, options=Options(), *, progress=None, report=None, kept=None, out=None):
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
    kept : Kept, optional
        Keeps what the frames of an animation share.
    out : float32 array (wavelength, row, column) of the frame, optional
        Where to put the irradiance. It may be part of `radiance.cube`: wavelengths are done one after another.

    Returns
    -------
    SpectralImage
        Irradiance of the sensor's frame, W m^-2 nm^-1, without overscan.

    Raises
    ------
    LensError, ImageError
        A wavelength outside the lens data; a distortion that folds the field; pixels that are not finite.
    """
    report, kept = report or Report(), kept or Kept(limit_mb=0)
    if radiance.quantity != RADIANCE:
        raise ImageError("image", "quantity", radiance.quantity, f"a lens takes {RADIANCE}")
    if options.fireflies == "refuse":
        refuse_fireflies(radiance)
    with report.stage("plan"):
        plan = kept.plan(options, lens, radiance)
    grid, frame = lay_out(radiance, plan.psf_radius_px)
    irradiance = np.empty((radiance.wavelengths_nm.size, *radiance.frame_px), np.float32) if out is None else out
    tally = _Tally(radiance)
    channels = kept.channels(lens, radiance.wavelengths_nm, grid, plan)
    for index in range(radiance.wavelengths_nm.size):
        plane, clamped = radiance.cube[index], 0
        if options.fireflies == "clamp":
            plane, clamped = clamp_fireflies(plane)
        with report.stage("lens data"):
            channel = next(channels)
        with report.stage("distortion and relative illumination"):
            ideal = channel.ideal_irradiance(plane)
        light = channel.light(ideal)
        with report.stage("filtering"):
            canvas = channel.blur(ideal)
        irradiance[index] = canvas[frame]
        tally.add(channel.field, light, canvas, irradiance[index], clamped)
        if progress:
            progress((index + 1) / radiance.wavelengths_nm.size)
    report.facts |= {"lens": lens.name, "plan": plan.as_dict(), "pitch_um": radiance.pitch_um,
                     "frame_px": list(radiance.frame_px), "overscan_px": list(radiance.overscan_px)} | tally.facts()
    return replace(radiance.frame(), cube=irradiance, quantity=IRRADIANCE, projection=PLANE, lens_name=lens.name,
                   f_number_effective=lens.f_number_effective)


class _Tally:
    """Light and fits, wavelength by wavelength, for the report."""

    def __init__(self, radiance):
        frame = radiance.frame()
        self._x_mm, self._y_mm = pixel_axes_mm(frame.cube.shape[1:], frame.centre_px, frame.pitch_um)
        self._pixel_m2 = (radiance.pitch_um * 1e-6) ** 2
        self._wavelengths_nm = radiance.wavelengths_nm
        self._fits, self._clamped, self._out_of_field = [], 0, 0.0
        self._flux = np.zeros(3)

    def add(self, field, light, canvas, frame, clamped):
        self._flux += light, canvas.sum(dtype=np.float64), frame.sum(dtype=np.float64)
        self._clamped += clamped
        self._out_of_field = max(self._out_of_field, self._beyond(field.last_real_mm))
        self._fits.append({name: {"order": fit.order, residual: fit.residual, "highest_order_tried": fit.highest_order}
                           for name, fit, residual in (
                               ("distortion_fit", field.distortion, "residual_mm"),
                               ("relative_illumination_fit", field.illumination, "residual"))})

    def _beyond(self, last_real_mm):
        """The fraction of the frame that lies farther from the axis than the lens data."""
        half_mm = np.sqrt(np.maximum(last_real_mm**2 - self._y_mm**2, 0))
        inside = np.searchsorted(self._x_mm, half_mm, side="right") - np.searchsorted(self._x_mm, -half_mm)
        return 1 - float(inside[np.abs(self._y_mm) <= last_real_mm].sum()) / (self._x_mm.size * self._y_mm.size)

    def facts(self):
        """Spectral flux, summed over the wavelengths, before and after the blur and inside the frame; and the rest."""
        flux = (self._flux * self._pixel_m2).tolist()
        fits = [{"wavelength_nm": float(nm)} | fit for nm, fit in zip(self._wavelengths_nm, self._fits)]
        return {"wavelengths": fits,
                "energy": dict(zip(("in_w_per_nm", "out_w_per_nm", "in_frame_w_per_nm"), flux)),
                "out_of_field_fraction": self._out_of_field, "fireflies_clamped": self._clamped}
