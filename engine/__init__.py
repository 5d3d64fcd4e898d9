"""The shift-variant lens engine: lens design data + spectral radiance -> spectral irradiance -> a camera's picture.

It needs numpy, scipy and OpenEXR, and never Blender. Each of the names below is imported when it is first used, so that
a program that needs few of them starts quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .image.spectral_image import SpectralImage
    from .lens import Lens
    from .library import load_lens
    from .library.bodies import load_camera
    from .photo.photograph import photograph
    from .plan.options import Options
    from .prescription.readers import ReadingOptions, read_prescription
    from .rays.rings import Rings
    from .runtime.errors import CameraError, ImageError, InputError, LensError
    from .simulation.channel_cache import ChannelCache
    from .simulation.lens_image import lens_image
    from .simulation.report import Report
    from .simulation.simulate import simulate
    from .stray.options import StrayOptions

__all__ = ["CameraError", "ChannelCache", "ImageError", "InputError", "Lens", "LensError", "Options", "ReadingOptions",
           "Report", "Rings", "SpectralImage", "StrayOptions", "lens_image", "load_camera", "load_lens", "photograph",
           "read_prescription", "simulate"]

_MODULES = {"CameraError": "runtime.errors", "ChannelCache": "simulation.channel_cache", "ImageError": "runtime.errors",
            "InputError": "runtime.errors", "Lens": "lens", "LensError": "runtime.errors", "Options": "plan.options",
            "ReadingOptions": "prescription.readers", "Report": "simulation.report", "Rings": "rays.rings",
            "SpectralImage": "image.spectral_image", "StrayOptions": "stray.options",
            "lens_image": "simulation.lens_image", "load_camera": "library.bodies", "load_lens": "library",
            "photograph": "photo.photograph", "read_prescription": "prescription.readers",
            "simulate": "simulation.simulate"}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(f".{_MODULES[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
