"""A rolling shutter: each row of the sensor is exposed a little later than the row above."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..image.spectral_image import SpectralImage
from ..runtime.errors import ImageError, InputError


def rolling_irradiance(irradiances: Sequence[SpectralImage], shutter_s: float, readout_s: float) -> SpectralImage:
    """The mean irradiance on each row during its own exposure, for `expose` with the same shutter time.

    The images follow each other evenly in the time of the frame, from the first row's opening to the closing of the row
    that would follow the last: shutter_s + readout_s. Row 0 is read first. In a scene at rest nothing changes.

    Parameters
    ----------
    irradiances : sequence of SpectralImage
        Means over equal parts of that time, with the same pixels and wavelengths.
    shutter_s : float
        Exposure time of each row.
    readout_s : float
        Time from the first row's opening to that of the row that would follow the last; 0 for a global shutter.

    Returns
    -------
    SpectralImage

    Raises
    ------
    ImageError
        Images differ in pixels, wavelengths, quantity or units.
    InputError
        There is no image, or a time is not valid.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import SpectralImage, rolling_irradiance
    >>> frames = [SpectralImage(np.full((1, 4, 4), light), [550], pitch_um=5, quantity="irradiance")
    ...           for light in (0, 1)]
    >>> rolling_irradiance(frames, shutter_s=0.01, readout_s=0.01).cube[0, :, 0].tolist()  # later rows, later light
    [0.0, 0.25, 0.5, 0.75]
    """
    if not irradiances:
        raise InputError("rolling shutter", "irradiances", "empty", "expected at least one image")
    if not 0 < shutter_s < np.inf or not 0 <= readout_s < np.inf:
        raise InputError("rolling shutter", "shutter_s, readout_s", (shutter_s, readout_s),
                         "expected a positive number, and 0 or more")
    first, *others = frames = [image.frame() for image in irradiances]
    for other in others:
        if any(getattr(other, name) != getattr(first, name) for name in ("sampling", "quantity", "arbitrary")):
            raise ImageError("image", "sampling", "different", "expected pixels, wavelengths and units as in the first")
    weights = _row_weights(first.frame_px[0], len(frames), shutter_s, readout_s).astype(np.float32)
    cube = sum(row_weights[:, None] * image.cube for row_weights, image in zip(weights, frames, strict=True))
    return replace(first, cube=cube)


def _row_weights(rows, images, shutter_s, readout_s):
    """Share of each row's exposure that falls into each image's time: array (image, row), with sums of 1."""
    opening_s = readout_s * np.arange(rows) / rows
    changes_s = np.linspace(0, shutter_s + readout_s, images + 1)[:, None]
    before_s = np.clip(changes_s - opening_s, 0, shutter_s)
    return np.diff(before_s, axis=0) / shutter_s
