"""The light of the green pixels in raw pictures of cameras, and what these need to be compared with a lens."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..prescription.prescription import Prescription
from ..runtime.errors import ImageError, InputError, LensError
from ..runtime.inputs import check_input

RAW_BYTES = 2**30
NEARLY_WHITE, MOST_CLIPPED = 0.98, 1e-3  # of saturation, and the share of pixels beyond it
LEAST_SIGNAL = 0.03  # of saturation, where it is brightest
OTHER_LENS = 0.1  # relative difference of focal lengths
TO_SIGMA = 1.4826  # from the median of absolute differences


@dataclass(frozen=True, eq=False)
class GreenLight:
    """The green pixels of a raw picture.

    Attributes
    ----------
    levels : array (row, column)
        1 at saturation, and NaN in pixels of other colours. Without filters, all pixels are green.
    f_number : float
    """

    levels: np.ndarray
    f_number: float


def read_green(path: str | os.PathLike[str], focal_mm: float | None, f_number: float | None = None) -> GreenLight:
    """Read a raw picture: a DNG, or any other file that LibRaw opens.

    Parameters
    ----------
    path : path
    focal_mm : float or None
        Of the lens; EXIF with another one is of another lens.
    f_number : float, optional
        For a lens that does not report it.

    Raises
    ------
    ImageError
        The file is not a raw picture, states no f-number, or is of another lens.
    """
    path = Path(path)
    check_input(path, "raw picture", "expected a raw file of a camera", RAW_BYTES, ImageError)
    levels, stated_f, stated_mm = _green(path)
    if focal_mm and stated_mm and abs(stated_mm / focal_mm - 1) > OTHER_LENS:
        raise ImageError(path, "focal length in EXIF", f"{stated_mm:g} mm",
                         f"expected about {focal_mm:g} mm: a picture through this lens")
    f_number = f_number or stated_f
    if not f_number:
        raise ImageError(path, "f-number in EXIF", "missing",
                         "give one for each picture: --f-numbers 2,2.8,4, or F-Numbers in the window")
    return GreenLight(levels, round(float(f_number), 2))


def _green(path):
    """Light of the green pixels, or of all without filters, 1 at saturation and NaN elsewhere: array (row, column);
    and the f-number and focal length in EXIF, 0 if they are missing."""
    import rawpy

    try:
        with rawpy.imread(str(path)) as raw:
            pixels, white = raw.raw_image_visible, float(raw.white_level)
            black = np.array(raw.black_level_per_channel, float)
            green = [index for index, letter in enumerate(raw.color_desc.decode()) if letter == "G"]
            if pixels.ndim == 3:  # all channels in each pixel
                pixels, channel = pixels[..., green[0]], np.full(pixels.shape[:2], green[0])
            elif raw.num_colors == 1:
                channel = np.full(pixels.shape, green[0])
            else:
                channel = raw.raw_colors_visible
            levels = (pixels - black[channel]) / (white - black[channel])
            stated = raw.other.aperture, raw.other.focal_length
    except (rawpy.LibRawError, TypeError, AttributeError, IndexError):
        raise ImageError(path, "raw picture", "not readable",
                         "expected a raw file of a camera, as LibRaw opens") from None
    return np.where(np.isin(channel, green), levels, np.nan), *map(float, stated)


def check_clipped(path: Path, levels: np.ndarray) -> None:
    """Raise an ImageError if too many of these pixels, NaN in other colours than green, are saturated."""
    clipped = np.count_nonzero(levels > NEARLY_WHITE) / np.count_nonzero(~np.isnan(levels))
    if clipped > MOST_CLIPPED:
        raise ImageError(path, "exposure", f"{clipped:.1%} of the green pixels clipped", "expose a stop less")


def f_numbers_of(text: str, count: int) -> list[float | None]:
    """The f-numbers in a text, separated by commas, one for each picture; None for each if it is empty.

    Raises
    ------
    InputError
        The number of f-numbers is not the number of pictures, or one is not a positive number.
    """
    if not text.strip():
        return [None] * count
    try:
        f_numbers = [float(word) for word in text.split(",")]
    except ValueError:
        f_numbers = []
    if len(f_numbers) != count or not all(0 < each < np.inf for each in f_numbers):
        raise InputError("raw pictures", "f-numbers", text,
                         f"expected {count} f-numbers, one for each picture, such as 2,2.8,4")
    return [*f_numbers]


def camera_sensor_mm(prescription: Prescription, sensor_mm: tuple[float, float] | None) -> tuple[float, float]:
    """Width and height of the camera's sensor: the given ones, or the ones of the lens.

    Raises
    ------
    LensError
        Neither is known.
    """
    sensor_mm = sensor_mm or prescription.sensor_mm
    if sensor_mm is None:
        raise LensError(prescription.name, "sensor_mm", "missing",
                        "give the camera's sensor: --camera-sensor 36x24, or Sensor in the window")
    return sensor_mm
