"""The shift-variant lens engine: lens design data + spectral radiance -> spectral irradiance -> a camera's picture.

It needs numpy, scipy and OpenEXR, and never Blender. Each of the names below is imported when it is first used, so that
a program that needs few of them starts quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bake.through_focus import psf_at_depth
    from .image.projection import Projection
    from .image.spectral_image import SpectralImage
    from .lens import GridLens, Lens, RadialLens
    from .lens_files.package import write_package
    from .library import load_lens
    from .library.bodies import load_camera
    from .library.rays import lens_rays
    from .photo.photograph import photograph
    from .photo.raw_file import write_raw_file
    from .pictures.develop import developed
    from .pictures.preview import write_png
    from .pictures.spectral_exr import read_exr, write_exr
    from .plan.options import Options
    from .prescription.readers import ReadingOptions, read_prescription
    from .rays.rings import Rings
    from .runtime.errors import CameraError, ImageError, InputError, LensError
    from .sensor.bracketing import merged_e_per_s
    from .sensor.camera import Camera
    from .sensor.electrons import missing_response
    from .sensor.exposure import Exposure, RawImage, expose
    from .sensor.film import film_density, film_exposure, read_film
    from .sensor.rolling_shutter import rolling_irradiance
    from .simulation.channel_cache import ChannelCache
    from .simulation.lens_image import lens_image
    from .simulation.report import Report
    from .simulation.simulate import simulate
    from .stray.options import StrayOptions

__all__ = ["Camera", "CameraError", "ChannelCache", "Exposure", "GridLens", "ImageError", "InputError", "Lens",
           "LensError", "Options", "Projection", "RadialLens", "RawImage", "ReadingOptions", "Report", "Rings",
           "SpectralImage", "StrayOptions", "developed", "expose", "film_density", "film_exposure", "lens_image",
           "lens_rays", "load_camera", "load_lens", "merged_e_per_s", "missing_response", "photograph", "psf_at_depth",
           "read_exr", "read_film", "read_prescription", "rolling_irradiance", "simulate", "write_exr", "write_package",
           "write_png", "write_raw_file"]

_MODULES = {"Camera": "sensor.camera", "CameraError": "runtime.errors", "ChannelCache": "simulation.channel_cache",
            "Exposure": "sensor.exposure", "GridLens": "lens", "ImageError": "runtime.errors",
            "InputError": "runtime.errors", "Lens": "lens", "LensError": "runtime.errors", "Options": "plan.options",
            "Projection": "image.projection", "RadialLens": "lens", "RawImage": "sensor.exposure",
            "ReadingOptions": "prescription.readers", "Report": "simulation.report", "Rings": "rays.rings",
            "SpectralImage": "image.spectral_image", "StrayOptions": "stray.options", "developed": "pictures.develop",
            "expose": "sensor.exposure", "film_density": "sensor.film", "film_exposure": "sensor.film",
            "lens_image": "simulation.lens_image", "lens_rays": "library.rays", "load_camera": "library.bodies",
            "load_lens": "library", "merged_e_per_s": "sensor.bracketing", "missing_response": "sensor.electrons",
            "photograph": "photo.photograph", "psf_at_depth": "bake.through_focus", "read_exr": "pictures.spectral_exr",
            "read_film": "sensor.film", "read_prescription": "prescription.readers",
            "rolling_irradiance": "sensor.rolling_shutter", "simulate": "simulation.simulate",
            "write_exr": "pictures.spectral_exr", "write_package": "lens_files.package",
            "write_png": "pictures.preview", "write_raw_file": "photo.raw_file"}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(f".{_MODULES[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
