"""Favourite lenses: at the top of the list, in all files. They are stored in the add-on's preferences."""

import bpy

from ..job.named_files import FROM_FILE
from ..scene.active_camera import camera_in
from .common.preferences import addon_preferences, favourite_lenses
from .common.properties import forget_items


class LENSFIELD_OT_favourite(bpy.types.Operator):
    """Move this lens to the top of the list, in all files; press again to move it back"""

    bl_idname = "lensfield.favourite"
    bl_label = "Favourite"

    @classmethod
    def poll(cls, context):
        camera = camera_in(context)
        return addon_preferences() is not None and camera is not None and camera.lensfield.lens != FROM_FILE

    def execute(self, context):
        preferences, lens = addon_preferences(), camera_in(context).lensfield.lens
        names = preferences.favourite_lenses.split()
        preferences.favourite_lenses = " ".join(sorted({*names} ^ {lens}))
        bpy.context.preferences.is_dirty = True  # so that Blender saves it
        forget_items()
        return {"FINISHED"}


def draw_favourite(layout, lens):
    """Draw the button that makes a lens a favourite."""
    layout.operator("lensfield.favourite", text="", icon="SOLO_ON" if lens in favourite_lenses() else "SOLO_OFF")


classes = (LENSFIELD_OT_favourite,)
