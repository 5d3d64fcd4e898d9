"""Ideal irradiance: what an unaberrated lens would put on the sensor."""

import numpy as np


def irradiance_per_radiance(transmittance, f_number_effective):
    """Irradiance on the axis per radiance of the scene, in sr: pi T / (4 N_eff^2), Eq. 2 with R = 1."""
    return np.pi * transmittance / (4 * f_number_effective**2)


def ideal_irradiance(radiance, relative_illumination, transmittance, f_number_effective):
    """Ideal image irradiance of a Lambertian scene (Eq. 2).

    Parameters
    ----------
    radiance : array (row, column), W m^-2 sr^-1 nm^-1, already on the image grid
    relative_illumination : array (row, column), R of Eq. 2
    transmittance : float, T of Eq. 2
    f_number_effective : float, 0.5 / NA

    Returns
    -------
    array (row, column), W m^-2 nm^-1
    """
    return irradiance_per_radiance(transmittance, f_number_effective) * radiance * relative_illumination
