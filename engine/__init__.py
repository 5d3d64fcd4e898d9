"""The shift-variant lens engine: lens design data + spectral radiance -> spectral irradiance.

It needs numpy, scipy and OpenEXR, and never Blender.
"""

from .image.spectral_image import SpectralImage
from .lens import Lens
from .library import load_lens
from .plan.options import Options
from .rays.rings import Rings
from .runtime.errors import ImageError, InputError, LensError
from .simulation.channel_cache import ChannelCache
from .simulation.report import Report
from .simulation.simulate import simulate

__all__ = ["ChannelCache", "ImageError", "InputError", "Lens", "LensError", "Options", "Report", "Rings",
           "SpectralImage", "load_lens", "simulate"]
