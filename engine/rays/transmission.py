"""The light on the axis that the glass and the coatings of a lens transmit."""

from collections.abc import Sequence

import numpy as np

from ..prescription.coatings import BUILT_IN, IDEAL
from ..prescription.system import System
from ..runtime.errors import LensError
from .fields import find_fields, trace_fields, view_of
from .rays import Pupil, trace_pupil
from .trace import invariants_from_image

RINGS, AZIMUTHS = 9, 8
RADII = np.sqrt(np.linspace(0, 1, RINGS))  # rings of equal area between them
MERIDIAN = Pupil(RADII, np.zeros(1))
STOP = Pupil(RADII, 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS)


def transmittance(system: System, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
    """T of Eq. 2: array (wavelength,). Glass counts along the axis, and coatings as in `coating_transmittance`.

    Raises
    ------
    LensError
        A wavelength outside the range of a glass or of a measured coating, or no light reaches the middle of the
        picture.
    """
    return system.glass_transmittance(wavelengths_nm) * coating_transmittance(system, wavelengths_nm)


def coating_transmittance(system: System, wavelengths_nm: Sequence[float] | np.ndarray) -> np.ndarray:
    """Share of the light that gets through all surfaces, reflected by mirrors only, in the middle of the picture:
    the mean over the stop, array (wavelength,). 1 if all coatings are ideal, and without mirrors. Raises a LensError if
    no light gets there."""
    nm = np.asarray(wavelengths_nm, dtype=float)
    if all(coating is BUILT_IN[IDEAL] for coating in system.coatings):
        return np.full_like(nm, system.mirror_reflectance)
    invariants, lost = _axial_rays(system, nm)
    if np.all(lost, axis=-1).any():
        raise LensError(system.prescription.name, "light in the middle of the picture", "none",
                        "expected rays from the stop to get there: check apertures, tilts and decentres")
    shares = np.prod(1 - system.reflectances(nm, invariants), axis=0)
    weights = np.where(lost, 0.0, _trapezium(lost.shape[-1]))
    through = np.sum(weights * np.where(lost, 0.0, shares), axis=-1) / weights.sum(axis=-1)
    return system.mirror_reflectance * through


def _trapezium(rays):
    """Weights of the trapezium rule over `RADII`, for rays in the order (radius, azimuth)."""
    weights = np.ones(RINGS)
    weights[[0, -1]] = 0.5
    return np.repeat(weights, rays // RINGS)


def _axial_rays(system, nm):
    """(n sin(angle))^2 at each surface of rays to the middle of the picture, array (surface, wavelength, ray); and
    whether they are lost, array (wavelength, ray)."""
    if system.prescription.radial:
        rays, origin_mm = trace_pupil(system, [0.0], nm, MERIDIAN), np.zeros(2)
    else:
        view = view_of(system)
        rays = trace_fields(system, view, find_fields(system, view, np.zeros((2, 1)), nm), STOP)
        origin_mm = view.origin_mm
    position_mm = rays.position_mm + origin_mm.reshape(2, *(1,) * (rays.position_mm.ndim - 1))
    image_plane = np.stack([*position_mm, np.zeros_like(position_mm[0])])
    with np.errstate(invalid="ignore"):
        invariants = invariants_from_image(system.prescription, system.indices_at(nm)[:, :, None, None, None],
                                           image_plane, rays.direction)
    lost = rays.lost.reshape(nm.size, -1)
    return np.where(lost, 0.0, invariants.reshape(len(invariants), nm.size, -1)), lost
