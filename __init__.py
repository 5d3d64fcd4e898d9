"""Lensfield: Blender scenes through real lenses, from spectral radiance to spectral irradiance at the sensor."""

__version__ = "0.1.0"


def register():
    """Called by Blender when the extension is enabled."""
    from . import addon

    addon.register()


def unregister():
    """Called by Blender when the extension is disabled."""
    from . import addon

    addon.unregister()
