"""The shift-variant lens engine: lens design data + spectral radiance -> spectral irradiance.

It needs numpy, scipy and OpenEXR, and never Blender.
"""

from .errors import ImageError, InputError, LensError
from .lens import Lens
from .pipeline import simulate
from .plan import Options
from .report import Report
from .spectral_image import SpectralImage

__all__ = ["ImageError", "InputError", "Lens", "LensError", "Options", "Report", "SpectralImage", "simulate"]
