"""Lensfield: Blender scenes through real lenses, from spectral radiance to spectral irradiance at the sensor."""

__version__ = "0.1.0"

_commands = []  # `blender --command lensfield`, while the extension is enabled


def register():
    """Called by Blender when the extension is enabled."""
    import bpy

    from . import addon, cli

    addon.register()
    _commands.append(bpy.utils.register_cli_command("lensfield", cli.main))


def unregister():
    """Called by Blender when the extension is disabled."""
    import bpy

    from . import addon

    bpy.utils.unregister_cli_command(_commands.pop())
    addon.unregister()
