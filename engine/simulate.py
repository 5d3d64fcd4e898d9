"""simulate(): spectral radiance through a lens to spectral irradiance, wavelength by wavelength."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from . import kernels
from .depth.cast import CastPlane, cast
from .depth.pencils import Iris
from .errors import ImageError
from .image.layers import LayeredRadiance, light_of
from .image.nonfinite import clamp_fireflies, clamp_layers, refuse_fireflies
from .image.pixel_grid import PLANE
from .image.spectral_image import IRRADIANCE, RADIANCE, SpectralImage
from .image.supersampling import merge_pixels, split_pixels
from .kept import Kept
from .lens import Lens
from .plan.options import Options
from .report import DistortionFit, Energy, IlluminationFit, LensImageFacts, Report, WavelengthFacts
from .scratch import beside

BY_RESULT = Options()


def simulate(radiance: SpectralImage | LayeredRadiance, lens: Lens, options: Options = BY_RESULT, *,
             iris: Iris | None = None, progress: Callable[[float], None] | None = None, report: Report | None = None,
             kept: Kept | None = None, out: np.ndarray | None = None) -> SpectralImage:
    """Spectral irradiance that the lens lays on the sensor.

    Parameters
    ----------
    radiance : SpectralImage or LayeredRadiance
        Scene radiance, W m^-2 sr^-1 nm^-1, as an ideal lens would image it; with overscan, so that light from
        beyond the frame comes in where distortion and blur bring it in. All of it is taken to be in focus; but of
        layers what is not is seen along the lens's rays, through what hides it.
    lens : Lens
    options : Options
    iris : Iris, optional
        The shape of the stop, for what is out of focus; a circle by default.
    progress : callable (fraction), optional
        Called after each wavelength; of layers as they are cast, before these are filtered.
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
    seen = _seen(radiance, lens, options, iris, report, progress or (lambda fraction: None))
    source = light_of(radiance)
    with report.stage("plan"):
        plan = kept.plan(options, lens, radiance, out is not None and np.may_share_memory(out, source))
    if isinstance(radiance, LayeredRadiance):
        radiance = radiance.dark()  # of which the grid and the wavelengths are all that counts from here on
    shape = (radiance.wavelengths_nm.size, *radiance.frame_px)
    irradiance = beside(source, shape) if out is None else out
    if irradiance.shape != shape or irradiance.dtype != np.float32:
        raise ImageError("out", "array", f"{irradiance.dtype} of {irradiance.shape}", f"expected float32 of {shape}")
    fine, tally = plan.supersampling, _Tally(radiance, plan.supersampling)
    frame_px = radiance.grid.finer(fine).frame_px
    channels = kept.channels(lens, radiance, plan)
    for index, (view, clamped) in enumerate(seen):
        tally.see(view.sharp)
        with report.stage("lens data"):
            channel = next(channels)
        with report.stage("distortion and relative illumination"):
            ideal = channel.ideal_irradiance(split_pixels(view.sharp, fine))
            out_of_focus = None
            if view.blurred is not None and view.clear is not None:
                channel.veil(ideal, split_pixels(view.clear, fine))
                out_of_focus = channel.behind_glass(view.blurred * view.per_radiance, radiance.grid.frame())
        light = channel.planes.light(ideal)
        with report.stage("filtering"):
            blurred = channel.blur(ideal)
        irradiance[index] = merge_pixels(_frame(blurred, frame_px), fine)
        if out_of_focus is not None:
            irradiance[index] += out_of_focus
        tally.add(channel.field, light, blurred, irradiance[index], out_of_focus, clamped)
        del view, channel, ideal, blurred, out_of_focus  # before the next wavelength's come
    report.lens_image = tally.facts(lens, plan)
    sensor = replace(radiance.grid.frame(), projection=PLANE, focal_mm=None)
    return replace(radiance.frame(), cube=irradiance, grid=sensor, quantity=IRRADIANCE,
                   lens_name=lens.name, f_number_effective=lens.f_number_effective, focal_mm=None)


def _seen(radiance, lens, options, iris, report, progress) -> Iterator[tuple[CastPlane, int]]:
    """What is seen at each wavelength, and how many fireflies of it are clamped; those of layers all with the first.
    It tells the progress: of layers that of casting, which takes longest."""
    if isinstance(radiance, SpectralImage) and radiance.quantity != RADIANCE:
        raise ImageError("image", "quantity", radiance.quantity, f"a lens takes {RADIANCE}")
    if options.fireflies == "refuse":
        refuse_fireflies(radiance)
    if isinstance(radiance, LayeredRadiance):
        return _in_depth(radiance, lens, options, iris, report, progress)
    return _in_focus(radiance, options, progress)


def _in_focus(radiance, options, progress):
    for done, plane in enumerate(radiance.cube, 1):
        plane, clamped = clamp_fireflies(plane) if options.fireflies == "clamp" else (plane, 0)
        yield CastPlane(plane), clamped
        progress(done / len(radiance.cube))


def _in_depth(layered, lens, options, iris, report, progress):
    from .library.rays import lens_rays  # pictures without layers do without how lenses are baked

    layered, clamped = clamp_layers(layered) if options.fireflies == "clamp" else (layered, 0)
    with report.stage("rays"):
        views = cast(layered, lens, lens_rays(lens), most_rays=options.most_rays,
                     most_of_lamps=options.most_of_lamps, iris=iris, progress=progress)
    for _ in layered.wavelengths_nm:
        with report.stage("casting"):
            view = next(views)
        yield view, clamped
        del view  # which all of a group are part of
        clamped = 0


def _frame(blurred, frame_px):
    """The frame of a picture that has the same margin on opposite sides."""
    return blurred[tuple(slice((there - n) // 2, (there + n) // 2)
                         for there, n in zip(blurred.shape, frame_px, strict=True))]


class _Tally:
    """Light and fits, wavelength by wavelength, for the report."""

    def __init__(self, radiance, supersampling):
        self._radiance, self._parts = radiance, supersampling**2  # of a pixel
        self._x_mm, self._y_mm = radiance.grid.frame().axes_mm()
        self._fits, self._clamped, self._out_of_field = [], 0, 0.0
        self._flux = np.zeros(3)
        self._negative, self._light, self._brightest = 0.0, 0.0, 0.0

    def see(self, plane):
        """What a plane of radiance holds."""
        self._negative -= np.minimum(plane, 0).sum(dtype=np.float64)
        self._light += plane.sum(dtype=np.float64)
        self._brightest = max(self._brightest, float(plane.max()))

    def add(self, field, light, blurred, frame, out_of_focus, clamped):
        """What is out of focus counts as far as it falls into the frame."""
        beside = 0.0 if out_of_focus is None else out_of_focus.sum(dtype=np.float64)
        self._flux += (light / self._parts + beside, blurred.sum(dtype=np.float64) / self._parts + beside,
                       frame.sum(dtype=np.float64))
        self._clamped += clamped
        self._out_of_field = max(self._out_of_field, self._beyond(field.last_real_mm))
        self._fits.append([kind(fit.order, fit.residual, fit.highest_order) for kind, fit in (
            (DistortionFit, field.distortion), (IlluminationFit, field.illumination))])

    def _beyond(self, last_real_mm):
        """The fraction of the frame that lies farther from the axis than the lens data."""
        half_mm = np.sqrt(np.maximum(last_real_mm**2 - self._y_mm**2, 0))
        inside = np.searchsorted(self._x_mm, half_mm, side="right") - np.searchsorted(self._x_mm, -half_mm)
        return 1 - float(inside[np.abs(self._y_mm) <= last_real_mm].sum()) / (self._x_mm.size * self._y_mm.size)

    def facts(self, lens, plan):
        radiance = self._radiance
        flux = self._flux * (radiance.pitch_um * 1e-6) ** 2
        fits = tuple(WavelengthFacts(float(nm), *fits)
                     for nm, fits in zip(radiance.wavelengths_nm, self._fits, strict=True))
        return LensImageFacts(lens.name, plan, radiance.pitch_um, radiance.frame_px, radiance.overscan_px, fits,
                              Energy(*flux.tolist()), self._out_of_field, self._clamped, kernels.running(),
                              self._negative / max(self._light + self._negative, np.finfo(float).tiny),
                              self._brightest)
