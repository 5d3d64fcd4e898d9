"""The shift-variant lens engine: lens design data + spectral radiance -> spectral irradiance.

It needs numpy, scipy and OpenEXR, and never Blender.
"""

from .errors import ImageError, InputError, LensError
from .kept import Kept
from .lens import Lens
from .options import Options
from .pipeline import simulate
from .report import Report
from .spectral_image import SpectralImage

__all__ = ["ImageError", "InputError", "Kept", "Lens", "LensError", "Options", "Report", "SpectralImage", "simulate"]
