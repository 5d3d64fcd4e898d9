"""Irradiance on the sensor from scene radiance (Eq. 2)."""

import numpy as np


def irradiance_per_radiance(transmittance: float, f_number_effective: float) -> float:
    """Irradiance on the axis per scene radiance, in sr: pi T / (4 N_eff^2), Eq. 2 with R = 1."""
    return np.pi * transmittance / (4 * f_number_effective**2)
