"""cast(): gather the out-of-focus light of layered radiance along the lens's rays."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from .. import kernels
from ..field.field_map import field_map, packed_ray_values
from ..image.layers import LayeredRadiance, Radiance
from ..image.pixel_grid import FISHEYE
from ..kernels.numpy_cast import cast as numpy_cast
from ..lens import Lens
from ..rays.ray_table import RayTable
from ..runtime.scratch import SAMPLE_BYTES
from ..runtime.threads import thread_pool
from .iris import Iris, opening
from .meetings import TILE_PX, plan_meetings, values_of_blocks
from .prepared_layer import PreparedLayer, prepare_layer

FAINT = 1e-3  # of a picture's mean radiance
LAYER_PLANES, PREPARING_PLANES = 3, 10  # planes in memory of a prepared layer, and during its preparation
SUMMABLE = 2.0**88  # radiance whose sums over rays stay within float32
DIMMED = 2.0**-40  # brighter light is multiplied by this first; for a power of two, this is exact
RAY_PLANES, TABLE_VALUES = 6, 1.2e7  # planes, and additional values, for the irradiance of a wavelength's rays


@dataclass(frozen=True, eq=False)
class CastPlane:
    """A wavelength of a capture: E = blur(ideal irradiance of sharp * clear) + T * per_radiance * blurred.

    Attributes
    ----------
    sharp : float32 array (row, column) of the capture
        In-focus radiance, as a pinhole sees it without the out-of-focus surfaces.
    blurred : float32 array (row, column) of the frame
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


def cast(layered: LayeredRadiance, lens: Lens, rays: RayTable, *, most_rays: int = 256,
         most_of_lamps: int | None = None, iris: Iris | None = None,
         progress: Callable[[float], object] = lambda fraction: None) -> Iterator[CastPlane]:
    """Cast layered radiance along the lens's rays: yield a plane for each wavelength.

    For a ray through the place u of the entrance pupil with the tangent t, the capture shows its point at the inverse
    depth q at f (t + u q). Each pixel's rays sum the out-of-focus light from layer to layer, the nearest first, and are
    attenuated by everything that covers them. In-focus light is taken from the pinhole's view: rays only determine the
    share of it that reaches the pixel.

    Parameters
    ----------
    layered : LayeredRadiance
    lens : Lens
        It determines the depths in focus.
    rays : RayTable
        The lens's rays, as far out as the iris reaches.
    most_rays : int
        Maximum number of rays of a pixel, a power of two of at least 32. The number depends on the size of the blur.
    most_of_lamps : int, optional
        Maximum where something small and bright in the blur requires more rays; `most_rays` by default.
    iris : Iris, optional
        The blades that stop the lens down; by default the stop is round. Both openings have the same area, so light and
        f-number do not change.
    progress : callable (fraction), optional

    Yields
    ------
    CastPlane
        Bit-identical for all variants of the compiled loop and any number of threads; numpy differs by rounding.
    """
    capture, wavelengths_nm = layered.grid, layered.wavelengths_nm
    sensor, count = capture.frame(), wavelengths_nm.size
    focal_mm = layered.focal_mm or lens.capture_focal_length_mm
    stop = opening(iris, lens)
    pixel_rays = field_map(lens).pixel_rays(rays, sensor)
    ends = pixel_rays.sample(wavelengths_nm[[0, -1]], focal_mm, 256, stop.reach)
    layers = [one for layer in layered.layers if (one := prepare_layer(layer, capture, lens, ends))]
    fisheye = _per_focal(capture, focal_mm)
    meetings = plan_meetings(layers, ends, sensor, fisheye, most_rays, most_of_lamps or most_rays)
    shares = _sharp_shares(layers, capture.shape_px)
    needed = 8 * max(1, int(meetings.eights.max()))
    for first in range(0, count, kernels.TOGETHER):
        group = slice(first, min(first + kernels.TOGETHER, count))
        sharp = [_sharp(layers, shares, index, capture.shape_px) for index in range(group.start, group.stop)]
        blurred, clear = (np.full((len(sharp), *sensor.shape_px), value, np.float32) for value in (0, 1))
        if meetings.eights.any():
            scale = 1.0 if all(layer.largest(group) <= SUMMABLE for layer in layers) else DIMMED
            casting = kernels.Casting(
                *pixel_rays.packed(wavelengths_nm[group], focal_mm, needed, stop.reach),
                sensor.centre_px, fisheye,
                stop.iris.directions, stop.shape, tuple(layer.of(group, scale) for layer in layers),
                tuple(scale * FAINT * float(abs(plane.mean(dtype=np.float64))) for plane in sharp), meetings.kinds,
                meetings.eights, TILE_PX)
            for completed in _filled_rows(casting, blurred, clear):
                progress((first + completed * len(sharp)) / count)
            del casting
            if scale != 1:
                blurred /= np.float32(scale)
        else:
            progress(group.stop / count)
        for number, nm in enumerate(wavelengths_nm[group]):
            yield CastPlane(sharp[number], blurred[number], clear[number], pixel_rays.irradiance_per_radiance(nm))
            sharp[number] = None  # to free its memory
        del blurred, clear


def casting_bytes(layered: Radiance, most_of_lamps: int) -> float:
    """Peak memory of `cast` in addition to the layers and the lens; 0 for flat radiance, which is not cast.

    `most_of_lamps` is as in `cast`.
    """
    if not isinstance(layered, LayeredRadiance):
        return 0.0
    capture_px, frame_px = (math.prod(shape) for shape in (layered.grid.shape_px, layered.grid.frame_px))
    layers_px = [layer.alpha.size for layer in layered.layers]
    together = min(kernels.TOGETHER, layered.wavelengths_nm.size)
    rays = 2 * packed_ray_values(most_of_lamps, together)  # twice as many while they are packed
    group = together * (capture_px + 2 * frame_px) + max(rays, TABLE_VALUES + RAY_PLANES * frame_px)
    looked_up = max(PREPARING_PLANES * pixels + values_of_blocks(pixels) for pixels in layers_px)
    return SAMPLE_BYTES * (capture_px + LAYER_PLANES * sum(layers_px) + max(group, looked_up))


def _per_focal(capture, focal_mm):
    """One over the focal length in pixels of a fisheye capture, for the loops; 0 for a plane capture."""
    return capture.pitch_um * 1e-3 / focal_mm if capture.projection == FISHEYE else 0.0


def _filled_rows(casting, blurred, clear):
    """Write the pixels of the tiles, and yield the completed fraction after each row of tiles."""
    loop = numpy_cast if kernels.running() == kernels.NUMPY else kernels.cast
    rows = len(casting.eights)
    with thread_pool() as pool:
        for completed, _ in enumerate(pool.map(lambda row: loop(casting, row, blurred, clear), range(rows)), 1):
            yield completed / rows


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


def _sharp(layers: list[PreparedLayer], shares, index, shape_px):
    """In-focus light at a wavelength, as the pinhole sees it."""
    sharp = np.zeros(shape_px, np.float32)
    for layer, share in zip(layers, shares, strict=True):
        if share is not None:
            sharp[layer.layer.place] += share * layer.layer.cube[index]
    return sharp
