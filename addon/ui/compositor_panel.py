"""The compositor in the panels: the status of the Lensfield node, and an operator that removes it."""

import bpy

from ..scene.compositor import compositor_state, remove_from_compositor
from .common.text_wrap import draw_wrapped


class LENSFIELD_OT_remove_from_compositor(bpy.types.Operator):
    """Remove the Lensfield node from the compositor and restore the previous links. Files are kept"""

    bl_idname = "lensfield.remove_from_compositor"
    bl_label = "Remove from Compositor"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return bool(compositor_state(context.scene)[0]) and not bpy.app.is_job_running("RENDER")

    def execute(self, context):
        remove_from_compositor(context.scene)
        return {"FINISHED"}


def draw_shown(layout, scene):
    """Draw the image that the node shows, and the reason, if the compositor has the node."""
    text, icon = compositor_state(scene)
    if text:
        draw_wrapped(layout.column(align=True), f"Compositor: {text}", icon)


def draw_compositor(layout, scene):
    """Draw the setting that adds lens images to the compositor, and the node's settings if it exists."""
    layout.prop(scene.lensfield, "to_compositor")
    if compositor_state(scene)[0]:
        layout.prop(scene.lensfield, "compositor_shows")
        layout.operator("lensfield.remove_from_compositor", icon="X")


classes = (LENSFIELD_OT_remove_from_compositor,)
