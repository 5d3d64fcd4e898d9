"""cast(): gather the out-of-focus light of layered radiance along the lens's rays."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..field.field_map import CaptureView, FieldMap, field_map
from ..image.detail import split_by_detail
from ..image.layers import LayeredRadiance, Radiance
from ..kernels.cast_tiles import cast_tiles
from ..kernels.casting import TOGETHER, Casting
from ..lens import Lens
from ..lens.iris import Iris, Opening, opening
from ..rays.grid_rays import LensRays
from ..rays.stop_places import cell_size
from ..runtime.scratch import SAMPLE_BYTES
from .levels import layer_arrays
from .meetings import AREA_ROWS, BESIDE_PX, TILE_PX, areas_of, around_px, plan_meetings, values_of_blocks
from .parallax import parallax_per_nearness_px
from .prepared_layer import PreparedLayer, prepare_layers

FAINT = 1e-3  # of a picture's mean radiance
LAYER_PLANES, PREPARING_PLANES = 3, 10  # planes in memory of a prepared layer, and during its preparation
LEVELS_PX = 2.2  # pixels of the levels of a slanted layer, relative to the layer's
COVER_PLANES, NEARER_PLANES = 5, 2  # planes of the capture for the cover of nearer layers, and of these for a layer
SAMPLE_RAYS = 256  # for the reach of all
SUMMABLE = 2.0**88  # radiance whose sums over rays stay within float32
DIMMED = 2.0**-40  # brighter light is multiplied by this first; for a power of two, this is exact
RAY_PLANES, TABLE_VALUES = 6, 3.5e6  # planes, and additional values, for the irradiance of a wavelength's rays


@dataclass(frozen=True, eq=False)
class CastPlane:
    """A wavelength of a capture: E = blur(ideal irradiance of sharp * clear) + T * per_radiance * blurred.

    Attributes
    ----------
    sharp : float32 array (row, column) of the capture, with each pixel split into `times` x `times`
        In-focus radiance, as a pinhole sees it without the out-of-focus surfaces.
    blurred : float32 array (row, column) of the sensor's frame
        Out-of-focus radiance with occlusion, as a mean weighted with the light of the pixel's rays.
    clear : float32 array (row, column) of the frame
        The share, from 0 to 1, of in-focus light that out-of-focus surfaces do not cover.
    per_radiance : float32 array (row, column) of the frame
        Irradiance per uniform radiance by all of the lens's rays, without the transmittance T of its glass. This and
        the two before are None if everything is in focus.
    clamped : int
        Clamped pixels, which were not finite; the first plane of layers counts the pixels of all wavelengths.
    """

    sharp: np.ndarray
    blurred: np.ndarray | None = None
    clear: np.ndarray | None = None
    per_radiance: np.ndarray | None = None
    clamped: int = 0


def cast(layered: LayeredRadiance, lens: Lens, trace: Callable[[], LensRays], *, most_rays: int = 64,
         most_of_lamps: int | None = None, finest_px: float = 0.5, iris: Iris | None = None, times: int = 1,
         progress: Callable[[float], object] = lambda fraction: None) -> Iterator[CastPlane]:
    """Cast layered radiance along the lens's rays: yield a plane for each wavelength.

    For a ray through the place u of the entrance pupil with the tangent t, the capture shows its point at the inverse
    depth q at f (t + u q). Each pixel's rays sum the out-of-focus light from layer to layer, the nearest first, and are
    attenuated by everything that covers them. Each ray looks up the mean over its part of the pupil. In-focus light is
    taken from the pinhole's view: rays only determine the share of it that reaches the pixel.

    Parameters
    ----------
    layered : LayeredRadiance
    lens : Lens
        It determines the depths in focus.
    trace : callable () -> LensRays
        Returns the lens's rays, as far out as the iris reaches. Called only if light is out of focus, or an
        out-of-focus surface in front of light.
    most_rays : int
        Maximum number of rays of a pixel. The number depends on the size of the blur.
    most_of_lamps : int, optional
        Maximum where something small and bright in the blur requires more rays; `most_rays` by default.
    finest_px : float
        Smallest side of a ray's part of a blur, in pixels of the capture: smaller blur receives fewer rays.
    iris : Iris, optional
        The blades that stop the lens down; by default the stop is round. Both openings have the same area, so light and
        f-number do not change.
    times : int
        Parts of a pixel, down and across, in the planes' in-focus radiance.
    progress : callable (fraction), optional

    Yields
    ------
    CastPlane
        Bit-identical for all variants of the compiled loop and any number of threads; numpy differs by rounding.
    """
    layers = prepare_layers(layered.layers, layered.capture, lens)
    if not _blurred(layers):
        return _in_focus(layers, layered, times, progress)
    limits = most_rays, most_of_lamps or most_rays, finest_px
    return _cast(layers, layered, lens, trace(), limits, opening(iris, lens), times, progress)


def _blurred(layers):
    """Whether any light is out of focus, or an out-of-focus surface in front of light."""
    lit_beyond = False
    for layer in reversed(layers):
        if layer.blurred or (lit_beyond and layer.out_of_focus):
            return True
        lit_beyond |= bool(layer.lit.any())
    return False


def _in_focus(layers, layered, times, progress):
    shares = _sharp_shares(layers, layered.grid.shape_px)
    for index in range(layered.wavelengths_nm.size):
        yield CastPlane(_sharp(layers, shares, index, layered, times))
        progress((index + 1) / layered.wavelengths_nm.size)


def _cast(layers, layered, lens, rays, limits, stop, times, progress):
    """The planes of `cast` if light is out of focus.

    capture       PixelGrid of the layers, which may have finer columns than the sensor
    sensor        PixelGrid of the frame, in the capture's columns
    limits        `most_rays`, `most_of_lamps` and `finest_px`
    known         parts of a pixel whose light is known, down and across
    ends          rays at the first and last wavelength, for the reach of all
    per_focal     tangent per pixel of the capture
    meetings      the layers that the rays of each tile meet
    shares        share of each layer's light that is in focus: arrays (row, column) of the layer, or None
    group         up to TOGETHER wavelengths, which are cast together
    sharp         radiance of each wavelength in focus: arrays (row, column) of the capture
    faint         radiance of each wavelength below which light does not count
    blurred       radiance out of focus: array (wavelength, row, column) of the sensor
    clear         share of the in-focus light that reaches the sensor, from 0 to 1: an array like `blurred`
    """
    # the sensor, and the rays of its pixels
    capture, sensor, known = layered.grid, layered.grid.frame(), layered.detail_times
    wavelengths_nm, count = layered.wavelengths_nm, layered.wavelengths_nm.size
    focal_mm, field = layered.focal_mm or lens.capture_focal_length_mm, field_map(lens)
    of_pixels, caster = field.pixel_rays(rays, sensor.on_sensor()), _Caster(lens, field, rays, focal_mm, stop)
    ends = field.pixel_rays(rays, sensor).sample(wavelengths_nm[[0, -1]], focal_mm, SAMPLE_RAYS, stop.reach)

    # the layers, where these rays meet them
    layers = [layer.near_surfaces(_reach_px(layer, ends)) for layer in layers]
    layers = [layer.in_place(parallax_per_nearness_px(lens, ends, layered.capture, layer.layer.place,
                                                      float(wavelengths_nm[0])), lens) for layer in layers]
    meetings = plan_meetings(layers, ends, sensor, CaptureView(capture.projection, capture.pitch_um * 1e-3 / focal_mm),
                             *limits, known)
    shares = _sharp_shares(layers, capture.shape_px)

    # the wavelengths, a group at a time
    per_radiance, of_nm = None, np.float32(0)
    for first in range(0, count, TOGETHER):
        group = slice(first, min(first + TOGETHER, count))
        sharp = [_sharp(layers, shares, index, layered) for index in range(group.start, group.stop)]
        blurred = np.zeros((len(sharp), *sensor.shape_px), np.float32)
        clear = np.ones_like(blurred)
        faint = [FAINT * float(abs(plane.mean(dtype=np.float64))) for plane in sharp]
        for completed in caster.cast(layers, sensor, meetings, group, wavelengths_nm[group], faint, blurred, clear):
            progress((first + completed * len(sharp)) / count)
        if meetings.through_parts:
            caster.cast_through_parts(layers, sensor, meetings.through_parts, group, wavelengths_nm[group], faint,
                                      known, blurred, clear)
        progress(group.stop / count)
        for number, nm in enumerate(wavelengths_nm[group]):
            if times > 1:
                sharp[number] = _sharp(layers, shares, first + number, layered, times)
            if np.float32(nm) != of_nm:  # rays have single precision
                per_radiance, of_nm = of_pixels.irradiance_per_radiance(nm), np.float32(nm)
            yield CastPlane(sharp[number], layered.on_sensor(blurred[number]), layered.on_sensor(clear[number]),
                            per_radiance)
            sharp[number] = None  # to free its memory
        del blurred, clear


class _Caster:
    """What all rays have in common."""

    def __init__(self, lens: Lens, field: FieldMap, rays: LensRays, focal_mm: float, stop: Opening) -> None:
        self.lens, self.field, self.rays, self.focal_mm, self.stop = lens, field, rays, focal_mm, stop
        self._packed: dict[tuple, Any] = {}

    def _rays_of(self, sensor, wavelengths_nm, counts):
        """The packed rays of a sensor's pixels. Calls with the same wavelengths, in single precision, share them."""
        key = sensor, wavelengths_nm.astype(np.float32).tobytes(), counts.tobytes()
        if key not in self._packed:
            self._packed = {key: self.field.pixel_rays(self.rays, sensor).packed(
                wavelengths_nm, self.focal_mm, counts.tolist(), self.stop.reach)}
        return self._packed[key]

    def cast(self, layers, sensor, meetings, group, wavelengths_nm, faint, blurred, clear):
        """Write the tiles with rays; yield the completed fraction.

        `group` are the wavelengths among those of the layers.
        """
        counts = np.unique(meetings.counts[meetings.counts > 0])
        if not counts.size:
            return
        packed = self._rays_of(sensor, wavelengths_nm, counts)
        yield from self._cast(packed, layers, sensor.centre_px, meetings, counts, group, faint, blurred, clear)

    def cast_through_parts(self, layers, sensor, meetings, group, wavelengths_nm, faint, times, blurred, clear):
        """Write the tiles with rays that look up layers in `times` x `times` parts of the capture's pixels. They come
        from all quarters of a pixel, so that their mean is one over its area."""
        counts = np.unique(meetings.counts[meetings.counts > 0])
        packed = self.field.pixel_rays(self.rays, sensor.finer(times)).packed(
            wavelengths_nm, self.focal_mm, counts.tolist(), self.stop.reach).from_quarters(times)
        for area in areas_of(meetings):
            kinds, near, region = area.met(layers)
            place = area.place(sensor.shape_px)
            grid = sensor.part(place)
            parts = [layer.in_parts(region, times, group, wavelengths_nm) for layer in near]
            of_area = [np.full((len(blurred), *grid.shape_px), value, np.float32) for value in (0, 1)]
            for _ in self._cast(packed, parts, grid.centre_px, kinds, counts, slice(len(blurred)), faint, *of_area):
                pass
            lit = area.pixels(sensor.shape_px)
            for to, cast_planes in zip((blurred, clear), of_area, strict=True):
                np.copyto(to[:, *place], cast_planes, where=lit)

    def _cast(self, packed, layers, centre_px, meetings, counts, group, faint, blurred, clear):
        capture = layers[0].capture
        per_focal = capture.pitch_um * 1e-3 / self.focal_mm
        levels = [np.unique(of_layer).tolist() for of_layer in np.moveaxis(meetings.kinds["level"], -1, 0)]
        scale = 1.0 if all(layer.largest(group) <= SUMMABLE for layer in layers) else DIMMED
        casting = Casting(
            packed, centre_px, (0.0, 0.0) if capture.projection.is_plane else (per_focal * capture.squeeze, per_focal),
            capture.projection.shrinkage_table, self.stop.iris.directions, self.stop.shape,
            self.stop.reach * cell_size(8), layer_arrays(layers, self.lens, group, levels, scale),
            tuple(scale * each for each in faint), meetings.kinds, _first_eights(counts, meetings.counts),
            meetings.counts // 8, meetings.steps, TILE_PX)
        yield from cast_tiles(casting, blurred, clear)
        if scale != 1:
            blurred /= np.float32(scale)


def _reach_px(layer, rays):
    """Distance from a layer's surfaces within which a ray may meet them, at any wavelength and with all of its cell."""
    nearness = layer.depth[..., 0]
    ends = float(nearness.min()), float(nearness.max())
    return rays.fringe_px(ends[1]) + 1 + int(around_px(max(map(rays.area_px, ends))))


def _first_eights(counts, of_tiles):
    """The first eight of each tile's rays, among sets of these counts."""
    return np.append(0, np.cumsum(counts // 8))[np.searchsorted(counts, of_tiles)]


def casting_bytes(layered: Radiance, lens: Lens, most_of_lamps: int) -> float:
    """Peak memory of `cast` in addition to the layers and the lens; 0 for flat radiance, which is not cast.

    `lens` and `most_of_lamps` are as in `cast`.
    """
    if not isinstance(layered, LayeredRadiance):
        return 0.0
    capture_px, frame_px = (math.prod(shape) for shape in (layered.grid.shape_px, layered.grid.frame_px))
    layers_px = [layer.alpha.size for layer in layered.layers]
    together = min(TOGETHER, layered.wavelengths_nm.size)
    rays = field_map(lens).packed_ray_values(most_of_lamps, together)
    levels = LEVELS_PX * (together + 1) * sum(layers_px) + _cover_planes(layered) * capture_px
    group = together * (capture_px + 2 * frame_px) + max(rays + max(levels, TABLE_VALUES),
                                                         TABLE_VALUES + RAY_PLANES * frame_px)
    if layered.detail_times > 1:
        group = max(group, together * (capture_px + 2 * frame_px) + _parts_values(layered, rays, together))
    is_plane = layered.grid.projection.is_plane
    looked_up = max(PREPARING_PLANES * pixels + values_of_blocks(pixels, is_plane) for pixels in layers_px)
    return SAMPLE_BYTES * (capture_px + LAYER_PLANES * sum(layers_px) + max(group, looked_up))


def _parts_values(layered, rays, together):
    """Values in memory while the rays of an area's tiles look up parts of pixels."""
    rows, columns = layered.grid.shape_px
    share = min(1.0, (AREA_ROWS * TILE_PX + 4 * BESIDE_PX) / rows)
    layers_px = sum(layer.alpha.size for layer in layered.layers)
    planes = LEVELS_PX * (together + 1) + LAYER_PLANES + 2 * together
    in_parts = layered.detail_times**2 * (planes * layers_px + _cover_planes(layered) * rows * columns)
    return 2 * rays + share * (in_parts + 2 * together * rows * columns)


def _cover_planes(layered):
    """Planes of the capture in memory for the cover of nearer layers."""
    return COVER_PLANES + NEARER_PLANES * (len(layered.layers) - 1)


def _sharp_shares(layers, shape_px):
    """Share of each layer's light that the pinhole sees in focus: array (row, column), or None if it is zero."""
    free, shares = np.ones(shape_px, np.float32), []
    for layer in layers:
        if not layer.focused:
            shares.append(None)
            continue
        share, left = np.maximum(layer.depth[..., 1], 0), free[layer.layer.place]
        shares.append(share * left)
        left *= 1 - share * layer.layer.alpha
    return shares


def _sharp(layers: list[PreparedLayer], shares, index, layered, times=1):
    """In-focus light at a wavelength, as the pinhole sees it, with each pixel split into `times` x `times`."""
    sharp, nm = np.zeros([times * n for n in layered.grid.shape_px], np.float32), layered.wavelengths_nm[index]
    for layer, share in zip(layers, shares, strict=True):
        if share is not None:
            light = share * layer.layer.cube[index]
            place = (slice(times * side.start, times * side.stop) for side in layer.layer.place)
            sharp[*place] += split_by_detail(light, layer.layer.detail, nm, times)
    return sharp
