"""Mean electrons that light frees in each pixel, behind its filter."""

from dataclasses import replace

import numpy as np
import scipy

from ..image.spectral_image import SpectralImage
from ..kernels.collecting import collect
from ..runtime.memory import check_room
from ..runtime.threads import in_bands
from .camera import Camera
from .electrons import response
from .resampling import pixel_means

BAND_PIXELS = 2**18
NUMBER_BYTES, ELECTRON_BYTES, CHANNEL_BYTES = 2, 4, 1


def collected_e(irradiance: SpectralImage, camera: Camera, shutter_s: float, channel: np.ndarray | None,
                shape_px: tuple[int, int]) -> np.ndarray:
    """Mean electrons from light in the pixels in the middle of a sensor.

    Parameters
    ----------
    irradiance : SpectralImage
        W m^-2 nm^-1.
    camera : Camera
    shutter_s : float
    channel : uint8 array (row, column) or None
        Index of the channel of each pixel; None if all pixels have all channels.
    shape_px : (int, int)
        Rows and columns.

    Returns
    -------
    float32 array (1 or channel, row, column)
    """
    factors = (response(camera, irradiance.wavelengths_nm) * shutter_s).astype(np.float32)
    image = replace(irradiance.frame(), cube=_with_contiguous_rows(irradiance.frame().cube))
    collected = _summed if image.pitch_um == camera.pitch_um else _resampled
    light_e = np.empty((len(factors) if channel is None else 1, *shape_px), np.float32)
    collected(image, camera, factors, channel, light_e)
    return _shared(light_e, camera) if camera.crosstalk else light_e


def check_memory(irradiance: SpectralImage, camera: Camera, shape_px: tuple[int, int]) -> None:
    """Raise an ImageError unless there is enough memory for a raw picture of this shape, and for its electrons."""
    pixels, planes = shape_px[0] * shape_px[1], 1 if camera.filters else len(camera.channels)
    to_come = pixels * planes * (ELECTRON_BYTES if camera.crosstalk else NUMBER_BYTES)
    if irradiance.pitch_um != camera.pitch_um:
        (rows, columns), down = irradiance.frame_px, len(camera.filters) or 1
        across = len(camera.filters[0]) if camera.filters else 1
        resampling = 2 * rows * columns + 2 * rows * shape_px[1] // across + pixels // (down * across)
        to_come = max(to_come, resampling * ELECTRON_BYTES)
    needed = pixels * (planes * ELECTRON_BYTES + CHANNEL_BYTES) + to_come
    check_room("raw picture", needed, "give a smaller picture, or a camera with fewer pixels")


def _with_contiguous_rows(cube):
    """The cube, or a copy if its rows are not contiguous or not in order."""
    plane, row, column = cube.strides
    in_order = column == cube.itemsize and row >= column * cube.shape[2] and plane >= row * cube.shape[1]
    return cube if in_order else np.ascontiguousarray(cube)


def _summed(image, camera, factors, channel, light_e):
    """Of a picture in the sensor's own pixels. Each of these is even: the same through any aperture."""
    above, left = ((n - part) // 2 for n, part in zip(image.frame_px, light_e.shape[1:], strict=True))
    cube = image.cube[:, above:above + light_e.shape[1], left:left + light_e.shape[2]]
    if channel is None:
        for each, plane_e in zip(factors, light_e, strict=True):
            _collect(cube, each[None, :, None], plane_e)
    else:
        cell = channel[:len(camera.filters), :len(camera.filters[0])]
        _collect(cube, np.moveaxis(factors[cell], 2, 1), light_e[0])


def _resampled(image, camera, factors, channel, light_e):
    """Of a picture in other pixels. Behind filters, only the pixels of each channel are computed."""
    cells = [np.zeros((1, 1), int)] * len(factors) if channel is None else [
        channel[:len(camera.filters), :len(camera.filters[0])] - index for index in range(len(factors))]
    plane_e = np.empty(image.frame_px, np.float32)
    for index, (each, cell) in enumerate(zip(factors, cells, strict=True)):
        _collect(image.cube, each[None, :, None], plane_e)
        for first in np.argwhere(cell == 0):
            some = tuple(slice(at, None, period) for at, period in zip(first, cell.shape, strict=True))
            light_e[index if channel is None else 0][some] = pixel_means(
                plane_e, image.pitch_um, light_e.shape[1:], camera.pitch_um, camera.pixel_aperture, some)


def _collect(cube, weights, plane_e):
    rows, columns = plane_e.shape
    in_bands(lambda band: collect(cube, weights, band, plane_e), rows, BAND_PIXELS // columns)


def _shared(before_e, camera):
    """Mean electrons after crosstalk. None leave the picture."""
    after_e, exchange = np.empty_like(before_e), np.float32(camera.crosstalk / 4) * np.array([1, -2, 1])

    def share(rows):
        around = slice(max(rows.start - 1, 0), rows.stop + 1)
        inside = slice(rows.start - around.start, rows.stop - around.start)
        some_e = before_e[:, around]
        gained_e = sum(scipy.ndimage.correlate1d(some_e, exchange, axis, mode="nearest") for axis in (1, 2))
        after_e[:, rows] = (some_e + gained_e)[:, inside]

    in_bands(share, before_e.shape[1], BAND_PIXELS // before_e.shape[2])
    return after_e
