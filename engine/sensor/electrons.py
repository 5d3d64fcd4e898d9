"""Electrons from spectral irradiance: E(wavelength) A t wavelength / (h c) QE(wavelength), summed over wavelengths."""

from collections.abc import Callable

import numpy as np

from ..spectral.spectra import linear_weights, trapezoid_weights
from .camera import Camera

PLANCK_J_S, LIGHT_M_PER_S = 6.62607015e-34, 299792458.0
FINENESS_NM = 0.5  # of the integrals: quantum efficiency and irradiance are linear in between


def photons_per_joule(wavelengths_nm: np.ndarray) -> np.ndarray:
    """wavelength / (h c)."""
    return np.asarray(wavelengths_nm) * 1e-9 / (PLANCK_J_S * LIGHT_M_PER_S)


def response(camera: Camera, wavelengths_nm: np.ndarray) -> np.ndarray:
    """Electrons per second in each channel, for each W m^-2 nm^-1 of an image's planes: array (channel, wavelength).

    Parameters
    ----------
    camera : Camera
    wavelengths_nm : ascending array (wavelength,)
    """
    area_m2 = (camera.pitch_um * 1e-6)**2
    return area_m2 * plane_weights(wavelengths_nm, camera.wavelengths_nm, lambda nm: _electrons_per_joule(camera, nm))


def plane_weights(wavelengths_nm: np.ndarray, nodes_nm: np.ndarray,
                  response_at: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Weights of an image's planes in the integral of its spectrum times a response: array (channel, wavelength).

    Between its wavelengths an image is linear; beyond them it has no light. An image with one wavelength is
    monochromatic light, in W m^-2.

    Parameters
    ----------
    wavelengths_nm : ascending array (wavelength,)
        Of the image.
    nodes_nm : array
        Wavelengths at which the slope of the response changes.
    response_at : function of wavelengths in nm
        Returns the response of each channel: array (channel, wavelength).
    """
    nm = np.asarray(wavelengths_nm, dtype=np.float64)
    if nm.size == 1:
        return response_at(nm)
    fine_nm = _fine(nm[0], nm[-1], nm, nodes_nm)
    return (response_at(fine_nm) * trapezoid_weights(fine_nm)) @ linear_weights(nm, fine_nm)


def missing_response(camera: Camera, wavelengths_nm: np.ndarray) -> np.ndarray:
    """Share of each channel's response to even spectral irradiance outside some wavelengths.

    Parameters
    ----------
    camera : Camera
    wavelengths_nm : array (wavelength,)
        Of a picture; only the shortest and the longest count.

    Returns
    -------
    array (channel,)

    Examples
    --------
    >>> from lensfield import load_camera, missing_response
    >>> camera = load_camera("sony-a7-iv")
    >>> missing_response(camera, [450, 550, 650]).round(2).tolist()  # of R, G and B
    [0.13, 0.06, 0.36]
    """
    nm = camera.wavelengths_nm
    fine_nm = _fine(nm[0], nm[-1], nm, wavelengths_nm)
    within_nm = fine_nm[(fine_nm >= np.min(wavelengths_nm)) & (fine_nm <= np.max(wavelengths_nm))]
    if not within_nm.size:
        return np.ones(len(camera.channels))
    within, complete = (_electrons_per_joule(camera, each) @ trapezoid_weights(each) for each in (within_nm, fine_nm))
    return 1 - within / complete


def _fine(first_nm, last_nm, *nodes_nm):
    """Wavelengths from the first to the last, with all nodes between them."""
    even = np.linspace(first_nm, last_nm, int(np.ceil((last_nm - first_nm) / FINENESS_NM)) + 1)
    nodes = np.concatenate([even, *map(np.ravel, nodes_nm)])
    return np.unique(nodes[(nodes >= first_nm) & (nodes <= last_nm)])


def _per_photon(camera, wavelengths_nm):
    return np.stack([np.interp(wavelengths_nm, camera.wavelengths_nm, each, left=0.0, right=0.0)
                     for each in camera.quantum_efficiency])


def _electrons_per_joule(camera, wavelengths_nm):
    return _per_photon(camera, wavelengths_nm) * photons_per_joule(wavelengths_nm)
