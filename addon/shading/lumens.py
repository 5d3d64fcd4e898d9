"""Lumens: the power in watts that gives a light its rated luminous flux."""

import math

import numpy as np

from lensfield.engine.spectral.spectra import BAND_NM, Spectrum

from ..scene.working_space import colour_basis


def give_lumens(light, lumens, lamp, tint):
    """Set the power of light data so that it gives these lumens (a sun: lux), with a lamp's spectrum and a tint.

    For a spot, this is the flux of its cone. Inside the cone, its radiant intensity is P / 4 pi times
    smoothstep(u / blend), where u is linear in the cosine, from 0 on the rim to 1 on the axis. Of P watts, a cone of
    half angle a therefore emits (1 - cos a) (1 - blend / 2) / 2.
    """
    light.energy = lumens / luminous_efficacy(lamp, tint)
    light.exposure = 0
    if hasattr(light, "normalize"):
        light.normalize = True  # otherwise its power depends on its size
    if light.type == "SPOT":
        light.energy *= 2 / ((1 - math.cos(light.spot_size / 2)) * (1 - light.spot_blend / 2))


def luminous_efficacy(lamp, tint=(1.0, 1.0, 1.0)):
    """Lumens behind a filter of this colour (in the working space) per watt of a lamp before it."""
    nm = np.arange(BAND_NM[0], BAND_NM[1] + 1)
    passed = np.maximum(colour_basis(nm) @ np.array(tint), 0)
    light = lamp.density_at(nm)
    step_nm = np.where((nm == nm[0]) | (nm == nm[-1]), 0.5, 1.0)  # the trapezoidal rule
    behind = Spectrum(nm, light * passed).luminous_flux_per_watt() * (light * passed @ step_nm) / (light @ step_nm)
    return behind if passed.min() < 1 else lamp.spectrum.luminous_flux_per_watt()
