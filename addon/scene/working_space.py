"""The working space: the linear RGB space of a file's colours; since Blender 5.0 it need not be Rec. 709."""

import bpy
import numpy as np
from mathutils import Color

from lensfield.engine.spectral.spectra import reflectance_basis

REC709 = "Linear Rec.709"
ROUNDING = 1e-5  # error of Blender's conversion between identical spaces


def working_space():
    """The name of the file's working space."""
    return getattr(getattr(bpy.data, "colorspace", None), "working_space", REC709)


def rec709_from_working():
    """Matrix (3, 3) from the working space to linear Rec. 709; white stays white to the last digit."""
    matrix = np.array([Color(primary).from_scene_linear_to_rec709_linear() for primary in np.eye(3)], dtype=float).T
    if np.allclose(matrix, np.eye(3), atol=ROUNDING):
        return np.eye(3)
    return matrix / matrix.sum(axis=1, keepdims=True)


def colour_basis(wavelengths_nm):
    """Reflectance of each primary of the working space: array (wavelength, 3).

    Rows times a colour give its reflectance, and white gives 1. Primaries outside Rec. 709, and colours near them, are
    negative at some wavelengths.
    """
    return reflectance_basis(wavelengths_nm) @ rec709_from_working()
