"""Keys: Esc cancels the lens render under way, where its progress and its pictures are seen.

Blender asks these keymaps last: a transform, a menu or a text that is being edited gets its Esc first. With no render
under way the operator's poll fails, and Esc is what it was.
"""

import bpy

KEYMAPS = ("Property Editor", "PROPERTIES"), ("Image Generic", "IMAGE_EDITOR"), ("3D View Generic", "VIEW_3D")

_items = []


def register_keys():
    """Add the keys; Blender has no place for them in background mode."""
    keyconfig = bpy.context.window_manager.keyconfigs.addon
    for name, space_type in KEYMAPS if keyconfig else ():
        keymap = keyconfig.keymaps.new(name=name, space_type=space_type)
        _items.append((keymap, keymap.keymap_items.new("lensfield.cancel", "ESC", "PRESS")))


def unregister_keys():
    """Take them away."""
    while _items:
        keymap, item = _items.pop()
        keymap.keymap_items.remove(item)
