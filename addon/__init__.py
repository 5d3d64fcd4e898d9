"""The Blender side: panels, operators, the multispectral render and the compositor step."""

import bpy

from . import properties

_MODULES = (properties,)
_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    [cls for module in _MODULES for cls in module.classes])


def register():
    _register_classes()
    properties.register_pointers()


def unregister():
    properties.unregister_pointers()
    _unregister_classes()
