"""The colours of a camera: from XYZ to its channels under an illuminant, and back."""

from dataclasses import dataclass

import numpy as np

from ..runtime.errors import CameraError
from ..runtime.values import Value
from ..spectral.spectra import BAND_NM, colour_matching, library_names, load_spectrum
from .camera import Camera
from .electrons import response

ILLUMINANT = "illuminant-d65"
LIGHTNESS_POWER = -2 / 3  # the slope of lightness, a cube root of Y: equal errors are equally visible


@dataclass(frozen=True, eq=False, repr=False)
class CameraColour(Value):
    """A camera's response to colours under an illuminant, relative to the channel with the largest response to white.

    Attributes
    ----------
    xyz_to_camera : array (channel, 3)
        Of XYZ with Y = 1 for white.
    neutral : array (channel,)
        The response to white, at most 1.
    """

    xyz_to_camera: np.ndarray
    neutral: np.ndarray

    @property
    def balanced_to_xyz(self) -> np.ndarray:
        """From channels that are divided by `neutral`, so that white is 1 in each, to XYZ: array (3, channel)."""
        return np.linalg.pinv(self.xyz_to_camera) * self.neutral


def filter_channels(camera: Camera) -> str:
    """Letters of the channels that pixels have, in the order of `Camera.channels`."""
    return "".join(letter for letter in camera.channels if not camera.filters or letter in "".join(camera.filters))


def camera_colour(camera: Camera, illuminant: str = ILLUMINANT) -> CameraColour:
    """The colours of a camera, fitted to the reflectances of the library under an illuminant.

    Three or four channels are linear functions of XYZ only approximately. The matrix is exact for white. For the other
    reflectances it has the least squares of errors, in channels that are 1 for white, weighted by their visibility.

    Parameters
    ----------
    camera : Camera
    illuminant : str
        A light of the library.

    Returns
    -------
    CameraColour

    Raises
    ------
    CameraError
        The camera has fewer than three channels, or one without response to visible light.
    """
    channels = filter_channels(camera)
    if len(channels) < 3:
        raise CameraError(f"camera {camera.name}", "channels", channels, "expected at least three to reproduce colours")
    nm, light = light_of(illuminant)
    reflectances = np.stack([load_spectrum(name).at(nm) for name in library_names("reflectance")])
    curves = np.hstack([colour_matching(nm), _response(camera, nm).T])
    white, samples = light @ curves, (reflectances * light) @ curves
    for letter in (letter for letter, electrons in zip(channels, white[3:], strict=True) if not electrons > 0):
        raise CameraError(f"camera {camera.name}", "quantum_efficiency", f"0 for visible light in {letter}",
                          "expected a response in all channels to reproduce colours")
    xyz, balanced = np.split(samples / white, [3], axis=1)
    weights = xyz[:, 1:2]**LIGHTNESS_POWER
    # rows that sum to 1 preserve white: one coefficient follows from the others
    differences = weights * (xyz[:, :2] - xyz[:, 2:])
    free = np.linalg.lstsq(differences, weights * (balanced - xyz[:, 2:]), rcond=None)[0].T
    matrix = np.column_stack([free, 1 - free.sum(axis=1)])
    white_xyz, neutral = white[:3] / white[1], white[3:] / white[3:].max()
    return CameraColour(neutral[:, None] * matrix / white_xyz, neutral)


def light_of(illuminant: str = ILLUMINANT) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths of the visible band and the light of an illuminant at them, W per nm in arbitrary units."""
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    return nm, load_spectrum(illuminant).at(nm)


def channel_weights(camera: Camera, wavelengths_nm: np.ndarray, illuminant: str = ILLUMINANT) -> np.ndarray:
    """Share of each wavelength in the electrons of white under an illuminant: array (channel, wavelength), sums of 1.

    They are equal in a channel without response at these wavelengths.

    Parameters
    ----------
    camera : Camera
    wavelengths_nm : array (wavelength,)
        Ascending.
    illuminant : str
        A light of the library.
    """
    electrons = _response(camera, wavelengths_nm) * load_spectrum(illuminant).at(wavelengths_nm)
    total = electrons.sum(axis=1, keepdims=True)
    return np.divide(electrons, total, out=np.full_like(electrons, 1 / electrons.shape[1]), where=total > 0)


def _response(camera, wavelengths_nm):
    """The response of the channels that pixels have: array (channel, wavelength)."""
    used = [camera.channels.index(letter) for letter in filter_channels(camera)]
    return response(camera, wavelengths_nm)[used]
