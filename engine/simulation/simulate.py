"""simulate(): spectral radiance through a lens to spectral irradiance, wavelength by wavelength."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from ..depth.capture_planes import capture_planes
from ..depth.jumps import without_jumps
from ..image.layers import Radiance
from ..image.projection import PLANE
from ..image.sharpening import sharpening_gain
from ..image.spectral_image import IRRADIANCE, SpectralImage
from ..image.supersampling import merge_pixels, softening_px, split_pixels
from ..kernels.gpu import problems
from ..kernels.library import caster, on_processor, running
from ..lens import Lens
from ..lens.iris import Iris
from ..library.rays import Rays, lens_rays
from ..plan.options import OFF, Options
from ..runtime.errors import ImageError
from ..runtime.scratch import zeros_stored_like
from .channel_cache import ChannelCache
from .report import Report
from .report_parts import DistortionFit, Energy, IlluminationFit, LensImageFacts, WavelengthFacts

BY_RESULT = Options()


def simulate(radiance: Radiance, lens: Lens, options: Options = BY_RESULT, *,
             iris: Iris | None = None, progress: Callable[[float], None] | None = None, report: Report | None = None,
             cache: ChannelCache | None = None, out: np.ndarray | None = None,
             rays: Rays = lens_rays) -> SpectralImage:
    """Compute the spectral irradiance on the sensor behind a lens.

    Parameters
    ----------
    radiance : SpectralImage or LayeredRadiance
        Scene radiance, W m^-2 sr^-1 nm^-1, as an ideal lens would image it, with overscan for the light that
        distortion and blur bring into the frame. All of a SpectralImage counts as in focus. The out-of-focus light of
        layers is gathered along the lens's rays, with occlusion by nearer layers. With a detail, the lens image is
        computed in finer pixels, sharpened by as much as these soften it, and merged, if `options.detail` allows it.
    lens : Lens
    options : Options
    iris : Iris, optional
        The shape of the stop, for out-of-focus light; by default a circle of the same area.
    progress : callable (fraction), optional
        Called after each wavelength; for layers while they are cast, before they are filtered.
    report : Report, optional
        Collects stage times, the plan, the fits and the energy.
    cache : ChannelCache, optional
        Caches the data that frames of an animation share.
    out : float32 array (wavelength, row, column) of the frame, optional
        Array for the irradiance. It may be part of `radiance.cube`, because wavelengths are processed in order.
    rays : callable (lens, reach) -> LensRays
        Traces the lens's rays for out-of-focus light; `sketched_rays` for coarse pixels.

    Returns
    -------
    SpectralImage
        Irradiance of the sensor's frame, W m^-2 nm^-1, without overscan.

    Raises
    ------
    LensError, ImageError
        If a wavelength is outside the lens data, the distortion folds the field, or pixels are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Options, SpectralImage, load_lens, simulate
    >>> points = np.zeros((24, 32))
    >>> points[12, 16] = 1
    >>> radiance = SpectralImage(points, wavelengths_nm=[550], pitch_um=6)
    >>> irradiance = simulate(radiance, load_lens("edmund-54852"), Options(accuracy=0.1))
    >>> irradiance.cube.shape, irradiance.quantity
    ((1, 24, 32), 'irradiance')
    >>> bool(irradiance.cube.max() < 0.6 * irradiance.cube.sum())  # the lens has spread the point
    True
    """
    report, cache, sampling = report or Report(), cache or ChannelCache(limit_mb=0), radiance.sampling
    radiance = radiance.even() if options.detail == OFF else radiance
    with report.stage("casting"):
        radiance = without_jumps(radiance, lens, options.depth_accuracy)
    with report.stage("plan"):
        plan = cache.plan(options, lens, radiance, out is not None and np.may_share_memory(out, radiance.light))
    views = capture_planes(radiance, lens, partial(rays, lens), fireflies=options.fireflies,
                           most_rays=options.most_rays, most_of_lamps=options.most_of_lamps,
                           finest_px=options.finest_cell_px, iris=iris, times=plan.parts, stage=report.stage,
                           progress=progress or (lambda fraction: None))
    shape = (len(sampling.wavelengths_nm), *sampling.grid.frame_px)
    irradiance = zeros_stored_like(radiance.light, shape) if out is None else out
    if irradiance.shape != shape or irradiance.dtype != np.float32:
        raise ImageError("out", "array", f"{irradiance.dtype} of {irradiance.shape}", f"expected float32 of {shape}")
    fine, tally = plan.supersampling, _Tally(sampling, plan.supersampling, plan.known)
    frame_px = sampling.grid.finer(fine).frame_px
    channels = cache.channels(lens, sampling, plan, radiance.grid.across)
    for index, view in enumerate(views):
        tally.see(view.sharp)
        with report.stage("lens data"):
            channel = next(channels)
        with report.stage("distortion and relative illumination"):
            ideal = channel.ideal_irradiance(view.sharp)
            out_of_focus = None
            if view.blurred is not None and view.clear is not None:
                channel.veil(ideal, split_pixels(view.clear, fine))
                out_of_focus = channel.behind_glass(view.blurred * view.per_radiance, sampling.grid.frame())
        light = channel.planes.light(ideal)
        with report.stage("filtering"):
            blurred = channel.blur(ideal)
            if plan.known > 1:
                channel.sharpen(blurred)
        irradiance[index] = merge_pixels(_frame(blurred, frame_px), fine)
        if out_of_focus is not None:
            irradiance[index] += out_of_focus
        tally.add(channel, light, blurred, irradiance[index], out_of_focus, view.clamped)
        del view, channel, ideal, blurred, out_of_focus  # to free their memory before the next wavelength
    report.add(tally.facts(lens, plan))
    sensor = replace(sampling.grid.frame(), projection=PLANE, focal_mm=None, squeeze=1.0)
    return SpectralImage(irradiance, sampling.wavelengths_nm, sensor, quantity=IRRADIANCE, lens_name=lens.name,
                         f_number_effective=lens.f_number_effective, exposure=radiance.exposure,
                         arbitrary=radiance.arbitrary)


def _frame(blurred, frame_px):
    """The frame of a picture that has the same margin on opposite sides."""
    return blurred[tuple(slice((length - n) // 2, (length + n) // 2)
                         for length, n in zip(blurred.shape, frame_px, strict=True))]


class _Tally:
    """Light and fits, wavelength by wavelength, for the report."""

    def __init__(self, sampling, supersampling, times):
        self._sampling, self._parts, self._times = sampling, supersampling**2, times  # finer pixels in a pixel
        self._frame = sampling.grid.frame()
        self._fits, self._clamped, self._out_of_field, self._cast, self._gpu = [], 0, 0.0, False, ""
        self._flux = np.zeros(3)
        self._negative, self._light, self._brightest = 0.0, 0.0, 0.0

    def see(self, plane):
        """Add the light of a plane of radiance."""
        if plane.min() < 0:
            self._negative -= np.minimum(plane, 0).sum(dtype=np.float64)
        self._light += plane.sum(dtype=np.float64)
        self._brightest = max(self._brightest, float(plane.max()))

    def add(self, channel, light, blurred, frame, out_of_focus, clamped):
        """Add the results of a wavelength. Out-of-focus light is counted in the frame only."""
        field, self._gpu = channel.field, self._gpu or channel.gpu
        unfocused = 0.0 if out_of_focus is None else out_of_focus.sum(dtype=np.float64)
        self._flux += (light / self._parts + unfocused, blurred.sum(dtype=np.float64) / self._parts + unfocused,
                       frame.sum(dtype=np.float64))
        self._clamped += clamped
        self._cast |= out_of_focus is not None
        self._out_of_field = max(self._out_of_field, field.share_beyond(self._frame))
        self._fits.append([kind(fit.order, fit.residual, fit.highest_order) for kind, fit in (
            (DistortionFit, field.distortion), (IlluminationFit, field.illumination))])

    def facts(self, lens, plan):
        grid = self._sampling.grid
        flux = self._flux * (grid.pitch_um * 1e-6) ** 2
        fits = tuple(WavelengthFacts(nm, *fits)
                     for nm, fits in zip(self._sampling.wavelengths_nm, self._fits, strict=True))
        return LensImageFacts(lens.name, plan, grid.pitch_um, grid.frame_px, grid.overscan_px, fits,
                              Energy(*flux.tolist()), self._out_of_field, self._clamped, running(),
                              caster() if self._cast else "", self._gpu or on_processor(), problems(),
                              self._negative / max(self._light + self._negative, np.finfo(float).tiny),
                              self._brightest, self._softening_px(plan.supersampling))

    def _softening_px(self, supersampling):
        gain = sharpening_gain(self._times, supersampling) if self._times > 1 else 1.0
        return softening_px(self._times, supersampling, gain)
