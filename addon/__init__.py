"""The Blender side: panels, operators, the multispectral render and the compositor step."""

import bpy

from . import lint_panel, operators, panels, properties
from .lenses import forget_lenses
from .previews import forget_previews
from .render import kept, render_through_lens

__all__ = ["register", "render_through_lens", "unregister"]

_MODULES = (properties, operators, panels, lint_panel)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    [cls for module in _MODULES for cls in module.classes])
_commands = []


def register():
    """Register classes and properties, and the command `blender --command lensfield`."""
    _register_classes()
    properties.register_pointers()
    _commands.append(bpy.utils.register_cli_command("lensfield", _run_command))


def unregister():
    """Undo `register`."""
    bpy.utils.unregister_cli_command(_commands.pop())
    properties.unregister_pointers()
    _unregister_classes()
    kept.cache_clear()
    forget_lenses()
    forget_previews()


def _run_command(arguments):
    from ..cli import main  # the command imports the add-on only when asked to render

    return main(arguments)
