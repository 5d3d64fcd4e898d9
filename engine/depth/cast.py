"""cast(): layered radiance seen along the lens's rays, where it is out of focus."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .. import kernels
from ..image.layers import LayeredRadiance
from ..image.pixel_grid import PixelGrid
from ..scratch import SAMPLE_BYTES
from ..threads import thread_pool
from .meetings import TILE_PX, plan_meetings, values_of_blocks
from .pencils import HEIGHTS, Iris, packed_pencils, pencils, per_focal
from .plain import cast as plain_cast
from .seen import Seen, seen

if TYPE_CHECKING:
    from ..bake.ray_table import RayTable
    from ..lens import Lens

FAINT = 1e-3  # of a picture's mean radiance
SEEN, READY = 3, 10  # planes that a layer takes, as it is seen; and on the way to that
TOLD, OF_TABLE = 6, 1.2e7  # planes, and values beside, that the irradiance of a wavelength's rays takes


@dataclass(frozen=True, eq=False)
class CastPlane:
    """A wavelength of a layered capture: E = blur(ideal irradiance of sharp * clear) + T * per_radiance * blurred.

    Attributes
    ----------
    sharp : float32 array (row, column) of the capture
        Radiance of what is in focus, as the pinhole sees it, not hidden by what is out of focus.
    blurred : float32 array (row, column) of the frame
        Radiance of what is out of focus, with all that hides it: the mean over the light of the pixel's rays.
    clear : float32 array (row, column) of the frame
        The share, from 0 to 1, that what is out of focus leaves of what is in focus.
    per_radiance : float32 array (row, column) of the frame
        Irradiance of even radiance by all of the lens's rays, but for its glass's transmittance T. This and the two
        before are None of a picture without layers, which is taken to be in focus.
    """

    sharp: np.ndarray
    blurred: np.ndarray | None = None
    clear: np.ndarray | None = None
    per_radiance: np.ndarray | None = None


def cast(layered: LayeredRadiance, lens: "Lens", rays: "RayTable", *, most_rays: int = 256,
         most_of_lamps: int | None = None, iris: Iris | None = None,
         progress: Callable[[float], object] = lambda fraction: None) -> Iterator[CastPlane]:
    """Layered radiance along the lens's rays: the planes of its wavelengths, one after another.

    A point at the inverse depth q, of the ray through the place u of the entrance pupil at the tangent t, is met where
    the capture shows f (t + u q). From layer to layer, the nearest first, each pixel's rays add up the light of what is
    out of focus, and are weakened by all that covers them. What is in focus stays with the pinhole: rays tell only
    which part of its light reaches the pixel.

    Parameters
    ----------
    layered : LayeredRadiance
    lens : Lens
        What is in focus is told by it.
    rays : RayTable
        The lens's.
    most_rays : int
        For a pixel, a power of two from 32 on: as many as the size of the blur asks for, up to this.
    most_of_lamps : int, optional
        As many times more as what is small and bright in it asks for, up to this; `most_rays` by default.
    iris : Iris, optional
        The blades that stop the lens down; its stop is a circle without.
    progress : callable (fraction), optional

    Yields
    ------
    CastPlane
        The same bits whatever does the loops, in any number of threads.
    """
    capture, wavelengths_nm = layered.grid, layered.wavelengths_nm
    sensor, count = capture.frame(), wavelengths_nm.size
    focal_mm = layered.focal_mm or lens.capture_focal_length_mm
    ends = pencils(rays, wavelengths_nm[[0, -1]], sensor, focal_mm, 256)
    layers = [one for layer in layered.layers if (one := seen(layer, capture, lens, ends))]
    fisheye = per_focal(capture, focal_mm)
    meetings = plan_meetings(layers, ends, sensor, fisheye, most_rays, most_of_lamps or most_rays)
    shares = _sharp_shares(layers, capture.shape_px)
    blades, per_radiance = iris or Iris(0), _PerRadiance(rays, sensor)
    needed = 8 * max(1, int(meetings.eights.max()))
    for first in range(0, count, kernels.TOGETHER):
        group = slice(first, min(first + kernels.TOGETHER, count))
        sharp = [_sharp(layers, shares, index, capture.shape_px) for index in range(group.start, group.stop)]
        blurred, clear = (np.full((len(sharp), *sensor.shape_px), value, np.float32) for value in (0, 1))
        if meetings.eights.any():
            casting = kernels.Casting(
                *packed_pencils(rays, wavelengths_nm[group], sensor, focal_mm, needed), sensor.centre_px, fisheye,
                blades.directions, blades.shape, tuple(layer.of(group) for layer in layers),
                tuple(FAINT * float(abs(plane.mean())) for plane in sharp), meetings.found, meetings.eights, TILE_PX)
            for done in _filled_rows(casting, blurred, clear):
                progress((first + done * len(sharp)) / count)
            del casting
        else:
            progress(group.stop / count)
        for number, nm in enumerate(wavelengths_nm[group]):
            yield CastPlane(sharp[number], blurred[number], clear[number], per_radiance(nm))
            sharp[number] = None  # the next one's needs its room
        del blurred, clear


def casting_bytes(layered: LayeredRadiance, most_of_lamps: int) -> float:
    """Of memory that `cast` takes at the most, beside the layers and the lens. Small bright things count as there."""
    capture_px, frame_px = (math.prod(shape) for shape in (layered.grid.shape_px, layered.grid.frame_px))
    layers_px = [layer.alpha.size for layer in layered.layers]
    together = min(kernels.TOGETHER, layered.wavelengths_nm.size)
    rays = 2 * math.prod(kernels.rays_shape(HEIGHTS, most_of_lamps // 8, together))  # and as many on the way
    group = together * (capture_px + 2 * frame_px) + max(rays, OF_TABLE + TOLD * frame_px)
    looked_up = max(READY * pixels + values_of_blocks(pixels) for pixels in layers_px)
    return SAMPLE_BYTES * (capture_px + SEEN * sum(layers_px) + max(group, looked_up))


class _PerRadiance:
    """What a lens brings to the pixels of a sensor, by all of its rays."""

    def __init__(self, rays: "RayTable", sensor: PixelGrid):
        x_mm, y_mm = sensor.axes_mm()
        self._rays, self._pixels_mm = rays, np.hypot(x_mm.astype(np.float32), y_mm.astype(np.float32)[:, None])
        self._heights_mm = np.linspace(0, rays.last_height_mm, HEIGHTS)

    def __call__(self, wavelength_nm: float) -> np.ndarray:
        """Irradiance per radiance: array (row, column). Beyond the last height it is held."""
        told = self._rays.near([wavelength_nm]).irradiance_per_radiance(self._heights_mm)[0]
        return np.interp(self._pixels_mm, self._heights_mm, told).astype(np.float32)


def _filled_rows(casting, blurred, clear):
    """Write what tiles see, a row of them after another: yields which part is done."""
    loop = plain_cast if kernels.running() == kernels.NUMPY else kernels.cast
    rows = len(casting.eights)
    with thread_pool() as pool:
        for done, _ in enumerate(pool.map(lambda row: loop(casting, row, blurred, clear), range(rows)), 1):
            yield done / rows


def _sharp_shares(layers, shape_px):
    """Of each layer, how much of its light the pinhole sees in focus: array (row, column), or None for nothing."""
    free, shares = np.ones(shape_px, np.float32), []
    for layer in layers:
        if not layer.focused:
            shares.append(None)
            continue
        share, left = np.maximum(layer.depth[..., 1], 0), free[layer.layer.place]
        shares.append(share * left)
        left *= 1 - share * layer.layer.alpha
    return shares


def _sharp(layers: list[Seen], shares, index, shape_px):
    """What is in focus at a wavelength, as the pinhole sees it."""
    sharp = np.zeros(shape_px, np.float32)
    for layer, share in zip(layers, shares, strict=True):
        if share is not None:
            sharp[layer.layer.place] += share * layer.layer.cube[index]
    return sharp
