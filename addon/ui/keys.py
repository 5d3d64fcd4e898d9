"""Keys: Esc cancels the running lens render in the editors that show its progress and pictures.

Blender tries these keymaps last: a transform, a menu or a text field gets Esc first. Without a running render the
operator's poll fails, and Esc has its usual meaning.
"""

import bpy

KEYMAPS = ("Property Editor", "PROPERTIES"), ("Image Generic", "IMAGE_EDITOR"), ("3D View Generic", "VIEW_3D")

_items = []


def register_keys():
    """Add the keys; in background mode Blender lacks the key configuration for them."""
    keyconfig = bpy.context.window_manager.keyconfigs.addon
    for name, space_type in KEYMAPS if keyconfig else ():
        keymap = keyconfig.keymaps.new(name=name, space_type=space_type)
        _items.append((keymap, keymap.keymap_items.new("lensfield.cancel", "ESC", "PRESS")))


def unregister_keys():
    """Remove the keys."""
    while _items:
        keymap, item = _items.pop()
        keymap.keymap_items.remove(item)
