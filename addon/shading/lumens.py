"""Lumens: the watts that a light has to have to give the luminous flux that it is sold by."""

import math

import numpy as np

from ...engine.spectral.spectra import BAND_NM, Spectrum
from ..scene.working_space import colour_basis


def give_lumens(light, lumens, lamp, tint):
    """Set the power of light data so that it gives these lumens, a sun these lux, with a lamp's spectrum and a tint.

    Of a spot that is what comes out of its cone. Inside, its radiant intensity is P / 4 pi times smoothstep(u / blend),
    where u goes from 0 on the rim to 1 on the axis with the cosine; so of P watts (1 - cos a) (1 - blend / 2) / 2 come
    out of the half angle a.
    """
    light.energy = lumens / luminous_efficacy(lamp, tint)
    light.exposure = 0
    if hasattr(light, "normalize"):
        light.normalize = True  # or its power would go by its size
    if light.type == "SPOT":
        light.energy *= 2 / ((1 - math.cos(light.spot_size / 2)) * (1 - light.spot_blend / 2))


def luminous_efficacy(lamp, tint=(1.0, 1.0, 1.0)):
    """Lumens of a watt of a lamp, behind a filter of this colour (of the working space); its watts are before it."""
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    passed = np.maximum(colour_basis(nm) @ np.array(tint), 0)
    own = lamp.density_at(nm)
    step_nm = np.where((nm == nm[0]) | (nm == nm[-1]), 0.5, 1.0)  # the trapezoidal rule
    behind = Spectrum(nm, own * passed).luminous_flux_per_watt() * (own * passed @ step_nm) / (own @ step_nm)
    return behind if passed.min() < 1 else lamp.spectrum.luminous_flux_per_watt()
