"""Lensfield: Blender scenes through real lenses, from spectral radiance to spectral irradiance at the sensor.

This is the package `lensfield` and, in a zip with everything but the engine, also Blender's extension, which takes the
engine from that package: the zip contains its wheel. The names in `__all__` are the public API in Python, without
Blender: see docs/api.md.
"""
# ruff: noqa: F403, F405

from importlib import import_module

TYPE_CHECKING = False  # as in `typing`, which takes milliseconds to import; for editors and type checkers
if TYPE_CHECKING:
    from lensfield.engine import *

__version__ = "0.1.0"
__all__ = ["Camera", "CameraError", "ChannelCache", "Exposure", "GridLens", "ImageError", "InputError", "Lens",
           "LensError", "Options", "Projection", "RadialLens", "RawImage", "ReadingOptions", "Report", "Rings",
           "SpectralImage", "StrayOptions", "developed", "expose", "film_density", "film_exposure", "lens_image",
           "lens_rays", "load_camera", "load_lens", "merged_e_per_s", "missing_response", "photograph", "psf_at_depth",
           "read_exr", "read_film", "read_prescription", "rolling_irradiance", "simulate", "write_exr", "write_package",
           "write_png", "write_raw_file"]

_undo = []  # functions that undo what `register` did, in reverse order


def __getattr__(name):
    """Import a public name from the engine when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module {__package__!r} has no attribute {name!r}")
    return getattr(import_module("lensfield.engine"), name)


def __dir__():
    return sorted({*globals(), *__all__})


def register():
    """Called by Blender when the extension is enabled."""
    import bpy

    import lensfield

    if lensfield.__version__ != __version__:  # Blender updates files, but no modules that are loaded from wheels
        from . import restart

        restart.register()
        _undo.append(restart.unregister)
        return
    from . import addon, cli

    addon.register()
    command = bpy.utils.register_cli_command("lensfield", cli.main)
    _undo.extend([addon.unregister, lambda: bpy.utils.unregister_cli_command(command)])


def unregister():
    """Called by Blender when the extension is disabled."""
    while _undo:
        _undo.pop()()
