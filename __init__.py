"""Lensfield: Blender scenes through real lenses, from spectral radiance to spectral irradiance at the sensor.

This is the package `lensfield` and, in a zip with everything but the engine, also Blender's extension, which takes the
engine from that package: the zip contains its wheel.
"""

__version__ = "0.1.0"

_undo = []  # functions that undo what `register` did, in reverse order


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
