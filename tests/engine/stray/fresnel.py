"""Fresnel's equations."""

import numpy as np


def fresnel(before, behind, cosine):
    """Reflectance of unpolarised light."""
    sine_square = (before / behind)**2 * (1 - cosine**2)
    other = np.sqrt(np.maximum(1 - sine_square, 0))
    across = (before * cosine - behind * other) / (before * cosine + behind * other)
    along = (before * other - behind * cosine) / (before * other + behind * cosine)
    return np.where(sine_square >= 1, 1.0, (across**2 + along**2) / 2)
