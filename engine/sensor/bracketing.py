"""Exposure bracketing: several raw pictures of the same light become one with a larger range."""

from collections.abc import Sequence

import numpy as np

from ..runtime.errors import InputError
from .exposure import RawImage

SIGMAS = 5


def merged_e_per_s(pictures: Sequence[RawImage]) -> np.ndarray:
    """Electrons per second from light in each pixel, from all pictures in which it is not saturated.

    The estimate is their electrons over their exposure times: the most likely rate if photons are the only noise. A
    pixel that is saturated in all pictures has the highest of its rates, which the light exceeds.

    Parameters
    ----------
    pictures : sequence of RawImage
        By the same camera, with the same pixels.

    Returns
    -------
    float32 array, of the shape of the pictures' numbers

    Raises
    ------
    InputError
        There is no picture, or cameras or pixels differ.

    Examples
    --------
    >>> import numpy as np
    >>> from lensfield import Exposure, SpectralImage, expose, load_camera, merged_e_per_s
    >>> light = SpectralImage(np.full((3, 12, 16), 2e-4), [450, 550, 650], pitch_um=30, quantity="irradiance")
    >>> camera = load_camera("sony-a7-iv")
    >>> brackets = [expose(light, camera, Exposure(shutter_s, iso=100.0)) for shutter_s in (1 / 250, 1 / 60)]
    >>> merged_e_per_s(brackets).shape == brackets[0].numbers.shape
    True
    """
    if not pictures:
        raise InputError("bracketing", "pictures", "empty", "expected at least one picture")
    camera, shape = pictures[0].camera, pictures[0].numbers.shape
    if any(each.camera != camera or each.numbers.shape != shape for each in pictures):
        raise InputError("bracketing", "pictures", "different", "expected the same camera and size for all")
    electrons, valid = (np.stack([take(each) for each in pictures]) for take in (_electrons, _unsaturated))
    seconds = np.array([each.exposure.shutter_s for each in pictures]).reshape(-1, *[1] * len(shape))
    valid_s = (valid * seconds).sum(axis=0)
    rate = np.divide((valid * electrons).sum(axis=0), valid_s, out=(electrons / seconds).max(axis=0), where=valid_s > 0)
    return (rate - camera.dark_current_e_per_s).astype(np.float32)


def _electrons(picture):
    return (picture.numbers - picture.camera.black_dn) / picture.camera.gain_at(picture.exposure.iso)


def _unsaturated(picture):
    """Pixels below the highest number by more than the noise of a full pixel's reading."""
    noise_dn = picture.camera.dark_spread_dn(picture.exposure.iso)
    return picture.numbers < picture.highest_dn - SIGMAS * noise_dn
