"""Exposure metering: the exposure that suits a picture's light."""

from dataclasses import replace
from typing import Any

import numpy as np

from ..image.irradiance import irradiance_per_radiance
from ..image.spectral_image import SpectralImage
from ..spectral.colour import light_basis
from ..spectral.spectra import BAND_NM
from .camera import Camera
from .electrons import response
from .exposure import Exposure

METERED = 10.0 / 78.0
"""Mean signal of a metered picture relative to saturated pixels: ISO 2721's 10 lx s over ISO 12232's 78 lx s."""
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
    return _suited(lambda base: exposure_factor(irradiance, camera, base), camera, iso, shutter_s, **others)


def metered_rec709(rec709: np.ndarray, camera: Camera, f_number_effective: float, iso: float | None = None,
                   shutter_s: float | None = None) -> Exposure:
    """As `metered`, for a lens image in colours, whose spectra are unknown.

    Parameters
    ----------
    rec709 : array (..., 3)
        Linear Rec. 709 in the scale of Blender's renders, as `to_rec709` without the image's exposure: its light is as
        `light_basis` upsamples it.
    camera : Camera
    f_number_effective : float
        Of the lens.
    iso, shutter_s : float, optional
    """
    light_e_per_s = rec709 @ _rec709_response(camera, f_number_effective)
    return _suited(lambda base: _factor(light_e_per_s * base.shutter_s / full_scale_e(camera, base.iso)),
                   camera, iso, shutter_s)


def developed_white(camera: Camera, exposure: Exposure, f_number_effective: float) -> float:
    """The value, in a developed picture without noise, of light that is white, (1, 1, 1), in the scale of Blender's
    renders: 1 saturates the camera."""
    light_e = _rec709_response(camera, f_number_effective).sum() * exposure.shutter_s
    return float(light_e / full_scale_e(camera, exposure.iso))


def _rec709_response(camera, f_number_effective):
    """Electrons per second in the meter's channel, for each component of linear Rec. 709: array (3,)."""
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 1.0)
    return irradiance_per_radiance(1.0, f_number_effective) * (_meter_response(camera, nm) @ light_basis(nm))


def _suited(factor_of, camera, iso, shutter_s, **others):
    """The usual Exposure, with a shutter or an ISO that is changed by its factor, a function of it, unless both are
    given."""
    base = usual_exposure(camera, iso, shutter_s, **others)
    if iso is not None and shutter_s is not None:
        return base
    factor = factor_of(base)
    if shutter_s is None:
        return replace(base, shutter_s=base.shutter_s * factor)
    return replace(base, iso=base.iso * max(1.0, factor))


def usual_exposure(camera: Camera, iso: float | None, shutter_s: float | None, **others: Any) -> Exposure:
    """An exposure with the camera's base ISO, or a common shutter, in place of None."""
    return Exposure(COMMON_SHUTTER_S if shutter_s is None else shutter_s, camera.base_iso if iso is None else iso,
                    **others)


def exposure_factor(irradiance: SpectralImage, camera: Camera, exposure: Exposure) -> float:
    """Factor by which an exposure of a picture differs from the metered one; 1 for a picture without light."""
    of_meter = _meter_response(camera, irradiance.wavelengths_nm).astype(np.float32)
    light_e = exposure.shutter_s * np.tensordot(of_meter, _sampled(irradiance.frame().cube), 1)
    return _factor(light_e / full_scale_e(camera, exposure.iso))


def _meter_response(camera, wavelengths_nm):
    """The `response` of the camera's most sensitive channel: array (wavelength,)."""
    sensitivity = response(camera, wavelengths_nm)
    return sensitivity[np.argmax(sensitivity.sum(axis=1))]


def _factor(signal):
    """Factor that brings the mean of pixels with light to `METERED`; of signals relative to saturation."""
    relative = signal[signal > 0].astype(np.float64)
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
