"""A camera's exposure: from spectral irradiance to digital numbers, by the linear model of EMVA Standard 1288.

A pixel collects electrons from light and from dark current, with the fluctuations of both (Poisson). The reading adds
noise; the gain K, the black level and the converter turn the sum into a digital number. Pixels differ a little in
their response (PRNU) and in their dark signal (DSNU), and always in the same way in the same camera.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from ..image.pixel_grid import PixelGrid
from ..image.spectral_image import SpectralImage, check_irradiance
from ..runtime.errors import InputError
from .camera import Camera
from .electrons import response
from .resampling import pixel_means

BLOCK_ROWS = 64  # that draw from one stream of random numbers
FEW_E = 64.0  # electrons up to which counts are drawn from the Poisson distribution itself
PIXELS, NOISE = 0, 1  # kinds of random numbers: of the camera, and of an exposure


@dataclass(frozen=True)
class Exposure:
    """How a picture is taken.

    Attributes
    ----------
    shutter_s : float
    iso : float
    seed, frame : int
        Noise is the same for the same seed and frame.
    serial : int
        Of the camera: its pixels' differences follow from it.
    noise : bool
        False leaves out everything random, and the pixels' differences.

    Raises
    ------
    InputError
        A value is not valid.
    """

    shutter_s: float
    iso: float
    seed: int = 0
    frame: int = 0
    serial: int = 0
    noise: bool = True

    def __post_init__(self) -> None:
        for name in ("shutter_s", "iso"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError("exposure", name, getattr(self, name), "expected a positive number")
        for name in ("seed", "frame", "serial"):
            if not isinstance(getattr(self, name), int) or not 0 <= getattr(self, name) < 2**63:
                raise InputError("exposure", name, getattr(self, name), "expected a whole number from 0")


@dataclass(frozen=True, eq=False)
class RawImage:
    """A raw picture.

    Attributes
    ----------
    numbers : uint16 array (row, column), or (channel, row, column) without filters
        Digital numbers.
    channel : uint8 array (row, column) or None
        Index into the camera's channels of each pixel; None if all pixels have all channels.
    camera : Camera
    exposure : Exposure
    resampled : float or None
        Pitch of the picture over the sensor's, if it was not the sensor's own.
    """

    numbers: np.ndarray
    channel: np.ndarray | None
    camera: Camera
    exposure: Exposure
    resampled: float | None

    @property
    def saturated(self) -> float:
        """Share of the pixels that hold no more light. Noise lowers the numbers of some: most are within 3 sigma."""
        camera, iso = self.camera, self.exposure.iso
        noise_dn = camera.gain_at(iso) * np.hypot(camera.dark_noise_at(iso), camera.dsnu_e) * self.exposure.noise
        return float((self.numbers >= self.highest_dn - 3 * noise_dn).mean())

    @property
    def highest_dn(self) -> int:
        """Digital number at which the converter or a pixel's full well ends."""
        camera = self.camera
        full_dn = camera.black_dn + camera.gain_at(self.exposure.iso) * camera.saturation_e
        return min(camera.white_dn, int(full_dn))

    @property
    def dark_dn(self) -> float:
        """Mean digital number of pixels without light, below `highest_dn`: the black level and the dark current."""
        dark_e = self.camera.dark_current_e_per_s * self.exposure.shutter_s
        return min(self.camera.black_dn + self.camera.gain_at(self.exposure.iso) * dark_e, self.highest_dn - 1)


def expose(irradiance: SpectralImage, camera: Camera, exposure: Exposure) -> RawImage:
    """Take a picture of spectral irradiance on a sensor.

    The picture's middle is the sensor's. The raw picture has the sensor's pixels, as many as the picture covers; pixels
    of another size are resampled, without a change of the light on any area.

    Parameters
    ----------
    irradiance : SpectralImage
        W m^-2 nm^-1.
    camera : Camera
    exposure : Exposure

    Returns
    -------
    RawImage

    Raises
    ------
    ImageError
        The picture is not irradiance in W m^-2 nm^-1.
    """
    check_irradiance(irradiance)
    shape = covered_px(irradiance, camera)
    channel = channels_of(camera, shape)
    light_e = _behind_filters(_light(irradiance, camera, exposure, shape), channel)
    planes = () if channel is not None else (len(camera.channels),)
    numbers = np.empty((*planes, *shape), np.uint16)
    for first in range(0, shape[0], BLOCK_ROWS):
        rows = slice(first, min(first + BLOCK_ROWS, shape[0]))
        numbers[..., rows, :] = _converted(_shared(light_e, rows, shape[0], camera), camera, exposure, first)
    resampled = irradiance.pitch_um / camera.pitch_um
    return RawImage(numbers, channel, camera, exposure, None if resampled == 1 else resampled)


def covered_px(irradiance: SpectralImage | PixelGrid, camera: Camera) -> tuple[int, int]:
    """Rows and columns of the camera's pixels that the picture covers, at most all."""
    rows, columns = (min(n, max(1, round(picture * irradiance.pitch_um / camera.pitch_um)))
                     for n, picture in zip(camera.shape_px, irradiance.frame_px, strict=True))
    return rows, columns


def raw_grid(grid: PixelGrid, camera: Camera) -> PixelGrid:
    """The pixels of the raw picture that a camera takes of a picture on these."""
    frame = grid.frame()
    shape = covered_px(frame, camera)
    row, column = ((n - 1) / 2 + (axis - (picture - 1) / 2) * grid.pitch_um / camera.pitch_um
                   for n, picture, axis in zip(shape, frame.shape_px, frame.centre_px, strict=True))
    return PixelGrid(shape, camera.pitch_um, (row, column))


def channels_of(camera: Camera, shape_px: tuple[int, int]) -> np.ndarray | None:
    """Index of the channel of each pixel in the middle of a sensor: uint8 array (row, column), or None without filters.
    """
    if not camera.filters:
        return None
    cell = np.array([[camera.channels.index(letter) for letter in row] for row in camera.filters], dtype=np.uint8)
    first = [(n - part) // 2 for n, part in zip(camera.shape_px, shape_px, strict=True)]
    cell = np.roll(cell, [-n for n in first], axis=(0, 1))
    repeats = [-(-part // n) for part, n in zip(shape_px, cell.shape, strict=True)]
    return np.tile(cell, repeats)[:shape_px[0], :shape_px[1]]


def _light(irradiance, camera, exposure, shape):
    """A function of rows of the raw picture: mean electrons from their light, array (channel, row, column)."""
    per_plane = (response(camera, irradiance.wavelengths_nm) * exposure.shutter_s).astype(np.float32)
    cube = irradiance.frame().cube
    if irradiance.pitch_um == camera.pitch_um:  # each pixel is even: the same through any aperture
        above, left = ((n - part) // 2 for n, part in zip(cube.shape[1:], shape, strict=True))
        cube = cube[:, above:above + shape[0], left:left + shape[1]]
        return lambda rows: np.tensordot(per_plane, cube[:, rows], 1)
    planes = np.stack([pixel_means(np.tensordot(each, cube, 1), irradiance.pitch_um, shape, camera.pitch_um,
                                   camera.pixel_aperture)
                       for each in per_plane])
    return lambda rows: planes[:, rows]


def _behind_filters(light_e, channel):
    """The function of rows with, of the electrons in each channel, those of each pixel's own: array (row, column)."""
    if channel is None:
        return light_e

    def pixel_e(rows):
        chosen_e = np.empty(channel[rows].shape, np.float32)
        for index, plane in enumerate(light_e(rows)):
            np.copyto(chosen_e, plane, where=channel[rows] == index)
        return chosen_e

    return pixel_e


def _shared(pixel_e, rows, number, camera):
    """Mean electrons in some of a number of rows after crosstalk. None leave the picture."""
    if not camera.crosstalk:
        return pixel_e(rows)
    around = slice(max(rows.start - 1, 0), min(rows.stop + 1, number))
    before_e = pixel_e(around)
    exchange = np.float32(camera.crosstalk / 4) * np.array([1, -2, 1])
    after_e = before_e + sum(scipy.ndimage.correlate1d(before_e, exchange, axis, mode="nearest") for axis in (-2, -1))
    return after_e[..., rows.start - around.start:rows.stop - around.start, :]


def _converted(light_e, camera, exposure, first_row):
    """Digital numbers of pixels with these mean electrons from light, in rows from the first."""
    gain = np.float32(camera.gain_at(exposure.iso))
    dark_e = np.float32(camera.dark_current_e_per_s * exposure.shutter_s)
    if not exposure.noise:
        read_e = np.minimum(light_e + dark_e, np.float32(camera.saturation_e))
        return _quantised(read_e * gain, camera)
    pixels, drawn = (np.random.Generator(np.random.Philox(np.random.SeedSequence([kind, *numbers, first_row])))
                     for kind, numbers in ((PIXELS, (exposure.serial,)),
                                           (NOISE, (exposure.serial, exposure.seed, exposure.frame))))
    response_of_each = 1 + np.float32(camera.prnu) * pixels.standard_normal(light_e.shape, np.float32)
    offset_e = np.float32(camera.dsnu_e) * pixels.standard_normal(light_e.shape, np.float32)
    mean_e = light_e * np.maximum(response_of_each, 0) + dark_e
    read_e = np.minimum(_counted(mean_e, drawn), np.float32(camera.saturation_e)) + offset_e
    noise_e = np.float32(camera.dark_noise_at(exposure.iso))
    return _quantised((read_e + noise_e * drawn.standard_normal(light_e.shape, np.float32)) * gain, camera)


def _counted(mean_e, drawn):
    """Electrons counted where these are expected: Poisson's distribution, by its first three moments above FEW_E."""
    normal = drawn.standard_normal(mean_e.shape, np.float32)
    counted = np.rint(mean_e + np.sqrt(mean_e) * normal + (normal * normal - 1) / 6)
    few = mean_e < FEW_E
    counted[few] = drawn.poisson(mean_e[few])
    return counted


def _quantised(signal_dn, camera):
    return np.clip(np.rint(signal_dn + np.float32(camera.black_dn)), 0, camera.white_dn).astype(np.uint16)
