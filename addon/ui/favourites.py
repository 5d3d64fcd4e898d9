"""Favourite lenses: at the top of the list, in all files."""

import bpy

from lensfield.engine.runtime.errors import InputError, one_line

from ..job.named_files import FROM_FILE
from ..scene.active_camera import camera_in
from .common.favourite_lenses import favourite_lenses, toggle_favourite
from .common.properties import forget_items


class LENSFIELD_OT_favourite(bpy.types.Operator):
    """Move this lens to the top of the list, in all files; press again to move it back"""

    bl_idname = "lensfield.favourite"
    bl_label = "Favourite"

    @classmethod
    def poll(cls, context):
        camera = camera_in(context)
        return camera is not None and camera.lensfield.lens != FROM_FILE

    def execute(self, context):
        try:
            toggle_favourite(camera_in(context).lensfield.lens)
        except InputError as error:
            self.report({"ERROR"}, one_line(error))
            return {"CANCELLED"}
        forget_items()
        return {"FINISHED"}


def draw_favourite(layout, lens):
    """Draw the button that makes a lens a favourite."""
    layout.operator("lensfield.favourite", text="", icon="SOLO_ON" if lens in favourite_lenses() else "SOLO_OFF")


classes = (LENSFIELD_OT_favourite,)
