"""Exposure metering: the exposure that suits a picture's light."""

from dataclasses import replace
from typing import Any

import numpy as np

from ..image.spectral_image import SpectralImage
from .camera import Camera
from .electrons import response
from .exposure import Exposure

METERED = 10.0 / 78.0
"""Mean signal of a metered picture over that of saturated pixels: ISO 2721's 10 lx s over ISO 12232's 78 lx s."""
MOST_METERED_PX = 2**18
COMMON_SHUTTER_S = 1 / 60  # of a picture without light, or in arbitrary units
HALVINGS = 60
LARGEST_CHANGE = 1e15


def metered(irradiance: SpectralImage, camera: Camera, iso: float | None = None, shutter_s: float | None = None,
            **others: Any) -> Exposure:
    """The exposure that the camera's meter chooses: the shutter, or the ISO if only the shutter is given.

    The mean of the frame's pixels with light, counted as saturated at most, becomes `METERED` of saturation. Bright
    lamps therefore do not darken the picture, and black around a render region or an image circle does not brighten it.
    The meter has the spectral sensitivity of the camera's most sensitive channel.

    Parameters
    ----------
    irradiance : SpectralImage
    camera : Camera
    iso, shutter_s : float, optional
        Given by the user. An ISO below `base_iso` is not chosen. With both given there is nothing to meter.
    others : by name
        Further fields of the Exposure.

    Raises
    ------
    InputError
        A value is not valid.
    """
    base = usual_exposure(camera, iso, shutter_s, **others)
    if iso is not None and shutter_s is not None:
        return base
    factor = exposure_factor(irradiance, camera, base)
    if shutter_s is None:
        return replace(base, shutter_s=base.shutter_s * factor)
    return replace(base, iso=base.iso * max(1.0, factor))


def usual_exposure(camera: Camera, iso: float | None, shutter_s: float | None, **others: Any) -> Exposure:
    """An exposure with the camera's base ISO, or a common shutter, in place of None."""
    return Exposure(COMMON_SHUTTER_S if shutter_s is None else shutter_s, camera.base_iso if iso is None else iso,
                    **others)


def exposure_factor(irradiance: SpectralImage, camera: Camera, exposure: Exposure) -> float:
    """Factor by which an exposure of a picture differs from the metered one; 1 for a picture without light."""
    sensitivity = response(camera, irradiance.wavelengths_nm)
    of_meter = sensitivity[np.argmax(sensitivity.sum(axis=1))].astype(np.float32)
    light_e = exposure.shutter_s * np.tensordot(of_meter, _sampled(irradiance.frame().cube), 1).ravel()
    relative = light_e[light_e > 0].astype(np.float64) / full_scale_e(camera, exposure.iso)
    if not relative.size:
        return 1.0
    low, high = 1 / LARGEST_CHANGE, LARGEST_CHANGE
    for _ in range(HALVINGS):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if np.minimum(relative * middle, 1).mean() < METERED else (low, middle)
    return float(high)


def full_scale_e(camera: Camera, iso: float) -> float:
    """Electrons at which a pixel is saturated: its full well, or the converter's range."""
    return min(camera.saturation_e, (camera.white_dn - camera.black_dn) / camera.gain_at(iso))


def _sampled(cube):
    """Every n-th row and column, of a large picture."""
    step = max(1, int(np.ceil(np.sqrt(cube[0].size / MOST_METERED_PX))))
    return cube[:, step // 2::step, step // 2::step]
