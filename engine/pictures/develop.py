"""Developing raw pictures: demosaicing by LibRaw, to linear light in the camera's channels or in Rec. 709."""

import io
import os
from dataclasses import replace

import numpy as np

from ..runtime.errors import CameraError, ImageError
from ..runtime.files import AnyPath
from ..runtime.memory import check_room
from ..sensor.camera import MOST_BITS, Camera
from ..sensor.colour import camera_colour, filter_channels
from ..sensor.exposure import RawImage, channels_of
from ..sensor.resampling import pixel_means
from ..spectral.colour import XYZ_TO_REC709
from .dng import dng_samples, dng_tags, filter_cell, plane_order, write_tiff
from .spectral_exr import write_planes_exr

XTRANS = "GBGGRG", "RGRBGB", "GBGGRG", "GRGGBG", "BGBRGR", "GRGGBG"
BAYER, QUAD_BAYER = ("RG", "GB"), ("RRGG", "RRGG", "GGBB", "GGBB")
FULL_SCALE = 65535  # of LibRaw's pictures
LEAST_PX, LARGEST_PERIOD = 512, 6  # a side of a picture that LibRaw demosaics; a multiple of the periods of patterns
DEVELOP_BYTES = 40  # for a pixel, LibRaw's included
LEAST_MOSAIC_PX = 2 * LARGEST_PERIOD


def signal(raw: RawImage) -> np.ndarray:
    """The digital numbers above the dark level, 1 at saturation: float32 array of the shape of `raw.numbers`."""
    return (raw.numbers - np.float32(raw.dark_dn)) / np.float32(raw.highest_dn - raw.dark_dn)


def camera_rgb(raw: RawImage) -> np.ndarray:
    """Linear light in the camera's channels, 1 at saturation: as in `signal`, but with all channels in each pixel.

    LibRaw demosaics Bayer patterns (AHD) and X-Trans (Markesteijn). Of a Quad Bayer pattern, 2 x 2 pixels of the same
    channel are added first.

    Parameters
    ----------
    raw : RawImage

    Returns
    -------
    float32 array (row, column, channel)
        Red, green and blue, in the order of a DNG's planes; a single channel of a monochrome camera. Half the rows and
        columns of a Quad Bayer pattern.

    Raises
    ------
    CameraError
        Pictures with this filter array cannot be demosaiced.
    """
    if raw.channel is None or len(filter_channels(raw.camera)) == 1:
        return np.atleast_3d(signal(replace(raw, numbers=dng_samples(raw))))
    check_demosaicable(raw.camera, raw.numbers.shape)
    return _demosaiced(_demosaicable(raw))


def check_demosaicable(camera: Camera, shape_px: tuple[int, int], pitch_um: float = 0.0) -> None:
    """Raise a CameraError or an ImageError unless `camera_rgb` can be had of a camera's pictures of this shape.

    Parameters
    ----------
    camera : Camera
    shape_px : (int, int)
        Rows and columns.
    pitch_um : float
        Of the pixels of `developed_in`, which may be too large to need it.
    """
    channel = channels_of(camera, shape_px)
    if channel is None or len(filter_channels(camera)) == 1 or _is_coarse(camera, channel, pitch_um):
        return
    if min(shape_px) < LEAST_MOSAIC_PX:
        raise ImageError("raw picture", "size", f"{shape_px} px",
                         f"expected at least {LEAST_MOSAIC_PX} rows and columns to demosaic them")
    _quad_bayer_shift(camera, channel)


def developed(raw: RawImage) -> np.ndarray:
    """A raw picture in linear Rec. 709, balanced for daylight (D65): white is 1 where the first channel saturates.

    Parameters
    ----------
    raw : RawImage

    Returns
    -------
    float32 array (row, column, 3)
        For `write_png`. Grey of a monochrome camera; half the rows and columns of a Quad Bayer pattern.

    Raises
    ------
    CameraError
        Pictures with this filter array cannot be demosaiced, or the camera has two channels.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Exposure, SpectralImage, developed, expose, load_camera
    >>> light = SpectralImage(np.full((3, 12, 16), 2e-4), [450, 550, 650], pitch_um=30, quantity="irradiance")
    >>> raw = expose(light, load_camera("sony-a7-iv"), Exposure(shutter_s=1 / 60, iso=100.0))
    >>> developed(raw).shape == (*raw.numbers.shape, 3)
    True
    """
    return _rec709(camera_rgb(raw), raw.camera)


def developed_in(raw: RawImage, shape_px: tuple[int, int], pitch_um: float) -> np.ndarray:
    """A raw picture as `developed` shows it, in other pixels with the same middle.

    Pixels several times as large as the camera's have the mean of each channel, without demosaicing, whatever the
    filter array.

    Parameters
    ----------
    raw : RawImage
    shape_px : (int, int)
        Rows and columns of the result; beyond the raw picture it is 0.
    pitch_um : float

    Returns
    -------
    float32 array (row, column, 3)
    """
    if raw.channel is not None and _is_coarse(raw.camera, raw.channel, pitch_um):
        return _rec709(_channel_means(raw, shape_px, pitch_um), raw.camera)
    picture = developed(raw)
    own_um = raw.camera.pitch_um * raw.numbers.shape[-2] / len(picture)  # developing may add pixels together
    return _resampled(np.moveaxis(picture, -1, 0), own_um, shape_px, pitch_um)


def _is_coarse(camera, channel, pitch_um):
    """Whether pixels of this pitch contain several cells of a camera's filter array."""
    period = max(filter_cell(camera, channel).shape)
    return period > 1 and pitch_um >= 2 * period * camera.pitch_um


def _channel_means(raw, shape_px, pitch_um):
    """Mean signal of the pixels of each channel in larger pixels: array (row, column, channel)."""
    light, planes, letters = signal(raw), [], filter_channels(raw.camera)
    for index in plane_order(raw.camera):
        mask = (raw.channel == raw.camera.channels.index(letters[index])).astype(np.float32)
        total, count = _resampled([light * mask, mask], raw.camera.pitch_um, shape_px, pitch_um).transpose(2, 0, 1)
        planes.append(np.divide(total, count, out=np.zeros_like(total), where=count > 0))
    return np.stack(planes, axis=-1)


def _resampled(planes, pitch_um, shape_px, wanted_um):
    return np.stack([pixel_means(plane, pitch_um, shape_px, wanted_um) for plane in planes], axis=-1)


def _rec709(light, camera):
    """Linear Rec. 709 (row, column, 3) of light in a camera's channels, in the order of a file's planes."""
    order = plane_order(camera)
    if not order:
        return np.repeat(light, 3, axis=-1)
    colour = camera_colour(camera)
    balanced = light / colour.neutral[order].astype(np.float32)
    to_rec709 = XYZ_TO_REC709 @ colour.balanced_to_xyz[:, order]
    return np.minimum(balanced, 1, out=balanced) @ to_rec709.T.astype(np.float32)


def write_linear_exr(light: np.ndarray, camera: Camera, path: AnyPath) -> None:
    """Write a mosaic from `signal`, or a picture from `camera_rgb`, as an EXR, which appears complete or not at all.

    The channels are R, G and B, or Y. `colorInteropID` is "data", because these are not the colours of any RGB space.

    Parameters
    ----------
    light : array (row, column) or (row, column, channel)
    camera : Camera
    path : path
    """
    letters = filter_channels(camera)
    names = "".join(letters[index] for index in plane_order(camera)) if light.shape[2:] > (1,) else "Y"
    planes = np.moveaxis(np.atleast_3d(light), -1, 0)
    write_planes_exr(dict(zip(names, planes, strict=True)), path,
                     {"colorInteropID": "data", "lensfield:camera": camera.title or camera.name})


def _demosaiced(raw):
    rawpy = _rawpy()
    check_room("raw picture", DEVELOP_BYTES * raw.numbers.size, "develop a smaller picture")
    neutral = camera_colour(raw.camera).neutral[plane_order(raw.camera)]
    red, green, blue = 1 / neutral  # balanced, channels resemble each other, which demosaicing assumes
    file = io.BytesIO()
    rows, columns = raw.numbers.shape
    pixels = np.ix_(_extended(rows), _extended(columns))
    extended = replace(raw, numbers=raw.numbers[pixels], channel=raw.channel[pixels])
    write_tiff(file, dng_tags(extended), extended.numbers)
    file.seek(0)
    with rawpy.imread(file) as reader:
        # with the dark level, because without it LibRaw would set numbers below it to 0, and dark parts be too bright
        picture = reader.postprocess(
            user_black=0, user_sat=raw.highest_dn, user_wb=[red, green, blue, green], adjust_maximum_thr=0.0,
            highlight_mode=rawpy.HighlightMode.Ignore, no_auto_bright=True, gamma=(1, 1), output_bps=16,
            output_color=rawpy.ColorSpace.raw, user_flip=0)
    numbers = picture[:rows, :columns] * (neutral / neutral.min() * raw.highest_dn / FULL_SCALE).astype(np.float32)
    return (numbers - np.float32(raw.dark_dn)) / np.float32(raw.highest_dn - raw.dark_dn)


def _rawpy():
    """rawpy, which is only needed here, and rarely; with a single thread, because with several LibRaw's demosaicing of
    X-Trans gives slightly different pictures each time."""
    threads = os.environ.get("OMP_NUM_THREADS")
    os.environ["OMP_NUM_THREADS"] = "1"  # read once, when the library is loaded
    try:
        import rawpy
    finally:
        del os.environ["OMP_NUM_THREADS"]
        if threads is not None:
            os.environ["OMP_NUM_THREADS"] = threads
    return rawpy


def _extended(size):
    """Indices of `size` rows or columns, and of the last ones again up to a size that LibRaw accepts."""
    indices = np.arange(max(size, LEAST_PX))
    beyond = indices[size:]
    beyond -= LARGEST_PERIOD * (1 + (beyond - size) // LARGEST_PERIOD)
    return indices


def _demosaicable(raw):
    """The picture, if LibRaw demosaics its filter array; of a Quad Bayer pattern, the sums of 2 x 2 pixels."""
    shift = _quad_bayer_shift(raw.camera, raw.channel)
    return _binned(raw, *(n % 2 for n in shift)) if shift else raw


def _quad_bayer_shift(camera, channel):
    """The shift of a camera's Quad Bayer pattern, in rows and columns; None for Bayer and X-Trans."""
    cell = np.array(list(camera.channels))[filter_cell(camera, channel)]
    if _shift(cell, BAYER) or _shift(cell, XTRANS):
        return None
    shift = _shift(cell, QUAD_BAYER)
    if not shift:
        raise CameraError(f"camera {camera.name}", "filters", "/".join(camera.filters),
                        "expected a Bayer, Quad Bayer or X-Trans pattern of R, G and B to develop its pictures")
    return shift


def _shift(cell, pattern):
    """Rows and columns by which a cell is a shifted pattern; None if it is not."""
    letters = np.array([list(row) for row in pattern])
    return next((shift for shift in np.ndindex(letters.shape)
                 if np.array_equal(np.roll(letters, shift, (0, 1)), cell)), None)


def _binned(raw, above, left):
    """A raw picture with sums of 2 x 2 pixels, from a row and a column on; in 16 bits, as many as the sums permit."""
    numbers, camera = raw.numbers[above:, left:], raw.camera
    rows, columns = (n // 2 for n in numbers.shape)
    blocks = numbers[:2 * rows, :2 * columns].reshape(rows, 2, columns, 2).sum(axis=(1, 3), dtype=np.uint32)
    bits = min(camera.bits + 2, MOST_BITS)
    scale = 2**(bits - camera.bits) / 4  # of the sums
    letters = np.array(list(camera.channels))[raw.channel[above::2, left::2][:2, :2]]
    binned = replace(camera, shape_px=(rows, columns), filters=tuple(map("".join, letters)), bits=bits,
                     pitch_um=2 * camera.pitch_um, black_dn=4 * scale * camera.black_dn,
                     gain_dn_per_e=scale * camera.gain_dn_per_e, saturation_e=4 * camera.saturation_e,
                     dark_current_e_per_s=4 * camera.dark_current_e_per_s)
    return replace(raw, numbers=np.rint(scale * blocks).astype(np.uint16), camera=binned,
                   channel=channels_of(binned, (rows, columns)))
