"""The shift-variant lens engine: lens design data + spectral radiance -> spectral irradiance.

It needs numpy, scipy and OpenEXR, and never Blender.
"""

from .errors import ImageError, InputError, LensError
from .image.spectral_image import SpectralImage
from .kept import Kept
from .lens.lens import Lens
from .plan.options import Options
from .report import Report
from .simulate import simulate

__all__ = ["ImageError", "InputError", "Kept", "Lens", "LensError", "Options", "Report", "SpectralImage", "simulate"]
