"""A camera's exposure: from spectral irradiance to digital numbers, by the linear model of EMVA Standard 1288.

A pixel collects electrons from light and from dark current, with the fluctuations of both (Poisson). The reading adds
noise; the gain K, the black level and the converter turn the sum into a digital number. Pixels differ a little in
their response (PRNU) and in their dark signal (DSNU), and always in the same way in the same camera.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..image.pixel_grid import PixelGrid
from ..image.spectral_image import SpectralImage, check_irradiance
from ..kernels.pixels import Pixels, key
from ..kernels.reading import read
from ..runtime.errors import InputError
from ..runtime.threads import in_bands
from .camera import Camera
from .collecting import BAND_PIXELS, check_memory, collected_e

FRAMES = 2**32  # with different noise; of programs that have negative frames, too, take the remainder
MOST = 1e20  # of seconds and of ISO: their squares, and electrons in single precision, are finite


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

    Examples
    --------
    >>> from lensfield import Exposure
    >>> Exposure(shutter_s=1 / 50, iso=400.0, frame=7)
    Exposure(shutter_s=0.02, iso=400.0, seed=0, frame=7, serial=0, noise=True)
    """

    shutter_s: float
    iso: float
    seed: int = 0
    frame: int = 0
    serial: int = 0
    noise: bool = True

    def __post_init__(self) -> None:
        for name in ("shutter_s", "iso"):
            if not 1 / MOST <= getattr(self, name) <= MOST:
                raise InputError("exposure", name, getattr(self, name),
                                 f"expected a positive number, from {1 / MOST:g} to {MOST:g}")
        for name in ("seed", "frame", "serial"):
            if not isinstance(getattr(self, name), int) or not 0 <= getattr(self, name) < 2**63:
                raise InputError("exposure", name, getattr(self, name), "expected a whole number from 0")


def exposure_value(f_number: float, shutter_s: float, iso: float) -> float:
    """EV100: the exposure value, at ISO 100, of the light that suits an exposure: 0 for f/1, 1 s and ISO 100."""
    return math.log2(f_number**2 / shutter_s * 100 / iso)


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
        Pitch of the picture divided by the pitch of the sensor, if they differ.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Exposure, SpectralImage, expose, load_camera
    >>> light = SpectralImage(np.full((3, 12, 16), 2e-4), [450, 550, 650], pitch_um=30, quantity="irradiance")
    >>> raw = expose(light, load_camera("sony-a7-iv"), Exposure(shutter_s=1 / 60, iso=100.0))
    >>> raw.numbers.dtype, raw.numbers.shape == raw.channel.shape, raw.saturated
    (dtype('uint16'), True, 0.0)
    """

    numbers: np.ndarray
    channel: np.ndarray | None
    camera: Camera
    exposure: Exposure
    resampled: float | None

    @property
    def saturated(self) -> float:
        """Share of the pixels that hold no more light. Noise lowers the numbers of some: most are within 3 sigma."""
        noise_dn = self.camera.dark_spread_dn(self.exposure.iso) * self.exposure.noise
        return float((self.numbers >= self.highest_dn - 3 * noise_dn).mean())

    @property
    def highest_dn(self) -> int:
        """Digital number at which the converter or a pixel's full well ends; above the black level at any gain."""
        camera = self.camera
        full_dn = camera.black_dn + camera.gain_at(self.exposure.iso) * camera.saturation_e
        return min(camera.white_dn, max(int(full_dn), int(camera.black_dn) + 1))

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
        The picture is not irradiance in W m^-2 nm^-1, or there is not enough memory.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Exposure, SpectralImage, expose, load_camera
    >>> light = SpectralImage(np.full((3, 12, 16), 2e-4), [450, 550, 650], pitch_um=30, quantity="irradiance")
    >>> raw = expose(light, load_camera("sony-a7-iv"), Exposure(shutter_s=1 / 60, iso=100.0))
    >>> raw.numbers.shape, f"{raw.resampled:.2f}"  # times the sensor's pitch
    ((70, 94), '5.86')
    """
    check_irradiance(irradiance)
    shape = covered_px(irradiance, camera)
    check_memory(irradiance, camera, shape)
    channel = channels_of(camera, shape)
    planes = _read(collected_e(irradiance, camera, exposure.shutter_s, channel, shape), camera, exposure)
    numbers, resampled = planes if channel is None else planes[0], irradiance.pitch_um / camera.pitch_um
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


def _read(light_e, camera, exposure):
    """Digital numbers of pixels in the middle of the sensor with these mean electrons from light."""
    first = [(n - part) // 2 for n, part in zip(camera.shape_px, light_e.shape[1:], strict=True)]
    pixels = Pixels(key(exposure.serial), key(exposure.serial, exposure.seed, exposure.frame), tuple(first),
                    camera.prnu, camera.dsnu_e, camera.dark_current_e_per_s * exposure.shutter_s, camera.saturation_e,
                    camera.dark_noise_at(exposure.iso), camera.gain_at(exposure.iso), camera.black_dn, camera.white_dn,
                    exposure.noise)
    numbers = np.empty(light_e.shape, np.uint16)
    in_bands(lambda rows: read(pixels, light_e, rows, numbers), light_e.shape[1], BAND_PIXELS // light_e.shape[2])
    return numbers
