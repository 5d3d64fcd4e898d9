"""The compositor step in the panels: what its node shows and why, and a way to take it out."""

import bpy

from ..scene.compositor import compositor_state, remove_from_compositor


class LENSFIELD_OT_remove_from_compositor(bpy.types.Operator):
    """Take the Lensfield node out of the compositor: what it was put between is linked as before. Files stay"""

    bl_idname = "lensfield.remove_from_compositor"
    bl_label = "Remove from Compositor"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return bool(compositor_state(context.scene)[0]) and not bpy.app.is_job_running("RENDER")

    def execute(self, context):
        remove_from_compositor(context.scene)
        return {"FINISHED"}


def draw_compositor(layout, scene):
    """Whether the lens image goes into the compositor; and what is there, if anything is."""
    layout.prop(scene.lensfield, "to_compositor")
    text, icon = compositor_state(scene)
    if text:
        column = layout.column()
        column.prop(scene.lensfield, "compositor_shows")
        column.label(text=f"Shown: {text}", icon=icon)
        column.operator("lensfield.remove_from_compositor", icon="X")


classes = (LENSFIELD_OT_remove_from_compositor,)
